"""Corrections of a planner's actions, a row for each step from now on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.gait_box import GAIT_SIZE, GaitLimits
from ...controllers.model.observation import ELAPSED
from ...controllers.model.robot import RobotModel
from ...controllers.policies.arms import make_policy
from ...controllers.policies.residual import default_residual_scale
from ...controllers.policies.residual_rule import ResidualRule

Actions = NDArray[np.float32]
Array = NDArray[np.float64]


class Progress(NamedTuple):
    """Where n robots are in their sequences; what `predict` hands over as its state."""

    corrections: Actions  # (n, steps, 7) of the scaled action, in [-1, 1]
    wait: NDArray[np.int64]  # (n,) planning periods until the first one; -1: it has begun
    step: NDArray[np.int64]  # (n,) index of the present one
    elapsed: Array  # (n,) of the step, when last looked at [s]


class SequenceRule:
    """A planner whose action is corrected by the row of the step: clip(base + scale x row, -1, 1).

    A step is over when the time since its begin falls. Before the first row and after the last one the
    actions are the planner's own, bit for bit.

    Args:
        policy: name of the planner.
        robot: physical constants.
        limits: gait box.
        preset: of the planner.
        scale: multiple of `default_residual_scale`.
    """

    def __init__(self, policy: str, robot: RobotModel, limits: GaitLimits, preset: str, scale: float):
        base = make_policy(policy, robot, limits, preset)
        self._rule = ResidualRule(base, robot, limits, default_residual_scale(limits, scale), None)

    def act(self, observations: Array, progress: Progress) -> tuple[Actions, Progress]:
        """Gait actions (n, 7) at observations (n, 36), and where the robots are after them."""
        corrections, wait, step, before = progress
        elapsed = observations[:, ELAPSED].copy()
        step = step + ((wait < 0) & (elapsed < before))
        rows = np.zeros((len(observations), GAIT_SIZE), np.float32)
        now = np.flatnonzero((wait <= 0) & (step < corrections.shape[1]))
        rows[now] = corrections[now, step[now]]
        actions = self._rule.act(observations, rows).total
        return actions, Progress(corrections, np.maximum(wait - 1, -1), step, elapsed)


def begun(corrections: Actions, wait: int = 0) -> Progress:
    """Robots at the begin of their sequences (n, steps, 7), which start after `wait` planning periods."""
    n = len(corrections)
    return Progress(corrections, np.full(n, wait), np.zeros(n, np.int64), np.full(n, -np.inf))
