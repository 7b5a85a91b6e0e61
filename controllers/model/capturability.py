"""Limits of recovery in closed form: of the DCM offset, and of a push.

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
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..array_table import tuple_reader
from ..errors import InvalidValueError
from ..jit import njit
from .gait_box import GaitLimits
from .nominal_gait import NominalGait, nominal_gait, step_start_dcm
from .robot import RobotModel

LOW, HIGH, BOUNDS = 0, 2, 4  # columns of the bounds of the DCM offset, pairs (x, y) [m], and their number


@dataclass(frozen=True)
class OffsetBounds:
    """Range of the DCM relative to the stance sole that can be recovered from, canonical frame."""

    low: NDArray[np.float64]  # (2,) [m]
    high: NDArray[np.float64]  # (2,) [m]


class CaptureConstants(NamedTuple):
    """Scalars of a robot and its step box for the compiled bounds."""

    omega: float  # [1/s]
    length_min: float  # [m]
    length_max: float  # [m]
    width_min: float  # [m]
    width_max: float  # [m]
    duration_min: float  # [s]
    duration_max: float  # [s]
    cop_x_max: float  # [m], 0 for a point foot
    cop_y_max: float  # [m]
    trunk_gain: float  # CMP per trunk acceleration, j / (m g) [m s^2]
    trunk_pitch_max: float  # largest trunk acceleration [rad/s^2]; 0 without a flywheel about the axis
    trunk_roll_max: float
    trunk_angle_max: float  # [rad]


constants_of = tuple_reader(CaptureConstants)


def capture_constants(
    robot: RobotModel, limits: GaitLimits, foot: bool = True, flywheel: bool = True
) -> NDArray[np.float64]:
    """`CaptureConstants` as an array.

    A point foot has no sole, no flywheel no torque, neither about an axis that the waist lacks.
    """
    torque_limit = robot.trunk_torque_max / robot.trunk_inertia
    pitch, roll = (min(torque_limit, most) * flywheel for most in limits.trunk_accelerations)
    box = {name: getattr(limits, name) for name in CaptureConstants._fields[1:7]}
    constants = CaptureConstants(
        omega=robot.omega,
        **box,
        cop_x_max=limits.cop_x_max * foot,
        cop_y_max=limits.cop_y_max * foot,
        trunk_gain=robot.cmp_per_trunk_acceleration,
        trunk_pitch_max=pitch,
        trunk_roll_max=roll,
        trunk_angle_max=robot.trunk_angle_max,
    )
    return np.array(constants)


@njit(cache=True)
def trunk_reserve(angle, rate, push, constants):  # pragma: no cover
    """B towards positive lean from a trunk state: discounted CMP shift of the fastest swing to theta_max [m].

    B = (j / (m g)) int omega exp(-omega s) theta'' ds: accelerate for t_1, brake for t_2, stop at
    theta_max. A trunk that cannot stop in time brakes all the way and ends at the stop.
    """
    omega, gain, limit = constants.omega, constants.trunk_gain, constants.trunk_angle_max
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
    c = constants_of(constants)
    omega = c.omega
    growth = math.exp(omega * c.duration_min)
    wide = (growth * c.width_max - c.width_min) / (growth * growth - 1.0)
    narrow = (growth * c.width_min - c.width_max) / (growth * growth - 1.0)
    slow = math.exp(omega * c.duration_max)
    if narrow > 0.0:
        wide = (c.width_max - c.width_min / slow) / (growth - 1.0 / slow)
        narrow = (c.width_min - wide) / slow
    soon = math.exp(-omega * max(c.duration_min - elapsed, 0.0))
    late = math.exp(-omega * max(c.duration_max - elapsed, 0.0))
    bounds[LOW] = soon * c.length_min * growth / (growth - 1.0)
    bounds[HIGH] = soon * c.length_max * growth / (growth - 1.0)
    inner = c.width_min - wide
    bounds[LOW + 1] = (soon if inner < 0.0 else late) * inner
    bounds[HIGH + 1] = soon * (c.width_max - narrow)
    cop_max, push = (c.cop_x_max, c.cop_y_max), (c.trunk_pitch_max, c.trunk_roll_max)
    for axis in range(2):
        bounds[LOW + axis] -= cop_max[axis] + trunk_reserve(-angle[axis], -rate[axis], push[axis], c)
        bounds[HIGH + axis] += cop_max[axis] + trunk_reserve(angle[axis], rate[axis], push[axis], c)


@njit(cache=True)
def capture_margin_kernel(elapsed, dcm, angle, rate, constants):  # pragma: no cover
    """Least distance of the DCM (2,) from its bounds [m]; negative outside."""
    bounds = np.empty(BOUNDS)
    offset_bounds_kernel(elapsed, angle, rate, constants, bounds)
    margin = np.inf
    for axis in range(2):
        margin = min(margin, dcm[axis] - bounds[LOW + axis], bounds[HIGH + axis] - dcm[axis])
    return margin


@njit(cache=True)
def transfer_margin_kernel(elapsed, left, other, dcm, angle, rate, constants):  # pragma: no cover
    """`capture_margin_kernel` of a robot whose other foot, at `other` (2,) [m], stands for `left` [s] more.

    What is left of double support lets the CoP stand as far as that foot, which moves the bounds by
    other (1 - exp(-omega left)).
    """
    bounds, margin = np.empty(BOUNDS), np.inf
    offset_bounds_kernel(elapsed, angle, rate, constants, bounds)
    reach = -math.expm1(-constants_of(constants).omega * left)
    for axis in range(2):
        low = bounds[LOW + axis] + reach * min(other[axis], 0.0)
        high = bounds[HIGH + axis] + reach * max(other[axis], 0.0)
        margin = min(margin, dcm[axis] - low, high - dcm[axis])
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
    angle, rate = pair("trunk_angle", trunk_angle), pair("trunk_rate", trunk_rate)
    bounds = np.empty(BOUNDS)
    offset_bounds_kernel(elapsed, angle, rate, capture_constants(robot, limits, foot, flywheel), bounds)
    return OffsetBounds(bounds[LOW : LOW + 2], bounds[HIGH : HIGH + 2])


def n_step_offset(
    robot: RobotModel,
    limits: GaitLimits,
    steps: int,
    elapsed: float = 0.0,
    *,
    foot: bool = True,
    flywheel: bool = True,
) -> OffsetBounds:
    """Bounds of the DCM from which at most `steps` steps bring it to where CoP and trunk alone catch it.

    The N-step capture basin of Koolen et al. (2012), Int. J. of Robotics Research 31, for a sole, a step box
    and an upright trunk. With lambda = exp(omega T_min) and r left until the earliest touchdown,

        x_N = f_x + B + exp(-omega r) L_max (1 + 1 / lambda + ... + 1 / lambda^(N - 1)),
        h_N = max(0, (w_max - g_(N-1)) / lambda),  g_N = min(0, (w_min - h_(N-1)) / lambda),  h_0 = g_0 = 0,

    and sideways f_y + B + h_N and -f_y - B + g_N, the first of the N steps with exp(-omega r) for 1 / lambda.
    It tends to `recoverable_offset` from within. Where the narrowest step is wider than c, that of a robot
    which has to step for ever, it is wider instead.

    Args:
        robot: physical constants.
        limits: step box and sole.
        steps: at most; 0: the foot stays.
        elapsed: since the step began [s].
        foot: whether the CoP may leave the centre of the sole.
        flywheel: whether the trunk may be accelerated.
    """
    c = constants_of(capture_constants(robot, limits, foot, flywheel))
    growth, soon = math.exp(c.omega * c.duration_min), math.exp(-c.omega * max(c.duration_min - elapsed, 0.0))
    low, high = np.zeros(2), np.zeros(2)  # without sole and trunk
    for left in range(steps, 0, -1):
        share = soon if left == 1 else 1.0 / growth
        ahead, back = c.length_max + high[0], c.length_min + low[0]
        wide, narrow = c.width_max - low[1], c.width_min - high[1]
        high = share * np.array([ahead, max(wide, 0.0)])
        low = share * np.array([back, min(narrow, 0.0)])
    still = np.array([c.cop_x_max, c.cop_y_max])
    still += [trunk_reserve(0.0, 0.0, push, c) for push in (c.trunk_pitch_max, c.trunk_roll_max)]
    return OffsetBounds(low - still, high + still)


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
    angle, rate = pair("trunk_angle", trunk_angle), pair("trunk_rate", trunk_rate)
    return float(capture_margin_kernel(elapsed, pair("dcm", dcm), angle, rate, constants))


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
    robot: RobotModel, psi: float, foot: bool, flywheel: bool, limits: GaitLimits | None,
    gait: NominalGait | None, reaction: float,
) -> float:  # fmt: skip
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


def pair(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Two finite numbers as an array (2,), or InvalidValueError with their name."""
    pair = np.asarray(value, dtype=np.float64)
    if pair.shape != (2,) or not np.isfinite(pair).all():
        raise InvalidValueError(f"{name} must be two finite numbers, got {value!r}")
    return pair
