"""Nominal gait of a commanded velocity, by the mid-range rule.

The step period is the middle of the range that the step box leaves for the commanded velocity; the DCM offset
is that of the two-step periodic gait of the linear inverted pendulum (Khadiv et al. 2016, section III):

    L = v_x P,    W = l_p + v_y P,    P = T + touchdown_delay,    lambda = exp(omega P),
    b_x = L / (lambda - 1),    b_y = v_y P / (lambda - 1) - l_p / (lambda + 1).

With double support of d seconds (`double_support.py`) and c = kappa(0), the CoP's transfer changes it to

    b_x = L (1 - lambda c) / (lambda - 1),
    b_y = v_y P (1 - lambda c) / (lambda - 1) - l_p (1 + lambda c) / (lambda + 1).

All of it is in the canonical frame: a velocity towards the swing side widens this step and narrows the next.

Sideways the range of P ends at min(W_max - l_p, l_p - W_min) / |v_y|, not at the published W_max / |v_y|: of
two steps one is l_p + v_y P wide and the other l_p - v_y P, and both have to lie in the box. With the paper's
limits (0.1 to 0.4 m, l_p = 0.2 m) and v_y = 0.2 m/s that gives T = 0.40 s with steps of 0.28 and 0.12 m; the
published rule gives 0.65 s, whose narrow step, 0.07 m, the box forbids.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError
from .double_support import check_double_support, transfer_weight
from .gait_box import DURATION, STEP, GaitLimits
from .robot import RobotModel

# Columns of a nominal gait (5,); of a pair (x, y) the first one
NOMINAL_STEP = 0  # pair, L, W [m]
NOMINAL_DURATION = 2  # T [s]
NOMINAL_DCM_OFFSET = 3  # pair, b_x, b_y [m]
NOMINAL_SIZE = 5


@dataclass(frozen=True)
class NominalGait:
    """Step of the undisturbed gait, canonical frame."""

    length: float  # L_nom [m]
    width: float  # W_nom, outward [m]
    duration: float  # T_nom [s]
    offset_x: float  # b_x,nom [m]
    offset_y: float  # b_y,nom [m]

    @property
    def offset(self) -> NDArray[np.float64]:
        """DCM at touchdown less the foothold, (2,) [m]."""
        return np.array([self.offset_x, self.offset_y])

    @property
    def row(self) -> NDArray[np.float64]:
        """The same as kernels take it, (5,)."""
        return np.array(dataclasses.astuple(self), dtype=np.float64)


@njit(cache=True)
def nominal_gait_kernel(
    velocity_x, velocity_y, pelvis_width, low, high, omega, touchdown_delay, nominal, double_support=0.0
):  # pragma: no cover
    """Write (L, W, T, b_x, b_y) into `nominal` (5,); `low`, `high` start with the bounds of L, W, T.

    A command too fast for the shortest step is followed as far as the step box goes.
    """
    period_max = high[DURATION] + touchdown_delay
    if velocity_x > 0.0:
        period_max = min(period_max, high[STEP] / velocity_x)
    elif velocity_x < 0.0:
        period_max = min(period_max, low[STEP] / velocity_x)
    if velocity_y != 0.0:
        room = max(0.0, min(high[STEP + 1] - pelvis_width, pelvis_width - low[STEP + 1]))
        period_max = min(period_max, room / abs(velocity_y))
    duration = max(low[DURATION], 0.5 * (low[DURATION] + period_max - touchdown_delay))
    period = duration + touchdown_delay
    length = min(max(velocity_x * period, low[STEP]), high[STEP])
    room = min(high[STEP + 1] - pelvis_width, pelvis_width - low[STEP + 1])
    sway = min(max(velocity_y * period, -room), room)
    growth = math.exp(omega * period)
    offset_x = length / (growth - 1.0)
    offset_y = sway / (growth - 1.0) - pelvis_width / (growth + 1.0)
    if double_support > 0.0:
        carried = growth * transfer_weight(0.0, double_support, omega)
        offset_x *= 1.0 - carried
        offset_y = sway * (1.0 - carried) / (growth - 1.0) - pelvis_width * (1.0 + carried) / (growth + 1.0)
    nominal[NOMINAL_STEP], nominal[NOMINAL_STEP + 1] = length, pelvis_width + sway
    nominal[NOMINAL_DURATION] = duration
    nominal[NOMINAL_DCM_OFFSET], nominal[NOMINAL_DCM_OFFSET + 1] = offset_x, offset_y


def nominal_gait(
    robot: RobotModel,
    limits: GaitLimits,
    velocity: ArrayLike = (0.0, 0.0),
    touchdown_delay: float = 0.0,
    double_support: float = 0.0,
) -> NominalGait:
    """Nominal gait for a commanded velocity.

    Args:
        robot: physical constants.
        limits: step box.
        velocity: commanded (v_x, v_y) in the canonical frame, (2,) [m/s].
        touchdown_delay: the new foot carries load this long after T [s].
        double_support: both feet stand for this long from touchdown on [s].

    Raises:
        InvalidValueError: for a velocity that is not two finite numbers, a pelvis wider than the step box or
            a double support longer than the shortest step.
    """
    command = np.asarray(velocity, dtype=np.float64)
    if command.shape != (2,) or not np.isfinite(command).all():
        raise InvalidValueError(f"velocity must be two finite numbers [m/s], got {velocity!r}")
    check_pelvis(robot, limits)
    check_double_support(double_support, limits)
    out = np.empty(NOMINAL_SIZE)
    nominal_gait_kernel(
        command[0], command[1], robot.pelvis_width, limits.low, limits.high, robot.omega, touchdown_delay,
        out, double_support,
    )  # fmt: skip
    return NominalGait(*(float(value) for value in out))


def check_pelvis(robot: RobotModel, limits: GaitLimits) -> None:
    """Raise unless the feet can stand l_p apart, which the in-place gait needs."""
    if not limits.width_min <= robot.pelvis_width <= limits.width_max:
        raise InvalidValueError(
            f"pelvis_width must lie within the step width [{limits.width_min}, {limits.width_max}] m, "
            f"got {robot.pelvis_width}"
        )
