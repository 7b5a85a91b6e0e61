"""From gait variables to actions in compiled code; the way back is `double_support.gaits_of_actions`."""

from __future__ import annotations

from ..compiled.kernels import njit
from .double_support import cop_range
from .gait_box import COP, GAIT_SIZE


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
