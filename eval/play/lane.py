"""One robot that walks under a policy, and whose scenario grows while it walks.

What happens to it is written into its scenario first: a push or a command given now makes a longer scenario,
to which the robot is put back at the same moment (`restore`). So the walk is at any time that of its scenario
from the start, bit for bit, whoever gave the pushes.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...controllers.errors import InvalidValueError
from ...envs.biped.env import BipedEpisodes
from ...envs.scenario.command import Command, CommandChange
from ...envs.scenario.push import Push
from ...envs.scenario.scenario import Scenario
from ...envs.snapshot.robot_snapshot import RobotSnapshot
from ..record.record import gait_episodes
from ..record.sampler import Row, Sampler
from ..rollout.environments import make_env_for
from ..rollout.one import begin_policy
from ..rollout.policy_source import policy_sources

LONGEST = 1e6  # [s] of a walk; no one plays that long
KEPT = 600  # samples of the strip charts
NAME = "play"  # of its scenarios
ON_THE_SPOT = Scenario(NAME)


@dataclass(frozen=True)
class Moment:
    """A robot between two planning periods, and what its policy remembered."""

    snapshot: RobotSnapshot
    policy: str  # that acted
    memory: Any  # what it remembered


class Lane:
    """One robot and its policy.

    Args:
        env_id: of a biped under gait actions.
        policy: a name, a file, or MODULE:ATTRIBUTE.
        start: how the robot is and what it is told; its pushes and its end are left out.

    Raises:
        PushRecoveryError: unknown names, or a robot that can't be put back.
    """

    def __init__(self, env_id: str, policy: str, start: Scenario = ON_THE_SPOT):
        source = policy_sources(policy)[policy]  # a name of a policy that ships stands for its file
        made = make_env_for(source.origin, env_id)
        self.name = policy
        self._start = replace(start, id=NAME, pushes=(), changes=(), duration=LONGEST)
        self.policy = source.load(made)
        self.env: Any = made.unwrapped
        self.episodes = _biped(gait_episodes(made))
        self.period = 1.0 / self.episodes.control_hz  # [s]
        self.rows: deque[Row] = deque(maxlen=KEPT)
        self._sampler = Sampler(self.episodes)
        self.restart(start.command)

    def restart(self, command: Command) -> None:
        """Begin a new walk."""
        scenario = replace(self._start, command=command)
        self._seen, self._info = self.env.reset(seed=scenario.noise_seed, options={"scenario": scenario})
        self._memory, self._first, self.over = None, True, False
        begin_policy(self.policy, scenario)
        self._look(anew=True)

    def step(self) -> None:
        """One planning period; a robot that has fallen lies."""
        if self.over:
            return
        action, self._memory = self.policy.predict(
            self._seen, state=self._memory, episode_start=np.array([self._first]), deterministic=True
        )
        self._first = False
        self._seen, _, fell, late, self._info = self.env.step(action)
        self.over = bool(fell or late)
        self._look()

    def push(self, push: Push) -> None:
        """Push from now on; `push` starts at the present time or later.

        Raises:
            InvalidValueError: the robot has fallen.
        """
        scenario = self.scenario
        self._go_on(replace(scenario, pushes=(*scenario.pushes, push)))

    def tell(self, command: Command) -> None:
        """Another command, in force from the next planning period on.

        Raises:
            InvalidValueError: the robot has fallen.
        """
        scenario, at = self.scenario, self.time + self.period
        if command == self.command:
            return
        kept = tuple(change for change in scenario.changes if change.time < at - 0.5 * self.period)
        self._go_on(replace(scenario, changes=(*kept, CommandChange(at, command))))

    def moment(self) -> Moment:
        """Where it is now.

        Raises:
            InvalidValueError: the robot has fallen.
        """
        self._refuse_fallen()
        return Moment(self.env.state_snapshot(), self.name, self._memory)

    def put(self, moment: Moment) -> None:
        """Go on where a robot of the same kind was; another policy remembers nothing of it.

        Raises:
            InvalidValueError: a robot of another kind.
        """
        self._seen, self._info = self.env.restore(moment.snapshot)
        same = moment.policy == self.name
        self._memory = moment.memory if same else None
        self._first, self.over = not same, False
        self._look(anew=True)

    @property
    def scenario(self) -> Scenario:
        """All that has happened to it since the start of its walk."""
        return self.env.scenario

    @property
    def command(self) -> Command:
        """In force, or to come into force with the next planning period."""
        scenario = self.scenario
        return scenario.changes[-1].command if scenario.changes else scenario.command

    @property
    def time(self) -> float:
        """Since the start of its walk [s]."""
        return float(self._info["time"])

    @property
    def failure(self) -> str | None:
        """Why it has fallen."""
        return self._info["failure_reason"]

    @property
    def recovered_at(self) -> float | None:
        """Since when it has been walking as told again [s]."""
        return self._info["recovered_at"]

    @property
    def bounds(self) -> dict[str, float]:
        """How far columns of its samples may go both ways, in their units."""
        return self._sampler.bounds

    @property
    def mass(self) -> float:
        """Of the robot [kg]."""
        return self.episodes.robot.mass

    def close(self) -> None:
        """Let the environment go."""
        self.env.close()

    def _go_on(self, scenario: Scenario) -> None:
        self._refuse_fallen()
        self._seen, self._info = self.env.restore(self.env.state_snapshot(), scenario)

    def _refuse_fallen(self) -> None:
        if self.over:
            raise InvalidValueError("the robot has fallen: restart it, or replay the last push")

    def _look(self, anew: bool = False) -> None:
        if anew:
            self.rows.clear()
            self._sampler.begin()
        self.rows.append(self._sampler.row())


def _biped(episodes: Any) -> BipedEpisodes:
    if not isinstance(episodes, BipedEpisodes):
        raise InvalidValueError(
            f"only bipeds are played with, such as PushRecovery/Biped-v0, got {episodes.name}"
        )
    return episodes
