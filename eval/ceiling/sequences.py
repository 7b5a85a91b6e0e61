"""Sequences of corrections that answer a push, replayed by scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...controllers.errors import InvalidValueError, shown
from ...controllers.model.gait_box import GAIT_SIZE, GaitLimits
from ...controllers.model.robot import RobotModel
from ...controllers.validation import require_integer
from ...envs.scenario.scenario import Scenario
from ..sampling_mpc.corrections import Actions, Progress, SequenceRule, begun

LONGEST = 10**9  # planning periods before a sequence


@dataclass(frozen=True)
class Sequence:
    """An answer to one push."""

    period: int  # number of planning periods before the first correction
    corrections: list[list[float]]  # (steps, 7) in [-1, 1]

    def __post_init__(self) -> None:
        require_integer("the period of a sequence", self.period, 0, LONGEST)
        try:
            values = np.array(self.corrections, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):  # ragged, or no numbers
            values = np.empty(0)
        if values.ndim != 2 or values.shape[-1] != GAIT_SIZE or not (np.abs(values) <= 1.0).all():
            raise InvalidValueError(
                f"a sequence has rows of {GAIT_SIZE} numbers in [-1, 1], got {shown(self.corrections)}"
            )


class AttemptsPolicy:
    """Acts for n robots that were put back at the moment of a push, each with its own corrections.

    Args:
        rule: how they are added.
        corrections: (n, steps, 7) of the robots in the order in which they begin.
    """

    def __init__(self, rule: SequenceRule, corrections: Actions):
        self._rule, self._corrections = rule, corrections

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Progress]:
        """Actions (n, 7) for a batch, and the progress to hand in next time."""
        progress = begun(self._corrections) if state is None else Progress(*state)
        return self._rule.act(observation, progress)


class SequencePolicy:
    """Replays sequences by scenario id, for one robot in the ordinary rollout; a planner where it has none.

    A rollout tells it which scenario begins (`begin_scenario`).

    Args:
        policy: name of the planner.
        robot: physical constants.
        limits: gait box.
        preset: of the planner.
        scale: multiple of `default_residual_scale`.
        sequences: by scenario id.
    """

    def __init__(
        self,
        policy: str,
        robot: RobotModel,
        limits: GaitLimits,
        preset: str,
        scale: float,
        sequences: Mapping[str, Sequence],
    ):
        self._arguments = policy, robot, limits, preset, scale, dict(sequences)
        self._rule, self.sequences = SequenceRule(policy, robot, limits, preset, scale), dict(sequences)
        self._sequence: Sequence | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return SequencePolicy, self._arguments

    def begin_scenario(self, scenario: Scenario) -> None:
        """The scenario of the episode to come."""
        self._sequence = self.sequences.get(scenario.id)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Progress]:
        """Action (7,) for one observation (36,), and the progress to hand in next time."""
        if episode_start is not None and np.any(episode_start):
            state = None
        progress = self._at_first() if state is None else Progress(*state)
        actions, progress = self._rule.act(np.asarray(observation, np.float64)[None], progress)
        return actions[0], progress

    def _at_first(self) -> Progress:
        if self._sequence is None:
            return begun(np.zeros((1, 0, GAIT_SIZE), np.float32))
        return begun(np.array([self._sequence.corrections], np.float32), self._sequence.period)
