"""Robots to play with: they walk or stand in step with a clock, are commanded, pushed, put back and compared.

An event is written into a robot's scenario first: a push or a command given now makes a longer scenario, to
which the robot is put back at the same moment (`restore`). So the walk is at any time that of its scenario
from the start, bit for bit, whoever gave the pushes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...controllers.errors import InvalidValueError
from ...controllers.model.observation import ELAPSED
from ...controllers.model.robot import GRAVITY
from ...controllers.policies.interface import action_and_state
from ...controllers.validation import require_choice, require_number
from ...envs.biped.env import BipedEpisodes
from ...envs.scenario.disturbances import Impactor, Payload, Slip, SteadyForce, Trip, WaistPull, WeightPull
from ...envs.scenario.push import Body, Disturbance, GaitEvent, Push
from ...envs.scenario.scenario import Command, CommandChange, Scenario
from ...envs.snapshot import RobotSnapshot
from ..record.record import LIMIT, Array, Recorder, gait_episodes
from ..record.words import impulse_words
from ..rollout.environments import make_env_for
from ..rollout.episodes import action_rule, begin_policy
from ..rollout.outcome import reason_words
from ..rollout.policy_source import policy_sources
from ..rollout.strategy import StrategyMeter

IMPULSE_PER_METRE = 100.0  # K, of a drag [N s/m]
IMPULSE_MAX = 400.0  # [N s]
CLICK = 0.5  # a drag that gives less is no push [N s]
DURATION = 0.1  # of a push by hand [s]
STEEP = 1e-6  # a view with less of a horizontal part looks straight down


def dragged_impulse(way: ArrayLike, camera: ArrayLike) -> Array:
    """Horizontal impulse of a drag on the screen, (2,) [N s], in the world.

    The pointer's way is measured on the plane that holds the point grabbed and faces the camera: r to the
    right and u upwards [m]. To the right stays to the right, upwards is away from the camera, on the floor:

        J = K (r a + u b), |J| <= IMPULSE_MAX,    a: the camera's right, b: its view's horizontal direction.

    At depth D from the camera a pixel is 2 D tan(fov / 2) / H metres, H the picture's height in pixels. `way`
    goes from the point grabbed to the pointer, (3,) in the world [m]; the columns of `camera` (3, 3) are its
    axes right, down, view.
    """
    right, down, view = np.asarray(camera, np.float64).T
    away = view if np.hypot(*view[:2]) > STEEP else -down
    away = away[:2] / np.hypot(*away[:2])
    aside = np.array([away[1], -away[0]])
    way = np.asarray(way, np.float64)
    return floor_impulse((way @ right) * aside - (way @ down) * away)


def floor_impulse(way: ArrayLike) -> Array:
    """Impulse (2,) of a drag along the floor (2,) [m]: K times the way, no larger than IMPULSE_MAX."""
    impulse = IMPULSE_PER_METRE * np.asarray(way, np.float64)
    return impulse * min(1.0, IMPULSE_MAX / max(float(np.hypot(*impulse)), 1e-12))


def polar_impulse(size: float, psi_deg: float) -> Array:
    """Impulse (2,) of a size up to IMPULSE_MAX [N s] towards psi, counter-clockwise from x [deg]."""
    size = require_number("impulse [N s]", size, 0.0, IMPULSE_MAX)
    psi = math.radians(require_number("direction [deg]", psi_deg))
    return np.array([size * math.cos(psi), size * math.sin(psi)])


def push_now(impulse: ArrayLike, time: float, body: str = "pelvis") -> Push:
    """The push of an impulse (2,) [N s] from a time on [s]: the force J / DURATION."""
    x, y = (float(part) / DURATION for part in np.asarray(impulse, np.float64))
    return Push((x, y, 0.0), DURATION, time, body)


class FirstPush(NamedTuple):
    """The push that a session offers at first."""

    impulse: float  # size [N s]
    psi: float  # direction, counter-clockwise from forward [deg]
    body: Body = "pelvis"


@dataclass(frozen=True)
class ByHand:
    """What a disturbance that is given by hand starts from."""

    impulse: Array  # chosen, (2,) [N s], world axes
    body: str
    lane: "Lane"

    @property
    def size(self) -> float:
        """J [N s]."""
        return float(np.hypot(*self.impulse))

    @property
    def ahead(self) -> float:
        """Direction of the impulse, counter-clockwise from the robot's forward [rad]."""
        heading = self.lane.rows[-1]["heading"]
        return math.remainder(math.atan2(self.impulse[1], self.impulse[0]) - heading, math.tau)

    @property
    def common(self) -> dict[str, Any]:
        """Start and direction, as disturbances that laboratories use take them."""
        return {"start": self.lane.time, "direction": self.ahead}


def _push(hand: ByHand) -> Disturbance:
    return push_now(hand.impulse, hand.lane.time, hand.body)


def _impactor(hand: ByHand) -> Disturbance:
    mass = 0.25 * hand.lane.mass
    return Impactor(mass, hand.size / mass, body=hand.body, **hand.common)


def _weight_pull(hand: ByHand) -> Disturbance:
    duration = 0.5
    return WeightPull(hand.size / (GRAVITY * duration), duration=duration, body=hand.body, **hand.common)


def _waist_pull(hand: ByHand) -> Disturbance:
    return WaistPull(0.12 * hand.size / hand.lane.mass, 0.8, body=hand.body, **hand.common)


def _steady_force(hand: ByHand) -> Disturbance:
    duration, rise = 1.0, 0.2
    force = hand.size / (duration - rise)
    return SteadyForce(force, duration=duration, rise=rise, body=hand.body, **hand.common)


def _payload(hand: ByHand) -> Disturbance:
    height = 0.2
    return Payload(hand.size / math.sqrt(2.0 * GRAVITY * height), height, hand.lane.time)


def _slip(hand: ByHand) -> Disturbance:
    side = hand.lane.scenario.side_of_step(hand.lane.steps)
    return Slip(side, 0.05, hand.lane.time + hand.lane.period, 0.4)  # the floor of now has been laid already


def _trip(hand: ByHand) -> Disturbance:
    if hand.lane.stands:
        raise InvalidValueError("a robot that stands does not trip: let it walk first")
    coming = hand.lane.steps + 1
    event = GaitEvent(coming, hand.lane.scenario.side_of_step(coming), 0.3)
    return Trip(event, force=2.5 * hand.lane.mass)


PUSH = "push"
KINDS: dict[str, Callable[[ByHand], Disturbance]] = {  # of one force each, by an impulse J and the mass m
    PUSH: _push,  # J within 0.1 s
    "impactor": _impactor,  # m / 4 at the speed of the momentum J
    "weight pull": _weight_pull,  # whose weight gives J in 0.5 s
    "waist pull": _waist_pull,  # over 0.12 J / m metres
    "steady force": _steady_force,  # J within 1 s
    "payload": _payload,  # that falls 0.2 m and has the momentum J
    "slip": _slip,  # of the stance foot, friction 0.05 for 0.4 s
    "trip": _trip,  # in the next step, a block that gives way beyond 2.5 N/kg
}


LONGEST = 1e6  # [s] of a walk; no one plays that long
KEPT = 600  # samples of the strip charts
NAME = "play"  # of its scenarios
ON_THE_SPOT = Scenario(NAME)


@dataclass(frozen=True)
class LaneState:
    """A robot between two planning periods, and the memory of its policy."""

    snapshot: RobotSnapshot
    policy: str  # that acted
    memory: Any
    given: tuple[str, ...]  # kinds of its pushes


@dataclass(frozen=True)
class Answer:
    """What a robot that stood has done about the last push so far, until it was told to walk."""

    strategy: str  # of `rollout/strategy.py`
    steps: int  # completed since the push


class Lane:
    """One biped that walks or stands under a policy, and whose scenario grows while it does.

    It has robot and command of `start`, but nothing of what happens there, nor its end. Told to stand, a
    robot that cannot steps in place.
    """

    def __init__(self, env_id: str, policy: str, start: Scenario = ON_THE_SPOT):
        source = policy_sources(policy)[policy]  # a name of a policy that ships stands for its file
        made = make_env_for(source.origin, env_id)
        episodes = gait_episodes(made)
        if not isinstance(episodes, BipedEpisodes):
            raise InvalidValueError(
                f"only bipeds are played with, such as PushRecovery/Biped-v0, got {episodes.name}"
            )
        rule = action_rule(made)
        if rule is None or rule.residual is not None or rule.hold != 1:
            raise InvalidValueError(
                f"only plain actions are played with, and those of {env_id} are corrections"
            )
        self.name = policy
        self._start = replace(
            start, id=NAME, pushes=(), kicks=(), disturbances=(), changes=(), duration=LONGEST
        )
        self._next: Command | None = None  # of its next walk, while it lies
        self.policy = source.load(made)
        self.env: Any = made.unwrapped
        self.episodes = episodes
        self.period = 1.0 / episodes.control_hz  # [s]
        self.recorder = Recorder(episodes, KEPT)
        self.rows = self.recorder.rows
        self.mass = episodes.robot.mass  # [kg]
        self._strategy, self._steps_before = StrategyMeter(episodes), 0
        self.restart(start.command)

    def restart(self, command: Command) -> None:
        """Begin a new walk."""
        command = self._possible(command)
        stride = self._start.stride if command.stand else 0.0
        scenario, self._next = replace(self._start, command=command, stride=stride), None
        self._seen, self.info = self.env.reset(seed=scenario.noise_seed, options={"scenario": scenario})
        self._memory, self._first, self.over = None, True, False
        self.answer: Answer | None = None
        self.given: list[str] = []  # kinds of the scenario's pushes
        begin_policy(self.policy, scenario)
        self.rows.clear()
        self.recorder()

    def step(self) -> None:
        """One planning period; a robot that has fallen lies."""
        if self.over:
            return
        action, self._memory = action_and_state(
            self.policy.predict(
                self._seen, state=self._memory, episode_start=np.array([self._first]), deterministic=True
            )
        )
        self._first = False
        self._seen, _, fell, late, self.info = self.env.step(action)
        self.over = bool(fell or late)
        self.recorder()
        if self.answer is not None and self.command.stand:
            self._strategy.look()
            self._note_answer()

    def push(self, push: Push, kind: str = PUSH) -> None:
        """Push from the present time on, or later; a robot that has fallen is not pushed."""
        scenario = self.scenario
        self._go_on(replace(scenario, pushes=(*scenario.pushes, push)))
        self.given = [*self.given[: len(scenario.pushes)], kind]
        self._strategy.begin(0)
        self._steps_before = self.steps
        self._note_answer()

    def set_command(self, command: Command) -> None:
        """Another command, in force from the next planning period on; of one that lies, in its next walk."""
        if self.over:
            self._next = self._possible(command)
            return
        scenario, at, command = self.scenario, self.time + self.period, self._possible(command)
        if command == self.command:
            return
        kept = tuple(change for change in scenario.changes if change.time < at - 0.5 * self.period)
        self._go_on(replace(scenario, changes=(*kept, CommandChange(at, command))))

    @property
    def push_start(self) -> float:
        """When the last push of its scenario began [s]; inf where it has not, 0 where there is none."""
        count = len(self.scenario.pushes)
        return float(self.episodes.core.pushes.start[0, count - 1]) if count else 0.0

    def state(self) -> LaneState:
        """Robot and memory of now; a robot that has fallen has none."""
        self._refuse_fallen()
        return LaneState(self.env.state_snapshot(), self.name, self._memory, tuple(self.given))

    def put(self, state: LaneState) -> None:
        """Go on where a robot of the same kind was; another policy remembers nothing of it."""
        self._seen, self.info = self.env.restore(state.snapshot)
        same = state.policy == self.name
        self._memory = state.memory if same else None
        self._first, self.over, self.answer, self._next = not same, False, None, None
        self.given = list(state.given)
        self.rows.clear()
        self.recorder()

    @property
    def scenario(self) -> Scenario:
        """Pushes and commands since the start of its walk."""
        return self.env.scenario

    @property
    def command(self) -> Command:
        """In force, or to come into force with the next planning period or the next walk."""
        if self._next is not None:
            return self._next
        scenario = self.scenario
        return scenario.changes[-1].command if scenario.changes else scenario.command

    @property
    def time(self) -> float:
        """Since the start of its walk [s]."""
        return float(self.info["time"])

    @property
    def stands(self) -> bool:
        """Whether both feet stay where they are."""
        return bool(self.episodes.core.truth[0, ELAPSED] < 0.0)

    def close(self) -> None:
        """Let the environment go."""
        self.env.close()

    @property
    def steps(self) -> int:
        """Completed since the start of its walk, and so the number of the one under way."""
        return int(self.episodes.motion().steps[0])

    def _note_answer(self) -> None:
        strategy = self._strategy.strategy(0)
        self.answer = None if strategy is None else Answer(strategy, self.steps - self._steps_before)

    def _possible(self, command: Command) -> Command:
        return command if self.episodes.stands else replace(command, stand=False)

    def _go_on(self, scenario: Scenario) -> None:
        self._refuse_fallen()
        self._seen, self.info = self.env.restore(self.env.state_snapshot(), scenario)

    def _refuse_fallen(self) -> None:
        if self.over:
            raise InvalidValueError("the robot has fallen: restart it, or replay the last push")


RECENT = 30  # samples in which a limit counts as being met


def status_words(lane: Lane) -> str:
    """Whether a robot walks, stands, was pushed, has recovered or fallen, and then which keys help."""
    if lane.over:
        again = ""
        if lane.given:
            fell = f"fell {lane.time - lane.push_start:.2f} s after the {lane.given[-1]}"
            again = f", R to replay the last {lane.given[-1]}"
        else:
            fell = "fell"
        return f"{fell} ({reason_words(lane.info['failure_reason'])}): press N to start anew{again}"
    if not lane.given:
        return f"{'stands' if lane.stands else 'walks'}, {lane.time:.1f} s"
    kind, start = lane.given[-1], lane.push_start
    if math.isinf(start):
        return f"{kind} to come in the next step"
    words = given_words(lane.scenario.pushes[-1], kind, lane.mass)
    settled, since = lane.info["recovered_at"], lane.time - start
    if settled is not None and settled >= start:
        return f"recovered {settled - start:.2f} s after {words}"
    return f"pushed {since:.2f} s ago with {words}" if kind == PUSH else f"{since:.2f} s after {words}"


def given_words(push: Push, kind: str, mass: float) -> str:
    """A push that was given, in words: its impulse, with its kind where that is another one."""
    if kind == PUSH:
        return impulse_words(push, mass)
    aside = any(push.force[:2]) and kind != "trip"
    return f"{kind} of nominally {impulse_words(push, mass)}" if aside else kind


ANSWERS = {  # to a push, by strategy
    "ankle": "ankles (no step, the soles alone were enough)",
    "hip": "hips (no step, the trunk's swing was needed)",
}


def answer_words(lane: Lane) -> str:
    """How a robot that stood has answered the last push so far; nothing where there is no such push."""
    if lane.answer is None:
        return ""
    steps = max(lane.answer.steps, 1)  # the first one may be under way
    stepped = f"{steps} step{'s' if steps > 1 else ''}"
    return f"answer to the push: {ANSWERS.get(lane.answer.strategy, stepped)}"


def limits_words(lane: Lane) -> list[str]:
    """The limits being met: in one of the last RECENT planning periods."""
    rows = list(lane.rows)[-RECENT:]
    met = [name for name in rows[-1] if name.startswith(LIMIT) and any(row[name] > 0.0 for row in rows)]
    return [name.removeprefix(LIMIT).replace("_", " ") for name in met]


SLOWEST, FASTEST = 0.02, 2.0  # of the session's clock against the one handed in
PERIODS_MAX = 20  # that one `advance` catches up with; a slower computer plays slower instead


@dataclass(frozen=True)
class LastPush:
    """Start of a replay."""

    pushes: tuple[Push, ...]  # of each lane
    kind: str
    before: tuple[LaneState, ...]  # of each lane, when it was given

    @property
    def push(self) -> Push:
        """The first robot's."""
        return self.pushes[0]


class Session:
    """One robot, or two side by side, in step with a clock that is handed in.

    Args:
        env_id: of a biped under gait actions.
        policy: of the first robot: a name, a file, or MODULE:ATTRIBUTE.
        beside: policy of a second robot; None: there is none.
        start: robots and command at first.
    """

    def __init__(self, env_id: str, policy: str, beside: str | None = None, start: Scenario = ON_THE_SPOT):
        self.env_id, self.start = env_id, start
        self.paused, self.speed = False, 1.0
        self.stands = start.command.stand  # at rest; otherwise it steps in place there
        self.last: LastPush | None = None
        self.lanes = [Lane(env_id, policy, start)]
        self._owed = 0.0  # simulated time to catch up with [s]
        if beside is not None:
            self.put_beside(beside)

    @property
    def first(self) -> Lane:
        """The robot that is always there."""
        return self.lanes[0]

    @property
    def beside(self) -> str | None:
        """Policy of the second robot; None where there is none."""
        return self.lanes[1].name if self.lanes[1:] else None

    def advance(self, seconds: float) -> int:
        """Let the time of the clock go by; returns the planning periods simulated."""
        if self.paused:
            return 0
        period = self.first.period
        self._owed = min(self._owed + seconds * self.speed, PERIODS_MAX * period)
        count = int(self._owed / period + 1e-9)
        self._owed -= count * period
        for _ in range(count):
            self.step()
        return count

    def step(self) -> None:
        """One planning period of every robot."""
        for lane in self.lanes:
            lane.step()

    def pause_or_go_on(self) -> None:
        """Stop the clock, or let it run again."""
        self.paused = not self.paused

    def step_once(self) -> None:
        """Stop the clock after one more planning period."""
        self.paused = True
        self.step()

    def set_speed(self, speed: float) -> None:
        """Simulated seconds a second, in [SLOWEST, FASTEST]."""
        self.speed = require_number("speed", speed, SLOWEST, FASTEST)

    def faster(self, factor: float) -> None:
        """Multiply the speed, as far as it may go."""
        self.speed = min(max(self.speed * factor, SLOWEST), FASTEST)

    def push(self, impulse: ArrayLike, body: Body = "pelvis", kind: str = PUSH) -> Push:
        """Push every robot now with an impulse (2,) [N s], world axes; returns the first one's push.

        Of two robots of one kind the second is first put where the first is: the same push, the same state.
        Of another of KINDS its disturbance is what the impulse says of its size and direction.

        Raises:
            InvalidValueError: the first robot has fallen, or an impossible impulse.
            UnknownNameError: no such kind.
        """
        require_choice("kind of disturbance", kind, tuple(KINDS))
        before = self._aligned()
        chosen = np.asarray(impulse, np.float64)
        pushes = [KINDS[kind](ByHand(chosen, body, lane)).forces[0] for lane in self.lanes]
        for lane, push in zip(self.lanes, pushes, strict=True):
            lane.push(push, kind)
        self.last = LastPush(tuple(pushes), kind, before)
        return pushes[0]

    def drive(self, vx: float, vy: float, turn: float) -> None:
        """Command velocities [m/s] and a turn [rad/s]; at rest the robots stand, or step in place."""
        self.set_command(self._told(Command(vx, vy, turn)))

    def stand_at_rest(self, stands: bool) -> None:
        """Whether robots without a velocity stand on both feet from now on."""
        self.stands = stands
        self.set_command(self._told(self.first.command))

    def set_command(self, command: Command) -> None:
        """Command all robots; those that have fallen will walk so when they start anew."""
        for lane in self.lanes:
            lane.set_command(command)

    def switch(self, policy: str, index: int = 0) -> bool:
        """Let another policy act for a robot from now on; returns whether its walk went on.

        A policy with a robot of its own starts a new walk.

        Raises:
            PushRecoveryError: no such policy, or one that can't act here; all stays as it was.
        """
        new, old = Lane(self.env_id, policy, self.start), self.lanes[index]
        self.lanes[index] = new
        walks = not old.over and _tried(lambda: new.put(old.state()))
        if not walks:
            new.restart(self._told(old.command))
        old.close()
        return walks

    def put_beside(self, policy: str | None) -> None:
        """A second robot under a policy, where the first is; None takes it away.

        Raises:
            PushRecoveryError: no such policy, or one that can't act here; all stays as it was.
        """
        new = None if policy is None else Lane(self.env_id, policy, self.start)
        for lane in self.lanes[1:]:
            lane.close()
        self.lanes[1:] = [] if new is None else [new]
        self.last = None  # its states are of other robots
        if new is None:
            return
        if self.first.over:
            self.restart()
        elif not _tried(lambda: new.put(self.first.state())):
            new.restart(self._told(self.first.command))

    def replay(self) -> Push:
        """Put every robot back to when the last push was given, and push it again, under its policy of now.

        Raises:
            InvalidValueError: nothing has been pushed, or a robot of another kind walks now.
        """
        if self.last is None:
            raise InvalidValueError("there is no push yet that could be replayed")
        for lane, state, push in zip(self.lanes, self.last.before, self.last.pushes, strict=True):
            lane.put(state)
            lane.push(push, self.last.kind)
        if _at_rest(self.first.command):
            self.stands = any(lane.command.stand for lane in self.lanes)
        self._owed = 0.0
        return self.last.push

    def restart(self) -> None:
        """All robots begin a new walk under the command of now."""
        command = self._told(self.first.command)
        for lane in self.lanes:
            lane.restart(command)
        self._owed = 0.0

    def close(self) -> None:
        """Let all robots go."""
        for lane in self.lanes:
            lane.close()

    def _aligned(self) -> tuple[LaneState, ...]:
        """States of all robots, the second put where the first is if it is of the same kind."""
        first = self.first.state()
        for lane in self.lanes[1:]:
            if not _tried(lambda lane=lane: lane.put(first)) and lane.over:
                lane.restart(self._told(self.first.command))
        return (first, *(lane.state() for lane in self.lanes[1:]))

    def _told(self, command: Command) -> Command:
        """A command as robots are told it: at rest to stand, where that has been chosen."""
        return replace(command, stand=self.stands and _at_rest(command))


def _at_rest(command: Command) -> bool:
    return not (command.vx or command.vy or command.turn)


def _tried(call: Callable[[], None]) -> bool:
    """Whether a robot could be put where another one was."""
    try:
        call()
    except InvalidValueError:
        return False
    return True
