"""A session of play: one robot, or two side by side, in step with a clock that is handed in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ...controllers.errors import InvalidValueError
from ...controllers.validation import require_number
from ...envs.scenario.command import Command
from ...envs.scenario.push import Body, Push
from ...envs.scenario.scenario import Scenario
from .drag import push_now
from .lane import ON_THE_SPOT, Lane, Moment

SLOWEST, FASTEST = 0.02, 2.0  # of the session's clock against the one handed in
MOST_PERIODS = 20  # that one `advance` catches up with; a slower computer plays slower instead


@dataclass(frozen=True)
class LastPush:
    """What a replay begins from."""

    push: Push
    before: tuple[Moment, ...]  # of each lane, when it was given


class Session:
    """What a viewer shows, and what its buttons do.

    Args:
        env_id: of a biped under gait actions.
        policy: of the first robot: a name, a file, or MODULE:ATTRIBUTE.
        beside: policy of a second robot; None: there is none.
        start: how the robots are and what they are told at first.
    """

    def __init__(self, env_id: str, policy: str, beside: str | None = None, start: Scenario = ON_THE_SPOT):
        self.env_id, self.start = env_id, start
        self.paused, self.speed = False, 1.0
        self.last: LastPush | None = None
        self.lanes: list[Lane] = [self._lane(policy)]
        self._owed = 0.0  # simulated time to catch up with [s]
        if beside is not None:
            self.put_beside(beside)

    @property
    def first(self) -> Lane:
        """The robot that is always there."""
        return self.lanes[0]

    def advance(self, seconds: float) -> int:
        """Let the time of the clock go by; returns the planning periods simulated."""
        if self.paused:
            return 0
        period = self.first.period
        self._owed = min(self._owed + seconds * self.speed, MOST_PERIODS * period)
        count = int(self._owed / period + 1e-9)
        self._owed -= count * period
        for _ in range(count):
            self.step()
        return count

    def step(self) -> None:
        """One planning period of every robot."""
        for lane in self.lanes:
            lane.step()

    def set_speed(self, speed: float) -> None:
        """Simulated seconds a second.

        Raises:
            InvalidValueError: outside [SLOWEST, FASTEST].
        """
        self.speed = require_number("speed", speed, SLOWEST, FASTEST)

    def push(self, impulse: ArrayLike, body: Body = "pelvis") -> Push:
        """Push every robot now with an impulse (2,) [N s], world axes; returns the first one's push.

        Of two robots of one kind the second is first put where the first is: the same push, the same state.

        Raises:
            InvalidValueError: the first robot has fallen, or an impossible impulse.
        """
        before = self._aligned()
        pushes = []
        for lane in self.lanes:
            pushes.append(push_now(impulse, lane.time, body))
            lane.push(pushes[-1])
        self.last = LastPush(pushes[0], before)
        return pushes[0]

    def tell(self, command: Command) -> None:
        """Command all robots that walk."""
        for lane in self.lanes:
            if not lane.over:
                lane.tell(command)

    def switch(self, policy: str, index: int = 0) -> bool:
        """Let another policy act for a robot from now on; returns whether its walk went on.

        A policy with a robot of its own starts a new walk.

        Raises:
            PushRecoveryError: no such policy, or one that can't act here; all stays as it was.
        """
        new, old = self._lane(policy), self.lanes[index]
        self.lanes[index] = new
        walks = not old.over and _tried(lambda: new.put(old.moment()))
        if not walks:
            new.restart(old.command)
        old.close()
        return walks

    def put_beside(self, policy: str | None) -> None:
        """A second robot under a policy, where the first is; None takes it away.

        Raises:
            PushRecoveryError: no such policy, or one that can't act here; all stays as it was.
        """
        new = None if policy is None else self._lane(policy)
        for lane in self.lanes[1:]:
            lane.close()
        self.lanes[1:] = [] if new is None else [new]
        self.last = None  # what was before it holds for other robots
        if new is None:
            return
        if self.first.over:
            self.restart()
        elif not _tried(lambda: new.put(self.first.moment())):
            new.restart(self.first.command)

    def replay(self) -> Push:
        """Put every robot back to when the last push was given, and push it again, under its policy of now.

        Raises:
            InvalidValueError: nothing has been pushed, or a robot of another kind walks now.
        """
        if self.last is None:
            raise InvalidValueError("there is no push yet that could be replayed")
        for lane, moment in zip(self.lanes, self.last.before, strict=True):
            lane.put(moment)
            lane.push(push_now(self._impulse, moment.snapshot.time, self.last.push.body))
        self._owed = 0.0
        return self.last.push

    def restart(self) -> None:
        """All robots begin a new walk under the command of now."""
        command = self.first.command
        for lane in self.lanes:
            lane.restart(command)
        self._owed = 0.0

    def close(self) -> None:
        """Let all robots go."""
        for lane in self.lanes:
            lane.close()

    @property
    def _impulse(self) -> tuple[float, float]:
        assert self.last is not None  # noqa: S101  # asked for by `replay` alone
        x, y, _ = self.last.push.impulse
        return x, y

    def _lane(self, policy: str) -> Lane:
        return Lane(self.env_id, policy, self.start)

    def _aligned(self) -> tuple[Moment, ...]:
        """Where every robot is, the second where the first is if it is of the same kind."""
        first = self.first.moment()
        for lane in self.lanes[1:]:
            if not _tried(lambda lane=lane: lane.put(first)) and lane.over:
                lane.restart(self.first.command)
        return (first, *(lane.moment() for lane in self.lanes[1:]))


def _tried(call: Callable[[], None]) -> bool:
    """Whether a robot could be put where another one was."""
    try:
        call()
    except InvalidValueError:
        return False
    return True
