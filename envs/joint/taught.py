"""Bipeds under joint targets with a planner beside them, who says what it would ask: to learn from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.nominal_start import NominalStart
from ...controllers.policies.arms import make_policy
from ...controllers.whole_body.gait_machine import Gait, resting_gait
from ..biped.core import BipedCore
from ..biped.period import PeriodCalls
from ..episode.episodes import Array, Mask, Period
from ..scenario.scenario import Scenario
from ..snapshot.rows import Arrays, arrays_of
from .core import JointCore
from .episodes import JointEpisodes
from .taught_calls import TAUGHT_CALLS, Teacher, make_teacher


class Beside(NamedTuple):
    """What goes with each robot beside its own state."""

    walk: Gait
    teacher: Teacher


class TaughtCore(JointCore):
    """n bipeds under joint targets, and beside each the planner's own gait machine."""

    calls: ClassVar[PeriodCalls] = TAUGHT_CALLS

    def _more_parts(self) -> Sequence[Any]:
        """Joints, the planner's gait machine and what the planner sees and asks."""
        if not hasattr(self, "teacher"):
            self.walk, self.teacher = resting_gait(self.n), make_teacher(self.n)
        return *super()._more_parts(), self.walk, self.teacher

    def more_arrays(self) -> Arrays:
        """Arrays of n robots beside the arena whose rows are state, by PART.FIELD."""
        return super().more_arrays() | arrays_of(Beside(self.walk, self.teacher), ())

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """As that of `JointCore`; the planner's gait machine begins where the robot's does."""
        for field in self.walk:
            field[k] = 0
        super().reset(k, scenario, start, gait, action)
        for field, own in zip(self.walk, self.gait, strict=True):
            field[k] = own[k]
        self.teacher.landing[k] = self.teacher.leads[k] = 0
        self.teacher.previous[k] = self.previous_action[k]
        self.teacher.seen[k] = self.truth[k]


class TaughtEpisodes(JointEpisodes):
    """Episodes of n bipeds under joint targets, and after each period what a planner would have asked.

    Its whole-body control finds torques in every state that the robots come to; `targets` gives the same
    torques in the mean of the period. A learner that is asked to come close to them in the states that its
    own actions lead to is taught by DAgger (Ross, Gordon, Bagnell, AISTATS 2011).
    """

    name = "PushRecovery/BipedJoint-v0 with a planner beside it"
    core_of: ClassVar[type[BipedCore]] = TaughtCore
    core: Any  # a TaughtCore

    def __init__(self, n: int, policy: str = "two-stage", **kwargs: Any):
        super().__init__(n, **kwargs)
        self.policy = policy
        self.planner = make_policy(policy, self.robot, self.limits, self.preset)
        self._plans = np.zeros((n, 7), np.float32)

    @property
    def targets(self) -> Array:
        """What the planner would have asked of the joints in the period before, (n, 14), in action units."""
        return self.core.teacher.target

    def lead(self, robots: Mask) -> None:
        """Let the planner's torques move these robots (n,), whatever is asked of their joints."""
        self.core.teacher.leads[:] = robots

    def step(self, actions: NDArray[np.float32]) -> Period:
        """As that of `JointEpisodes`, the planner's plan beside it."""
        core, rows = self.core, np.flatnonzero(self.failure() == 0)
        core.joints.asked[:] = actions
        if len(rows):
            self._plans[rows] = self.planner.predict(core.teacher.seen[rows])[0]
        core.step(self.limits.from_action(self._plans), self._plans.astype(np.float64))
        return self._judge()
