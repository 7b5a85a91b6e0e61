"""The moment of a push: the last planning period that begins before it does."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.model.gait_box import GAIT_SIZE
from ...envs.biped.env import BipedEpisodes
from ...envs.scenario.scenario import Scenario
from ...envs.snapshot.robot_snapshot import RobotSnapshot
from ..sampling_mpc.corrections import SequenceRule, begun


class Moment(NamedTuple):
    """Where a search for an answer begins."""

    snapshot: RobotSnapshot
    period: int  # planning periods that have gone by


def require_bipeds(episodes: object) -> BipedEpisodes:
    """The episodes of robots that can be put back.

    Raises:
        InvalidValueError: those of another kind, or of an environment that acts in a way of its own.
    """
    if not isinstance(episodes, BipedEpisodes):
        raise InvalidValueError(
            "a ceiling is searched for on bipeds under plain gait actions, such as PushRecovery/Biped-v0"
        )
    return episodes


def moment_of_push(episodes: BipedEpisodes, rule: SequenceRule, scenario: Scenario) -> Moment | None:
    """Walk to the first push with robot 0 under the planner alone; None where none begins before the end."""
    episodes.begin(0, scenario)
    progress, starts = begun(np.zeros((1, 0, GAIT_SIZE), np.float32)), episodes.core.pushes
    period, over = 0, False
    while not over:
        moment = Moment(episodes.state_snapshot(0), period)
        actions, progress = rule.act(episodes.core.observation[:1], progress)
        ends = episodes.step(actions)
        if starts.start[0].min() < episodes.core.gait.time[0]:
            return moment
        period, over = period + 1, bool(ends.failed[0] or ends.truncated[0])
    return None
