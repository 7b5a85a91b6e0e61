"""What drives and battery can give: motors that ask for more power get less torque."""

from __future__ import annotations

from ....controllers.compiled.kernels import njit
from ....controllers.whole_body.kinematics import NU, NV, Array, Physics


@njit(cache=True)
def limit_power(phys: Physics, k: int, torque: Array, each: float, together: float) -> None:
    """Lower the driving ones of torques (14,) until no motor gives more than `each` [W], all than `together`.

    The power of a motor is its torque times its joint's rate, P_i = tau_i w_i; braking takes and returns
    none. Where sum max(P_i, 0) is above the battery's power, all driving torques are scaled alike.
    """
    total = 0.0
    for i in range(NU):
        power = torque[i] * phys.qvel[k, NV - NU + i]
        if power > each:
            torque[i] *= each / power
            power = each
        total += max(power, 0.0)
    if total <= together:
        return
    for i in range(NU):
        if torque[i] * phys.qvel[k, NV - NU + i] > 0.0:
            torque[i] *= together / total
