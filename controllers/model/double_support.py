"""Double support: the transfer of the CoP, the hull of both soles, and gaits as actions.

Double support: the transfer of the CoP, the hull of both soles, and what an action means while both stand.

A step begins at touchdown. For the first d seconds the foot that stood before still stands at p (canonical
frame: the origin is the new stance sole's centre) and the CoP may be anywhere in the hull of both soles. The
undisturbed CoP goes linearly from p to the origin, z(s) = p (1 - s/d). From time t on it moves the DCM as one
CoP would that is held for ever at p kappa(t), r = max(d - t, 0):

    kappa(t) = int_t^d omega exp(-omega (s - t)) (1 - s/d) ds = r/d - (1 - exp(-omega r)) / (omega d)

    xi(T) = exp(omega (T - t)) (xi(t) - p kappa(t)) + p kappa(T)

so that the transfer is a constant shift of the DCM. The hull of two equal soles is their bounding box less
two corners, which a strip along p cuts off.

From gait variables to actions in compiled code; the way back is `double_support.gaits_of_actions`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidValueError
from ..jit import njit
from .gait_box import COP, GAIT_SIZE, GaitLimits
from .observation import ELAPSED, SWING_POSITION

INSTANT = 1e-9  # less double support than this is over [s]
_SWING = SWING_POSITION.start


def check_double_support(double_support: float, limits: GaitLimits) -> None:
    """Raise InvalidValueError unless even the shortest step has a single support."""
    if not 0.0 <= double_support < limits.duration_min:
        raise InvalidValueError(
            f"double_support must be >= 0 and shorter than the shortest step, {limits.duration_min} s, "
            f"got {double_support}"
        )


@njit(cache=True)
def both_stand(elapsed: float, double_support: float) -> bool:
    """Whether a step that began `elapsed` seconds ago is in double support."""
    return double_support > 0.0 and double_support - elapsed > INSTANT


@njit(cache=True)
def transfer_weight(elapsed: float, double_support: float, omega: float) -> float:
    """kappa(t): the rest of the transfer counts as a CoP at p kappa held for ever."""
    if not both_stand(elapsed, double_support):
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


@njit(cache=True)
def cop_range(
    axis: int, obs: Any, low: Any, high: Any, double_support: float
) -> tuple[float, float]:  # pragma: no cover
    """What -1 and 1 of the action's CoP entry of an axis mean at an observation (36,) [m].

    The sole; while both feet stand, the bounding box of both soles. Planner and environment both use it.
    """
    if both_stand(obs[ELAPSED], double_support):
        return box_around(low[COP + axis], high[COP + axis], obs[_SWING + axis])
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
    """Gait variables (n, 7) that actions (n, 7) mean at observations (n, 36): `from_action`, but for the CoP.

    Args:
        limits: of the action.
        observations: at which the actions are taken.
        actions: in [-1, 1], clipped.
        double_support: d [s].
    """
    gaits = limits.from_action(actions)
    if double_support > 0.0:
        asked = np.asarray(actions, dtype=np.float64)
        _widen(observations, asked, limits.low, limits.high, double_support, gaits)
    return gaits


@njit(cache=True)
def scale_action(gait, obs, low, high, double_support, action):  # pragma: no cover
    """Gait variables (7,) as a float32 action (7,); the arithmetic of `GaitLimits.to_action`.

    The CoP is scaled from what it may be at the observation, see `cop_range`. An entry without a range, the
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


@njit(cache=True, nogil=True)
def scale_actions(gaits, observations, box, double_support, actions):  # pragma: no cover
    """`scale_action` of every row, whose first seven columns are gait variables, into actions (n, 7)."""
    for i in range(gaits.shape[0]):
        scale_action(gaits[i], observations[i], box[0], box[1], double_support, actions[i])
