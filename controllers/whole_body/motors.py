"""What the motors of the joints can give: less and less torque near their speed without load.

A motor drives with its full torque up to a share of its speed without load, then with one that falls linearly
to zero there; against its motion it always has its full torque. The model's actuators hold both numbers
(forcerange and user). The speeds are those of the robot H1 of Unitree, which has about these torques and
this mass (`velocity` of the joints in its published URDF): hip and waist 23, knee 14, ankle 9 rad/s.
"""

from __future__ import annotations

from ..compiled.kernels import njit
from .kinematics import NU, NV, Array, Physics

FULL_TORQUE_SHARE = 0.7  # of the speed without load, up to which a motor drives with its full torque


@njit(cache=True, forceinline=True)
def driving_share(speed: float, free_speed: float) -> float:
    """Share of its torque with which a motor drives at a speed in the torque's direction [rad/s]."""
    share = (1.0 - speed / free_speed) / (1.0 - FULL_TORQUE_SHARE)
    return min(max(share, 0.0), 1.0)


@njit(cache=True, forceinline=True)
def write_torque_range(phys: Physics, k: int, motors: Array, torque_range: Array) -> None:
    """Write the least and the largest torque of every motor of robot k, (2, 14) [N m]."""
    for i in range(NU):
        top, free_speed, speed = motors[0, i], motors[1, i], phys.qvel[k, NV - NU + i]
        torque_range[0, i] = -top * driving_share(-speed, free_speed)
        torque_range[1, i] = top * driving_share(speed, free_speed)


@njit(cache=True, forceinline=True)
def clip_torque(torque: Array, torque_range: Array) -> None:
    """Clip torques (14,) to what the motors can give."""
    for i in range(NU):
        torque[i] = min(max(torque[i], torque_range[0, i]), torque_range[1, i])
