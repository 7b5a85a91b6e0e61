"""When a push starts, and the exact share of its force in any interval; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit
from ...controllers.model.frame import heading_frame, in_world


@njit(cache=True)
def resolve_starts(
    start: NDArray[np.float64],
    step: NDArray[np.int64],
    fraction: NDArray[np.float64],
    step_index: int,
    step_start: float,
    planned_duration: float,
    t0: float,
    t1: float,
) -> None:
    """Write the start times of the gait events that come within [t0, t1) into `start`, in place.

    start = max(t0, step_start + fraction * planned_duration) in the event's step, t0 if that step is over.
    `step_index` and `step_start` [s] are those of the present step, `planned_duration` its planned T [s].
    """
    for i in range(start.shape[0]):
        if step[i] < 0 or start[i] != np.inf or step_index < step[i]:
            continue
        moment = step_start + fraction[i] * planned_duration if step_index == step[i] else t0
        if moment < t1:
            start[i] = max(t0, moment)


@njit(cache=True)
def turn_forces(
    force: NDArray[np.float64],
    frame: NDArray[np.int64],
    start: NDArray[np.float64],
    heading: float,
    t1: float,
) -> None:
    """Turn forces in the heading's frame by the heading [rad] where their push starts before t1, in place.

    They are in the world's frame from then on: F_world = R_z(heading) F.
    """
    for i in range(start.shape[0]):
        if frame[i] == 0 or start[i] >= t1:
            continue
        force[i, 0], force[i, 1] = in_world(heading_frame(heading), force[i, 0], force[i, 1])
        frame[i] = 0


@njit(cache=True)
def overlap(start: float, duration: float, t0: float, t1: float) -> float:
    """Length of [start, start + duration] within [t0, t1] [s]; PENDING starts give 0."""
    return max(0.0, min(t1, start + duration) - max(t0, start))


@njit(cache=True)
def mean_force(
    force: NDArray[np.float64],
    duration: NDArray[np.float64],
    start: NDArray[np.float64],
    index: int,
    t0: float,
    t1: float,
    out: NDArray[np.float64],
) -> bool:
    """Write the force of push `index` averaged over [t0, t1] into `out` (3,) [N]; True where it is not zero.

    mean = F * |[start, start + d] and [t0, t1]| / (t1 - t0), so that the sum of mean * (t1 - t0) over any
    partition of time is F d exactly (to rounding), at every control rate.
    """
    share = overlap(start[index], duration[index], t0, t1) / (t1 - t0)
    for axis in range(3):
        out[axis] = force[index, axis] * share
    return share > 0.0
