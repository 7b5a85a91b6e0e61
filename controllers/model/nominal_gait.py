"""The nominal gait of a commanded velocity, with or without double support; canonical frame.

By the mid-range rule the step period P is the middle of the range that the step box leaves for the commanded
velocity; the DCM offset is that of the two-step periodic gait of the linear inverted pendulum (Khadiv et al.
2016, section III):

    L = v_x P,    W = l_p + v_y P,    P = T + touchdown_delay,    lambda = exp(omega P),
    b_x = L / (lambda - 1),    b_y = v_y P / (lambda - 1) - l_p / (lambda + 1).

A velocity towards the swing side widens this step and narrows the next. Sideways the range of P ends at
min(W_max - l_p, l_p - W_min) / |v_y|, not at the published W_max / |v_y|: of two steps one is l_p + v_y P
wide and the other l_p - v_y P, and both have to lie in the box. With the paper's limits (0.1 to 0.4 m,
l_p = 0.2 m) and v_y = 0.2 m/s that gives T = 0.40 s with steps of 0.28 and 0.12 m; the published rule gives
0.65 s, whose narrow step, 0.07 m, the box forbids.

In double support, the first d seconds after a touchdown, the foot that stood before still stands at p and the
CoP may be anywhere in the hull of both soles: their bounding box less two corners, which a strip along p cuts
off. The undisturbed CoP goes linearly from p to the new sole's centre, z(s) = p (1 - s/d). From time t on it
moves the DCM as one CoP would that is held for ever at p kappa(t), r = max(d - t, 0):

    kappa(t) = int_t^d omega exp(-omega (s - t)) (1 - s/d) ds = r/d - (1 - exp(-omega r)) / (omega d)

    xi(T) = exp(omega (T - t)) (xi(t) - p kappa(t)) + p kappa(T)

so that the transfer is a constant shift of the DCM. With c = kappa(0) it changes the nominal gait to

    b_x = L (1 - lambda c) / (lambda - 1),
    b_y = v_y P (1 - lambda c) / (lambda - 1) - l_p (1 + lambda c) / (lambda + 1),

and the DCM at the start of a step, which is the offset of the step before in this step's mirrored frame, is

    xi_0 = (b_x, (W - l_p) (1 - lambda c) / (lambda - 1) + l_p (1 + lambda c) / (lambda + 1)).

Less p c it drifts to the nominal step's end, u_T + b = lambda (xi_0 - p c).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..jit import njit
from .gait_box import COP, DURATION, GAIT_SIZE, STEP, GaitLimits
from .observation import ELAPSED, SWING_POSITION
from .robot import RobotModel

INSTANT = 1e-9  # less double support than this is over [s]

# Columns of a nominal gait (5,); of a pair (x, y) the first one
NOMINAL_STEP = 0  # pair, L, W [m]
NOMINAL_DURATION = 2  # T [s]
NOMINAL_DCM_OFFSET = 3  # pair, b_x, b_y [m]
NOMINAL_SIZE = 5


def check_double_support(double_support: float, limits: GaitLimits) -> None:
    """Raise InvalidValueError unless even the shortest step has a single support."""
    if not 0.0 <= double_support < limits.duration_min:
        raise InvalidValueError(
            f"double_support must be >= 0 and shorter than the shortest step, {limits.duration_min} s, "
            f"got {double_support}"
        )


@njit(cache=True)
def both_stand(elapsed: float, double_support: float) -> bool:
    """Whether a step that began `elapsed` seconds ago is in double support; a standing robot always is."""
    return elapsed < 0.0 or (double_support > 0.0 and double_support - elapsed > INSTANT)


@njit(cache=True)
def transfer_weight(elapsed: float, double_support: float, omega: float) -> float:
    """kappa(t): the rest of the transfer counts as a CoP at p kappa held for ever."""
    if elapsed < 0.0 or not both_stand(elapsed, double_support):
        return 0.0
    left = min(double_support - elapsed, double_support)
    return left / double_support + math.expm1(-omega * left) / (omega * double_support)


@njit(cache=True)
def transfer_mean(elapsed: float, span: float, double_support: float, omega: float) -> float:
    """The share of p that, held for `span` [s], moves the DCM as the transfer does in that time.

    (kappa(t) - exp(-omega h) kappa(t + h)) / (1 - exp(-omega h)); a plan in steps that follows it ends every
    step at the nominal DCM exactly.
    """
    before = transfer_weight(elapsed, double_support, omega)
    if before == 0.0:
        return 0.0
    decay = math.exp(-omega * span)
    return (before - decay * transfer_weight(elapsed + span, double_support, omega)) / (1.0 - decay)


@njit(cache=True)
def box_around(sole_low: float, sole_high: float, other: float) -> tuple[float, float]:
    """Bounds along one axis of the box about a sole and its equal at `other`."""
    return sole_low + min(other, 0.0), sole_high + max(other, 0.0)


@njit(cache=True)
def strip(
    other_x: float, other_y: float, half_x: float, half_y: float
) -> tuple[float, float, float]:  # pragma: no cover
    """Unit normal n (2) and half width of the strip |n . z| <= half width that both soles span [m]."""
    length = math.hypot(other_x, other_y)
    if length == 0.0:
        return 0.0, 1.0, half_y
    normal_x, normal_y = -other_y / length, other_x / length
    return normal_x, normal_y, abs(normal_x) * half_x + abs(normal_y) * half_y


@njit(cache=True)
def nearest_in_hull(
    x: float, y: float, other_x: float, other_y: float, half_x: float, half_y: float
) -> tuple[float, float]:
    """The point of the hull of both soles nearest to a point of their bounding box.

    What lies outside the bounding box is brought to it first. A corner that the strip cuts off is a right
    triangle on the strip's edge, so that the way straight to the edge ends within the hull.
    """
    low, high = box_around(-half_x, half_x, other_x)
    x = min(max(x, low), high)
    low, high = box_around(-half_y, half_y, other_y)
    y = min(max(y, low), high)
    normal_x, normal_y, half = strip(other_x, other_y, half_x, half_y)
    over = normal_x * x + normal_y * y
    over -= min(max(over, -half), half)
    return x - over * normal_x, y - over * normal_y


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
    return NominalGait(*out.tolist())


def check_pelvis(robot: RobotModel, limits: GaitLimits) -> None:
    """Raise unless the feet can stand l_p apart, which the in-place gait needs."""
    if not limits.width_min <= robot.pelvis_width <= limits.width_max:
        raise InvalidValueError(
            f"pelvis_width must lie within the step width [{limits.width_min}, {limits.width_max}] m, "
            f"got {robot.pelvis_width}"
        )


class NominalStart(NamedTuple):
    """Canonical frame of the step that begins."""

    com: NDArray[np.float64]  # (2,) [m]
    com_velocity: NDArray[np.float64]  # (2,) [m/s]
    swing: NDArray[np.float64]  # (2,) where the foot that swings now stood, [m]


@njit(cache=True)
def step_start_dcm_kernel(nominal, pelvis_width, omega, delay, double_support):  # pragma: no cover
    """xi_0 of a nominal gait (5,), two numbers [m]."""
    growth = math.exp(omega * (nominal[NOMINAL_DURATION] + delay))
    carried = growth * transfer_weight(0.0, double_support, omega)
    sway = (nominal[NOMINAL_STEP + 1] - pelvis_width) * (1.0 - carried)
    start_y = sway / (growth - 1.0) + pelvis_width * (1.0 + carried) / (growth + 1.0)
    return nominal[NOMINAL_DCM_OFFSET], start_y


@njit(cache=True)
def drifting_dcm_kernel(nominal, omega, delay):  # pragma: no cover
    """xi_0 - p c = (u_T + b) / lambda of a nominal gait (5,), two numbers [m]."""
    decay = math.exp(-omega * (nominal[NOMINAL_DURATION] + delay))
    end_x = nominal[NOMINAL_STEP] + nominal[NOMINAL_DCM_OFFSET]
    end_y = nominal[NOMINAL_STEP + 1] + nominal[NOMINAL_DCM_OFFSET + 1]
    return end_x * decay, end_y * decay


def step_start_dcm(
    gait: NominalGait, pelvis_width: float, omega: float, delay: float = 0.0, double_support: float = 0.0
) -> tuple[float, float]:
    """xi_0 of a nominal gait, canonical frame [m]; arguments as for `nominal_start`."""
    timing = float(omega), float(delay), float(double_support)
    return step_start_dcm_kernel(gait.row, float(pelvis_width), *timing)


def nominal_start(
    gait: NominalGait, pelvis_width: float, omega: float, delay: float = 0.0, double_support: float = 0.0
) -> NominalStart:
    """CoM, its velocity and the swing foot at the start of a step of `gait`.

    With e = exp(omega P), P = T + delay, and the stance at 0: com(P) = xi_0 (e - 1/e) / 2 + com_0 / e.
    Sagittally com(P) = com_0 + L; laterally this step of width W and the next one of 2 l_p - W take turns,
    and the frame is mirrored between them: com_next = W - com(P). Double support of d seconds, with the other
    foot at p, c = kappa(0) and sigma = sinh(omega d) / (omega d) - 1, makes it

        com(P) = (xi_0 - p c) (e - 1/e) / 2 + (com_0 + p sigma) / e.

    Args:
        gait: nominal gait of this step.
        pelvis_width: l_p [m].
        omega: natural frequency [1/s].
        delay: the new foot carries load this long after T [s].
        double_support: both feet stand for this long from touchdown on [s].
    """
    growth = math.exp(omega * (gait.duration + delay))
    spread = 0.5 * (growth - 1.0 / growth)
    other_width = 2.0 * pelvis_width - gait.width
    carried = sigma = 0.0
    if double_support > 0.0:
        carried = transfer_weight(0.0, double_support, omega)
        sigma = math.sinh(omega * double_support) / (omega * double_support) - 1.0
    other_gait = dataclasses.replace(gait, width=other_width)  # sideways; its DCM along x is not used
    dcm = np.array(step_start_dcm(gait, pelvis_width, omega, delay, double_support))
    _, other_dcm_y = step_start_dcm(other_gait, pelvis_width, omega, delay, double_support)
    com_x = (dcm[0] + gait.length * carried) * spread - gait.length - gait.length * sigma / growth
    com_x /= 1.0 - 1.0 / growth
    # y0' = W - spread (xi - W' c) - (y0 + W' sigma) / e, and the same with the primes exchanged
    this = gait.width - spread * (dcm[1] - other_width * carried) - other_width * sigma / growth
    other = other_width - spread * (other_dcm_y - gait.width * carried) - gait.width * sigma / growth
    com_y = (other - this / growth) / (1.0 - 1.0 / growth**2)
    com = np.array([com_x, com_y])
    return NominalStart(com, omega * (dcm - com), np.array([-gait.length, other_width]))


def standing_start(pelvis_width: float, stride: float = 0.0) -> NominalStart:
    """A robot at rest on two feet, l_p [m] apart, the other one `stride` [m] ahead; its CoM between them."""
    side = np.array([stride, pelvis_width])
    return NominalStart(0.5 * side, np.zeros(2), side)


@njit(cache=True)
def cop_range(
    axis: int, obs: Any, low: Any, high: Any, double_support: float
) -> tuple[float, float]:  # pragma: no cover
    """Meaning of -1 and 1 in the action's CoP entry of an axis at an observation (36,) [m].

    The sole; while both feet stand, the bounding box of both soles. Planner and environment both use it.
    """
    if both_stand(obs[ELAPSED], double_support):
        return box_around(low[COP + axis], high[COP + axis], obs[SWING_POSITION.start + axis])
    return low[COP + axis], high[COP + axis]


@njit(cache=True)
def _widen(observations: Any, actions: Any, low: Any, high: Any, double_support: float, gaits: Any) -> None:
    for i in range(observations.shape[0]):
        if not both_stand(observations[i, ELAPSED], double_support):
            continue
        for axis in range(2):
            bottom, top = cop_range(axis, observations[i], low, high, double_support)
            share = 0.5 * (min(max(actions[i, COP + axis], -1.0), 1.0) + 1.0)
            gaits[i, COP + axis] = bottom + share * (top - bottom)


def gaits_of_actions(
    limits: GaitLimits, observations: NDArray[np.float64], actions: NDArray[Any], double_support: float
) -> NDArray[np.float64]:
    """Gait variables (n, 7) of actions (n, 7) at observations (n, 36), the CoP being that of `cop_range`."""
    gaits = limits.from_action(actions)
    if double_support > 0.0 or (observations[:, ELAPSED] < 0.0).any():
        asked = np.asarray(actions, dtype=np.float64)
        _widen(observations, asked, limits.low, limits.high, double_support, gaits)
    return gaits


@njit(cache=True)
def scale_action(gait, obs, low, high, double_support, action):  # pragma: no cover
    """Gait variables (7,) as a float32 action (7,); the arithmetic of `GaitLimits.to_action`.

    They are scaled from the box `low` to `high` (7,), the CoP from `cop_range`. An entry without a range, the
    trunk's about an axis that the waist lacks, is 0.
    """
    for j in range(GAIT_SIZE):
        bottom, top = low[j], high[j]
        if j == COP or j == COP + 1:
            bottom, top = cop_range(j - COP, obs, low, high, double_support)
        if top > bottom:
            scaled = 2.0 * (gait[j] - bottom) / (top - bottom) - 1.0
            action[j] = min(max(scaled, -1.0), 1.0)
        else:
            action[j] = 0.0
