"""The residual on a gait action: its scale and the one place where base and residual are added."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError, shown
from ..model.gait_box import GAIT_NAMES, GAIT_SIZE, GaitLimits

# What a learned correction of 1 means at factor 1, in the units of GAIT_NAMES: [m], [m], [s], [m], [m],
# [rad/s^2], [rad/s^2].
PHYSICAL_SCALE = (0.12, 0.10, 0.15, 0.06, 0.03, 12.0, 12.0)
DEFAULT_FACTOR = 1.0


def default_residual_scale(limits: GaitLimits, factor: float = DEFAULT_FACTOR) -> NDArray[np.float32]:
    """Residual scale (7,) in action units: factor x PHYSICAL_SCALE x 2 / (high - low).

    It is 0 for an entry without a range.

    Args:
        limits: The gait box onto which the actions in [-1, 1] are scaled.
        factor: Multiplies every entry [-], >= 0.

    Raises:
        InvalidValueError: The factor is negative or not finite.
    """
    if not (math.isfinite(factor) and factor >= 0):
        raise InvalidValueError(f"residual factor must be finite and >= 0, got {factor}")
    physical = factor * np.asarray(PHYSICAL_SCALE)
    span = limits.high - limits.low
    scale = physical * 2.0 / np.where(span > 0.0, span, np.inf)
    return np.asarray(scale, dtype=np.float32)


def check_residual_scale(scale: ArrayLike) -> NDArray[np.float32]:
    """A residual scale as (7,) float32 in action units; one number stands for all seven.

    Raises:
        InvalidValueError: Not 1 or 7 numbers, or an entry is negative or not finite.
    """
    try:
        values = np.asarray(scale, dtype=np.float32)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(
            f"residual scale must be 1 or {GAIT_SIZE} numbers, got {shown(scale)}"
        ) from None
    if values.shape not in {(), (GAIT_SIZE,)}:
        raise InvalidValueError(
            f"residual scale must be one number or {GAIT_SIZE} ({', '.join(GAIT_NAMES)}), "
            f"got shape {values.shape}"
        )
    if not (np.all(np.isfinite(values)) and np.all(values >= 0)):
        raise InvalidValueError(
            f"residual scale must be finite and >= 0 in every entry, got {values.tolist()}"
        )
    return np.array(np.broadcast_to(values, (GAIT_SIZE,)))


def compose(
    base: NDArray[np.float32], residual: NDArray[np.float32], scale: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Total action: clip(base + scale x residual, -1, 1), and the base's own bits where that residual is 0.

    Args:
        base: Actions of the wrapped policy, (..., 7).
        residual: Learned actions in [-1, 1], (..., 7).
        scale: Scale per entry in action units, (7,).
    """
    shift = scale * residual
    total = np.clip(base + shift, np.float32(-1.0), np.float32(1.0))
    return np.where(shift == 0.0, base, total)
