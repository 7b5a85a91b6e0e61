"""Reward terms under joint targets: those of the gait that need no plan, and what makes a gait of targets.

Named, pure, one number each per planning period, as those of `episode.reward`, whose `alive`, `fall`, `dcm`,
`margin` and `trunk` are taken over. `swing` pays for a foot that rises and comes down in the time of the
nominal step (as the feet's phase in MuJoCo Playground's gaits), and for nothing when no step comes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit
from ...controllers.model.gait_box import DURATION
from ...controllers.model.observation import COM_VELOCITY, COMMAND, ELAPSED, HEADING_ERROR, SWING_POSITION
from ..episode.reward import REWARD_TERMS

Array = NDArray[np.float64]

FROM_GAIT = ("alive", "fall", "dcm", "margin", "trunk")
JOINT_REWARD_TERMS = (*FROM_GAIT, "velocity", "heading", "swing", "effort", "smoothness")
TAKEN = np.array([REWARD_TERMS.index(name) for name in FROM_GAIT])
OWN = len(FROM_GAIT)  # where the terms begin that are made here

_VELOCITY, _COMMAND, _SWING_HEIGHT = COM_VELOCITY.start, COMMAND.start, SWING_POSITION.start + 2
LATE = 1.25  # share of the nominal step from which a swing foot earns nothing
CLEARANCE = 0.02  # error of the swing foot's height at which its reward has fallen to 1/e [m]


@njit(cache=True)
def velocity(obs, failed):  # pragma: no cover
    """exp(-|v - v_command|^2 / (0.5 m/s)^2), v the CoM's."""
    squared = (obs[_VELOCITY] - obs[_COMMAND]) ** 2 + (obs[_VELOCITY + 1] - obs[_COMMAND + 1]) ** 2
    return 0.0 if failed else math.exp(-squared / 0.25)


@njit(cache=True)
def heading(obs):  # pragma: no cover
    """-(yaw of the pelvis over the heading [rad])^2, at least -1."""
    return max(-(obs[HEADING_ERROR] ** 2), -1.0)


@njit(cache=True)
def swing(obs, duration, apex, failed):  # pragma: no cover
    """exp(-(z - apex sin(pi t / T))^2 / CLEARANCE^2) until T, z = 0 until 1.25 T, nothing later.

    z is the height of the swing sole, t the time in the step, T the nominal `duration` [s], `apex` [m].
    """
    phase = obs[ELAPSED] / duration
    if failed or phase > LATE:
        return 0.0
    wanted = apex * math.sin(math.pi * phase) if phase < 1.0 else 0.0
    return math.exp(-(((obs[_SWING_HEIGHT] - wanted) / CLEARANCE) ** 2))


@njit(cache=True)
def effort(squares):  # pragma: no cover
    """-0.05 sum (tau / largest)^2, the mean of the period."""
    return -0.05 * squares


@njit(cache=True)
def smoothness(held, before):  # pragma: no cover
    """-0.02 |a - a_before|^2 of the joints' actions (14,)."""
    total = 0.0
    for i in range(held.shape[0]):
        total += (held[i] - before[i]) ** 2
    return -0.02 * total


@njit(cache=True)
def write_rewards(
    gait_terms, truth, plan, squares, held, before, apex, failed, terms, total
):  # pragma: no cover
    """Write terms (n, 10) in the order of JOINT_REWARD_TERMS and their sums (n,); `before` becomes `held`.

    Args:
        gait_terms: (n, 7) in the order of REWARD_TERMS.
        truth: observations (n, 36) without noise.
        plan: nominal steps (n, 7).
        squares: effort (n,).
        held: actions (n, 14) of the period.
        before: of the period before, written.
        apex: height of the swing sole in mid-step [m].
        failed: (n,).
        terms: written.
        total: written.
    """
    for k in range(total.shape[0]):
        row, obs = terms[k], truth[k]
        for i in range(OWN):
            row[i] = gait_terms[k, TAKEN[i]]
        row[OWN], row[OWN + 1] = velocity(obs, failed[k]), heading(obs)
        row[OWN + 2] = swing(obs, plan[k, DURATION], apex, failed[k])
        row[OWN + 3], row[OWN + 4] = effort(squares[k]), smoothness(held[k], before[k])
        total[k] = 0.0
        for i in range(row.shape[0]):
            total[k] += row[i]
        for i in range(held.shape[1]):
            before[k, i] = held[k, i]
