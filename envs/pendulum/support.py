"""Where the pendulum's CoP may be: in the stance sole, and in the hull of both while both feet stand."""

from __future__ import annotations

from ...controllers.compiled.kernels import njit
from ...controllers.model.double_support import both_stand, nearest_in_hull, transfer_mean


@njit(cache=True)
def supported_cop(s, k, cop_x, cop_y, p):  # pragma: no cover
    """The CoP (world axes, from the stance sole) brought to the nearest point that the feet can bear."""
    if both_stand(s.time[k] - s.step_start[k], p.double_support):
        other_x, other_y = s.lift[k, 0] - s.stance[k, 0], s.lift[k, 1] - s.stance[k, 1]
        return nearest_in_hull(cop_x, cop_y, other_x, other_y, p.half_length, p.half_width)
    return (
        min(max(cop_x, -p.half_length), p.half_length),
        min(max(cop_y, -p.half_width), p.half_width),
    )


@njit(cache=True)
def transferred_cop(s, k, left, p):  # pragma: no cover
    """CoP of no action's, for the next `left` seconds or the rest of double support: the transfer's mean."""
    elapsed = s.time[k] - s.step_start[k]
    if left <= 0.0 or not both_stand(elapsed, p.double_support):
        return 0.0, 0.0
    share = transfer_mean(elapsed, min(left, p.double_support - elapsed), p.double_support, p.omega)
    return share * (s.lift[k, 0] - s.stance[k, 0]), share * (s.lift[k, 1] - s.stance[k, 1])
