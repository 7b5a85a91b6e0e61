"""What can be recovered from at all: closed-form limits of the DCM offset, and of a push.

Let c be the largest and d the smallest lateral DCM (towards the swing side) at the start of a step from which
the widest and narrowest steps at T_min still alternate for ever, and lambda = exp(omega T_min):

    c = (w_max - d) / lambda,  d = (w_min - c) / lambda,  so that
    c = (lambda w_max - w_min) / (lambda^2 - 1).

Where d comes out positive a slower step is better: d = (w_min - c) / exp(omega T_max). Sagittally the limit
is L_max / (lambda - 1). With r left until the earliest touchdown, a state may be recovered from if

    xi_x <= exp(-omega r) L_max lambda / (lambda - 1) + f_x + B,
    xi_y <= exp(-omega r) (w_max - d) + f_y + B,       xi_y >= exp(-omega r) (w_min - c) - f_y - B,

(mirrored for -x), where f is half the sole and B what the trunk gives once, by its fastest swing to
theta_max: B = (tau_max / (m g)) (1 - exp(-omega sqrt(theta_max j / tau_max)))^2 from rest. A push F at the
start of a step counts as a shift of the DCM by F (1 - exp(-omega dt)) / (m omega^2). Of controllers that act
only after a reaction time t_r, f and B are worth exp(-omega t_r) as much. Derived in docs/limits.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError
from .gait_box import GaitLimits
from .nominal_gait import NominalGait, nominal_gait
from .nominal_start import step_start_dcm
from .robot import RobotModel


@dataclass(frozen=True)
class OffsetBounds:
    """Range of the DCM relative to the stance sole that can be recovered from, canonical frame."""

    low: NDArray[np.float64]  # (2,) [m]
    high: NDArray[np.float64]  # (2,) [m]


def capture_constants(
    robot: RobotModel, limits: GaitLimits, foot: bool = True, flywheel: bool = True
) -> NDArray[np.float64]:
    """Pack what the kernels need: omega, step box (6), half sole (2), trunk (3).

    A point foot has no sole, no flywheel no torque.
    """
    return np.array(
        [robot.omega, limits.length_min, limits.length_max, limits.width_min, limits.width_max,
         limits.duration_min, limits.duration_max, limits.cop_x_max * foot, limits.cop_y_max * foot,
         robot.cmp_per_trunk_acceleration,
         min(robot.trunk_torque_max / robot.trunk_inertia, limits.trunk_acceleration_max) * flywheel,
         robot.trunk_angle_max]
    )  # fmt: skip


@njit(cache=True)
def trunk_reserve(angle, rate, constants):  # pragma: no cover
    """B towards positive lean from a trunk state: discounted CMP shift of the fastest swing to theta_max [m].

    B = (j / (m g)) int omega exp(-omega s) theta'' ds: accelerate for t_1, brake for t_2, stop at
    theta_max. A trunk that cannot stop in time brakes all the way and ends at the stop.
    """
    omega, gain, push, limit = constants[0], constants[9], constants[10], constants[11]
    if push <= 0.0:
        return 0.0
    top = math.sqrt(max(push * (limit - angle) + 0.5 * rate * rate, 0.0))
    t_1 = (top - rate) / push
    if t_1 >= 0.0:
        decay = math.exp(-omega * t_1)
        return gain * push * (1.0 - decay * (2.0 - math.exp(-omega * top / push)))
    end = math.sqrt(max(rate * rate - 2.0 * push * max(limit - angle, 0.0), 0.0))
    decay = math.exp(-omega * (rate - end) / push)
    return -gain * (push * (1.0 - decay) + omega * decay * end)


@njit(cache=True)
def offset_bounds_kernel(elapsed, angle, rate, constants, bounds):  # pragma: no cover
    """Write (low_x, low_y, high_x, high_y) [m] for a time since the step began and a trunk state."""
    omega = constants[0]
    growth = math.exp(omega * constants[5])
    wide = (growth * constants[4] - constants[3]) / (growth * growth - 1.0)
    narrow = (growth * constants[3] - constants[4]) / (growth * growth - 1.0)
    slow = math.exp(omega * constants[6])
    if narrow > 0.0:
        wide = (constants[4] - constants[3] / slow) / (growth - 1.0 / slow)
        narrow = (constants[3] - wide) / slow
    soon = math.exp(-omega * max(constants[5] - elapsed, 0.0))
    late = math.exp(-omega * max(constants[6] - elapsed, 0.0))
    bounds[0] = soon * constants[1] * growth / (growth - 1.0)
    bounds[2] = soon * constants[2] * growth / (growth - 1.0)
    inner = constants[3] - wide
    bounds[1] = (soon if inner < 0.0 else late) * inner
    bounds[3] = soon * (constants[4] - narrow)
    for axis in range(2):
        bounds[axis] -= constants[7 + axis] + trunk_reserve(-angle[axis], -rate[axis], constants)
        bounds[2 + axis] += constants[7 + axis] + trunk_reserve(angle[axis], rate[axis], constants)


@njit(cache=True)
def capture_margin_kernel(elapsed, dcm, angle, rate, constants):  # pragma: no cover
    """Least distance of the DCM (2,) from its bounds [m]; negative outside."""
    bounds = np.empty(4)
    offset_bounds_kernel(elapsed, angle, rate, constants, bounds)
    margin = np.inf
    for axis in range(2):
        margin = min(margin, dcm[axis] - bounds[axis], bounds[2 + axis] - dcm[axis])
    return margin


def recoverable_offset(
    robot: RobotModel,
    limits: GaitLimits,
    elapsed: float = 0.0,
    trunk_angle: ArrayLike = (0.0, 0.0),
    trunk_rate: ArrayLike = (0.0, 0.0),
    *,
    foot: bool = True,
    flywheel: bool = True,
) -> OffsetBounds:
    """Bounds of the DCM relative to the stance sole, canonical frame.

    Args:
        robot: physical constants.
        limits: step box and sole.
        elapsed: since the step began [s].
        trunk_angle: lean (2,) [rad].
        trunk_rate: (2,) [rad/s].
        foot: whether the CoP may leave the centre of the sole.
        flywheel: whether the trunk may be accelerated.
    """
    angle, rate = _pair("trunk_angle", trunk_angle), _pair("trunk_rate", trunk_rate)
    bounds = np.empty(4)
    offset_bounds_kernel(elapsed, angle, rate, capture_constants(robot, limits, foot, flywheel), bounds)
    return OffsetBounds(bounds[:2], bounds[2:])


def capture_margin(
    robot: RobotModel,
    limits: GaitLimits,
    elapsed: float,
    dcm: ArrayLike,
    trunk_angle: ArrayLike = (0.0, 0.0),
    trunk_rate: ArrayLike = (0.0, 0.0),
    *,
    foot: bool = True,
    flywheel: bool = True,
) -> float:
    """Distance of the DCM from the nearest bound of `recoverable_offset` [m]; negative: beyond recovery."""
    constants = capture_constants(robot, limits, foot, flywheel)
    angle, rate = _pair("trunk_angle", trunk_angle), _pair("trunk_rate", trunk_rate)
    return float(capture_margin_kernel(elapsed, _pair("dcm", dcm), angle, rate, constants))


def max_recoverable_force(
    robot: RobotModel,
    psi: float,
    duration: float = 0.1,
    foot: bool = True,
    flywheel: bool = True,
    *,
    limits: GaitLimits | None = None,
    gait: NominalGait | None = None,
    reaction: float = 0.0,
) -> float:
    """F*(psi): the largest push at the start of a left stance that any controller can recover from [N].

    It is reached where the narrowest step w_min is below c, the widest DCM that a step may start with, as
    with the paper's limits (docs/limits.md). Where w_min > c it is an upper bound only: in one such box it is
    216 N while the linear program of `trajectory_program` finds 177 N.

    Args:
        robot: physical constants.
        psi: direction, counter-clockwise from forward [rad].
        duration: of the push [s].
        foot: whether the CoP may leave the centre of the sole.
        flywheel: whether the trunk may be accelerated.
        limits: step box; the paper's by default.
        gait: nominal gait of the left stance (y to the right); in place by default.
        reaction: CoP and trunk stay nominal this long after the push began, the step is free: the limit of
            controllers that act no earlier. At most the duration of the nominal step [s].

    Returns:
        0 where the nominal gait itself lies outside the bounds.
    """
    if not (math.isfinite(psi) and math.isfinite(duration) and duration > 0):
        raise InvalidValueError(f"psi [rad] must be finite and duration [s] positive, got {psi}, {duration}")
    shift = _max_recoverable_shift(robot, psi, foot, flywheel, limits, gait, reaction)
    return float(shift * robot.mass * robot.omega**2 / -math.expm1(-robot.omega * duration))


def max_recoverable_impulse(
    robot: RobotModel,
    psi: float,
    foot: bool = True,
    flywheel: bool = True,
    *,
    limits: GaitLimits | None = None,
    gait: NominalGait | None = None,
    reaction: float = 0.0,
) -> float:
    """J*(psi): the largest impulse, as a velocity jump J / m at the start of a left stance [N s].

    It is the limit of F* x duration for ever shorter pushes, J = m omega x shift of the DCM. Arguments as
    for `max_recoverable_force`.
    """
    if not math.isfinite(psi):
        raise InvalidValueError(f"psi must be finite [rad], got {psi}")
    shift = _max_recoverable_shift(robot, psi, foot, flywheel, limits, gait, reaction)
    return float(shift * robot.mass * robot.omega)


def _max_recoverable_shift(
    robot: RobotModel,
    psi: float,
    foot: bool,
    flywheel: bool,
    limits: GaitLimits | None,
    gait: NominalGait | None,
    reaction: float,
) -> float:
    """How far a push along psi may shift the DCM at the start of a left stance [m].

    Inputs that are nominal for r let the offset grow by exp(omega r), so the bounds at r hold for it then.
    """
    limits = GaitLimits.of(robot) if limits is None else limits
    gait = nominal_gait(robot, limits) if gait is None else gait
    if not 0.0 <= reaction <= gait.duration:
        raise InvalidValueError(
            f"reaction must lie within the nominal step, [0, {gait.duration:g}] s, got {reaction}"
        )
    bounds = recoverable_offset(robot, limits, reaction, foot=foot, flywheel=flywheel)
    decay = math.exp(-robot.omega * reaction)
    start = step_start_dcm(gait, robot.pelvis_width, robot.omega)
    shift = math.inf
    for axis, share in enumerate((math.cos(psi), -math.sin(psi))):
        high, low = decay * bounds.high[axis], decay * bounds.low[axis]
        room = high - start[axis] if share > 0 else start[axis] - low
        if abs(share) > 1e-12:
            shift = min(shift, max(room, 0.0) / abs(share))
    return shift


def _pair(name: str, value: ArrayLike) -> NDArray[np.float64]:
    pair = np.asarray(value, dtype=np.float64)
    if pair.shape != (2,) or not np.isfinite(pair).all():
        raise InvalidValueError(f"{name} must be two finite numbers, got {value!r}")
    return pair
