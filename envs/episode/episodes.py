"""Episodes of n robots on one core: start, planning period, reward, end, and actions that are held.

`Core` is what episodes need of the physics of n robots: the seam between a kind of robot and its episodes.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...controllers.array_table import NO_STATE, parts_table
from ...controllers.errors import InvalidValueError
from ...controllers.jit import announce_compilation
from ...controllers.model.gait_box import DURATION, GAIT_SIZE, GaitLimits
from ...controllers.model.nominal_gait import (
    NominalGait,
    NominalStart,
    gaits_of_actions,
    nominal_gait,
    nominal_start,
    standing_start,
)
from ...controllers.model.observation import OBSERVATION_SIZE, side_sign
from ...controllers.model.robot import RobotModel
from ...controllers.policies.interface import Policy
from ...controllers.policies.residual import ResidualGate
from ...controllers.settings import preset_config, preset_names
from ...controllers.validation import require_integer, require_kind, require_number
from ..scenario.arrays import Pushes
from ..scenario.distribution import ScenarioDistribution
from ..scenario.push import SIDES
from ..scenario.scenario import EXACT, Profile, Profiles, Scenario
from ..snapshot import Arrays, RobotSnapshot, arrays_of, take_rows
from . import period_end
from .recovery import GaitMonitor, uphill_dcm

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Measure = Callable[[Any], NDArray[Any]]  # of `GaitEpisodes`: one value for each robot, (n, ...)

ROBOTS_MAX = 100_000
OF_SCENARIO = (  # rows of a snapshot that the scenario says anew where a robot is put back
    "episodes.pushes", "episodes.changed", "episodes.fixed", "episodes.settle", "episodes.uphill",
    "schedule.time", "schedule.command",
)  # fmt: skip


class Core(Protocol):
    """n robots, none of which depends on another; the arrays are those of the moment, written in place."""

    observation: Array  # (n, 36) what policies see
    truth: Array  # (n, 36) the same without noise, to judge by
    command: Array  # (n, 4) in force: velocity in the heading frame [m/s], turn [rad/s], 1: stand
    previous_action: Array  # (n, 7)
    margin: Array  # (n,) capture margin [m]
    world: Array  # (n, 6) DCM, CoP and CMP in the world [m]
    pushes: Pushes  # replaced by a larger one where a scenario has more pushes than fit

    def assign(self, k: int, scenario: Scenario) -> None:
        """Give robot k what a scenario says: errors, pushes and changes to come; put it somewhere next."""
        ...

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Put robot k at the start of a nominal step of a scenario; `gait` (7,), `action` (7,) are its."""
        ...

    def step(self, gaits: Array, actions: Array) -> None:
        """Hold gait variables (n, 7) for one planning period; the observation repeats `actions` (n, 7)."""
        ...


C = TypeVar("C", bound=Core)


class Period(NamedTuple):
    """The end of one planning period of n robots; the next one writes over it."""

    reward: period_end.Reward
    failed: Mask  # (n,)
    truncated: Mask  # (n,)


class GaitEpisodes(ABC, Generic[C]):
    """Episodes of n robots of one kind, whose physics is `core`; none depends on the others."""

    failures: ClassVar[tuple[str, ...]]  # reasons of a fall; index 0 is none
    has_double_support: ClassVar[bool] = False  # whether it walks with it
    force_grid: ClassVar[float] = 20.0  # on which a frontier is scanned by default [N]
    turns: ClassVar[bool] = True  # whether it follows commands to turn
    takes_kicks: ClassVar[bool] = False  # whether its velocity can jump
    takes_laws: ClassVar[bool] = False  # whether pushes may follow a law
    stands: ClassVar[bool] = False  # whether it stands on both feet where it is told to
    walks: ClassVar[bool] = False  # whether a planner can walk it, and it can be put back into its walk
    gate: ResidualGate | None = None  # of corrections of a planner within
    name: ClassVar[str]  # of the environment, for errors
    observation_size: ClassVar[int] = OBSERVATION_SIZE  # of what policies see
    action_size: ClassVar[int] = GAIT_SIZE
    reward_terms: tuple[str, ...] = period_end.REWARD_TERMS
    profile: Profile | Profiles = EXACT  # of the robots in scenarios that are drawn
    core: C

    def __init__(
        self, n: int, robot: RobotModel, limits: GaitLimits, preset: str, control_hz: float, variant: str = ""
    ):
        """Set up all but the core; the timing of touchdowns is the preset's for the policy `variant`.

        Raises:
            InvalidValueError: no robot or too many; a robot or limits that are none; a rate outside
                20-1000 Hz; or a preset with double support, which the environment does not know.
            UnknownNameError: for an unknown preset.
        """
        n = require_integer("num_envs", n, 1, ROBOTS_MAX)
        require_kind("robot", robot, RobotModel)
        require_kind("limits", limits, GaitLimits)
        control_hz = require_number("control_hz [Hz]", control_hz, 20.0, 1000.0)
        config = preset_config(preset, variant)
        if config.double_support > 0 and not self.has_double_support:
            valid = [name for name in preset_names() if preset_config(name).double_support == 0]
            raise InvalidValueError(
                f"preset {preset!r} walks with double support of {config.double_support} s, which "
                f"{self.name} does not know; choose from: {', '.join(valid)}"
            )
        announce_compilation()
        self.n, self.robot, self.limits, self.preset = n, robot, limits, preset
        self.control_hz, self.variant = control_hz, variant
        timing = self.touchdown_delay, self.double_support = config.touchdown_delay, config.double_support
        self.both_feet = self.double_support > 0.0  # whether a robot may be on both feet at a time
        self.monitor = GaitMonitor(self.n)
        self.planned = np.ones(n)  # step duration T that the last action asked for [s]
        self._episodes = period_end.Episodes(
            pushes=np.zeros(n, np.int64), changed=np.zeros(n), fixed=np.full(n, np.nan), settle=np.zeros(n),
            uphill=np.zeros((n, 2)), before=np.zeros((n, GAIT_SIZE)), planned=self.planned, event=np.zeros(n),
            terms=np.zeros((n, len(period_end.REWARD_TERMS))), total=np.zeros(n),
        )  # fmt: skip
        self._ends = np.zeros((2, n), np.bool_)  # failed, truncated
        self._constants = period_end.period_constants(robot, limits, *timing)
        self.robots: period_end.Robots | Any = None  # arrays of the core, from the first `begin` on
        self.measures: dict[str, Measure] = {}  # that `info` has besides
        self._added_terms: list[Measure] = []
        self._scenarios: list[Scenario | None] = [None] * n

    def clone(self, n: int, threads: int = 1) -> Self:
        """Episodes of n such robots, of their own; `threads` share the physics where that is worth it."""
        clone = self._clone(n, threads)
        clone.measures, clone._added_terms = self.measures.copy(), self._added_terms.copy()
        clone.reward_terms = self.reward_terms
        return clone

    @abstractmethod
    def _clone(self, n: int, threads: int) -> Self:
        """Episodes of n such robots, without measures and terms that were added."""

    def add_reward_term(self, term: Measure, name: str = "") -> None:
        """Count one more term in the reward of every period to come.

        Args:
            term: a function of these episodes to its value for each robot, (n,), at the end of a period.
            name: in `info["reward_terms"]`; by default the function's.

        Raises:
            InvalidValueError: a term of that name is there.
        """
        name = name or term.__name__
        if name in self.reward_terms:
            raise InvalidValueError(f"the reward has a term {name!r} already: {', '.join(self.reward_terms)}")
        self.reward_terms = (*self.reward_terms, name)
        self._added_terms.append(term)

    def add_measure(self, measure: Measure, name: str = "") -> None:
        """Have `info` hold one more number of every robot.

        Args:
            measure: a function of these episodes to its value for each robot, (n, ...).
            name: the key; by default the function's name.
        """
        self.measures[name or measure.__name__] = measure

    @abstractmethod
    def motion(self) -> period_end.Motion:
        """Steps, CoM, time and stance sides."""

    def action_settings(self) -> dict[str, Any]:
        """Settings that an action's meaning depends on, beside robot, gait box and planning rate."""
        return {}

    @property
    def seen(self) -> Array:
        """Observations of policies, (n, observation_size); the array of the moment, written in place."""
        return self.core.observation

    def planner_info(self) -> dict[str, tuple[NDArray[Any], Mask]]:
        """Entries of `info` of a planner within: key -> values (n, ...), and which robots (n,) have one."""
        return {}

    def more_info(self) -> dict[str, tuple[NDArray[Any], Mask]]:
        """Entries of `info` beside those of every robot: of the planner within, and the measures."""
        everyone = np.ones(self.n, np.bool_)
        added = {name: (measure(self), everyone) for name, measure in self.measures.items()}
        return self.planner_info() | added

    @abstractmethod
    def failure(self) -> Ints:
        """Why the robots have fallen, (n,) index into `failures`."""

    def drawn(self, pushes: ScenarioDistribution, rng: np.random.Generator) -> Scenario:
        """A scenario from a distribution, on a robot of this profile."""
        return self.profile.applied(pushes.sample(rng))

    def info_rows(self) -> Array:
        """Numbers of the moment for `info`, (n, COLUMNS) of `period_end`; a fresh array."""
        rows = np.empty((self.n, period_end.COLUMNS))
        period_end.write_info(self._table, rows)
        return rows

    def gaits(self, actions: NDArray[Any]) -> Array:
        """Gait variables (n, 7) that actions (n, 7) mean now; on both feet the CoP may be between them."""
        if not self.both_feet:
            return self.limits.from_action(actions)
        seen = self.core.observation
        return gaits_of_actions(self.limits, seen, actions, self.double_support)

    def walk(self, planner: Policy) -> Period:
        """One planning period under the actions of a planner of gaits."""
        return self.step(planner.predict(self.core.observation)[0])

    def nominal(self, vx: float, vy: float) -> NominalGait:
        """Nominal gait of a velocity in the canonical frame [m/s]."""
        return nominal_gait(self.robot, self.limits, (vx, vy), self.touchdown_delay, self.double_support)

    def begin(self, k: int, scenario: Scenario) -> None:
        """Put robot k at the beginning of a nominal step of a scenario.

        Raises:
            InvalidValueError: a command to turn for a robot that does not, or a disturbance that it does not
                take.
        """
        self._assign(k, scenario)
        sign = side_sign(SIDES.index(scenario.stance_side))
        gait = self.nominal(scenario.command.vx, sign * scenario.command.vy)
        start = nominal_start(
            gait, self.robot.pelvis_width, self.robot.omega, self.touchdown_delay, self.double_support
        )
        values = np.array([gait.length, gait.width, gait.duration, 0.0, 0.0, 0.0, 0.0])
        if scenario.command.stand:
            start = standing_start(self.robot.pelvis_width, scenario.stride)
            values[DURATION] = self.limits.duration_max
        self.core.reset(k, scenario, start, values, self.limits.to_action(values).astype(np.float64))
        self._bind_if_new()
        self.monitor.reset(k)
        self.planned[k] = gait.duration
        self._episodes.before[k] = self.core.previous_action[k]

    def _assign(self, k: int, scenario: Scenario) -> None:
        """Give robot k what a scenario says; it has to be put somewhere next."""
        rate = max((scenario.command.turn, *(change.command.turn for change in scenario.changes)), key=abs)
        if rate and not self.turns:
            raise InvalidValueError(
                f"{self.name} does not turn: Command.turn must be 0 rad/s, got {rate:g} "
                f"in scenario {scenario.id!r}"
            )
        if scenario.jumps and not self.takes_kicks:
            raise InvalidValueError(
                f"{self.name} takes no kicks, only pushes: Scenario.kicks must be empty, got "
                f"{scenario.jumps[0]} in scenario {scenario.id!r}"
            )
        parts = (*scenario.pushes, *scenario.disturbances)
        lawful = next((part for part in parts if any(push.law for push in part.forces)), None)
        if lawful and not self.takes_laws:
            raise InvalidValueError(
                f"{self.name} takes no {lawful.json_name}, only constant pushes and what is made of them, "
                f"got {lawful} in scenario {scenario.id!r}"
            )
        commands = scenario.command, *(change.command for change in scenario.changes)
        if not self.stands and any(command.stand for command in commands):
            raise InvalidValueError(
                f"{self.name} does not stand: Command.stand must be False in scenario {scenario.id!r}"
            )
        self.both_feet = self.both_feet or any(command.stand for command in commands)
        self._scenarios[k] = scenario
        self._episodes.pushes[k] = len(scenario.forces)
        self._episodes.changed[k] = scenario.last_sudden_change
        self._episodes.fixed[k] = np.nan if scenario.duration is None else scenario.duration
        self._episodes.settle[k] = scenario.settle_time
        self._episodes.uphill[k] = uphill_dcm(self.robot.com_height, *scenario.errors.tilt)

    def state_snapshot(self, k: int) -> RobotSnapshot:
        """The whole state of robot k between two planning periods.

        Raises:
            InvalidValueError: the robot has not begun, or is of a kind that is not put back.
        """
        scenario = self._scenarios[k]
        if scenario is None:
            raise InvalidValueError(f"robot {k} has no state yet: reset it before its snapshot is taken")
        rows = take_rows(self._arrays(k), k, self.n) | self._beside_arrays(k)
        return RobotSnapshot(scenario, float(self.motion().time[k]), self._made_for(scenario), rows)

    def restore(self, k: int, snapshot: RobotSnapshot, scenario: Scenario | None = None) -> None:
        """Put robot k where another one was, of these or of other episodes of the same kind.

        Args:
            k: the robot.
            snapshot: of the other one.
            scenario: that goes on from there; by default the snapshot's own. It may have other pushes that
                have not begun, and another end.

        Raises:
            InvalidValueError: a snapshot of another kind of robot, or a scenario that differs in what has
                happened already.
        """
        then = require_kind("snapshot", snapshot, RobotSnapshot).scenario
        snapshot.check_made_for(self._made_for(then))
        scenario = then if scenario is None else require_kind("scenario", scenario, Scenario)
        kept = snapshot.check_scenario(scenario)
        self._assign(k, scenario)
        self.core.assign(k, scenario)
        self._bind_if_new()
        self._put_beside_arrays(k, snapshot)
        for name, array in self._arrays(k).items():
            if name.startswith("pushes."):
                array[k, kept] = snapshot.rows[name][kept]
            elif name not in OF_SCENARIO:
                array[k] = snapshot.rows[name]

    def _arrays(self, k: int) -> Arrays:
        """Arrays of n robots whose rows k are the state of robot k, by PART.FIELD."""
        return arrays_of(period_end.PeriodArrays(self.robots, self._episodes, self.monitor.state), {NO_STATE})

    def _made_for(self, scenario: Scenario) -> dict[str, str]:
        """Properties that environments must share for a robot of a scenario to go from one to the other."""
        raise InvalidValueError(
            f"{self.name} takes no snapshots of its robots; only those of bipeds can be put back"
        )

    def _beside_arrays(self, k: int) -> Arrays:
        """State of robot k that is in no array."""
        return {}

    def _put_beside_arrays(self, k: int, snapshot: RobotSnapshot) -> None:
        """Put it back."""

    def step(self, actions: NDArray[np.float32]) -> Period:
        """One planning period of all robots under actions (n, 7) in [-1, 1]; those at their end go on too."""
        asked = actions.astype(np.float64)
        gaits = self.gaits(asked)
        self.core.step(gaits, asked)
        return self._end_period(gaits)

    def _end_period(self, gaits: Array) -> Period:
        """Count what a period under gaits (n, 7) was worth and who has come to an end."""
        period_end.end_period(self._table, self._constants, gaits, self._ends)
        return self._with_added_terms()

    def _with_added_terms(self) -> Period:
        """The period that has ended, with the reward terms that users have added."""
        if not self._added_terms:
            return self._period
        added = np.stack([term(self) for term in self._added_terms], axis=1)
        total, terms = self._period.reward
        reward = period_end.Reward(total + added.sum(axis=1), np.concatenate([terms, added], axis=1))
        return self._period._replace(reward=reward)

    def _bind_if_new(self) -> None:
        """Write the address table anew where the core has new arrays, for more pushes than fitted."""
        if self.robots is None or self.core.pushes.start is not self.robots.push_start:
            self._bind()

    def _bind(self) -> None:
        """Write the address table anew."""
        core, motion, episodes = self.core, self.motion(), self._episodes
        self.robots = period_end.Robots(
            *motion, self.failure(), core.truth, core.margin, core.command, core.previous_action,
            core.pushes.start, core.pushes.duration, core.world,
        )  # fmt: skip
        self._table = parts_table(period_end.PeriodArrays(self.robots, episodes, self.monitor.state))
        self._period = Period(period_end.Reward(episodes.total, episodes.terms), *self._ends)

    def __copy__(self) -> Self:
        """A copy shares no array with its original, or is refused (a biped's)."""
        return copy.deepcopy(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """A copy has arrays of its own."""
        vars(self).update(state)
        if self.robots is not None:
            self._bind()


class Held(NamedTuple):
    """A held action of n robots, each up to the end of its episode."""

    reward: Array  # (n,) summed over the periods
    terms: Array  # (n, terms) of it, in the order of the episodes' reward_terms
    failed: Mask  # (n,)
    truncated: Mask  # (n,)


def hold_action(
    episodes: GaitEpisodes,
    live: Mask,
    periods: int,
    act: Callable[[Mask], NDArray[np.float32]],
    at_end: Callable[[Mask, int, Held], None],
    watch: Callable[[], None] | None = None,
) -> Held:
    """Step the episodes with one action for some periods, or until all of them have ended.

    Args:
        episodes: of n robots.
        live: (n,) whose episodes count; the core moves the others, too.
        periods: for which the action is held.
        act: actions (n, action_size) of a period, given which robots (n,) are still in their episode.
        at_end: called with the robots (n,) whose episode ended in a period, how many periods were left of
            the action, and the sums so far: the core goes on with them.
        watch: called after every period.
    """
    n, terms, live = episodes.n, len(episodes.reward_terms), live.copy()
    held = Held(np.zeros(n), np.zeros((n, terms)), np.zeros(n, np.bool_), np.zeros(n, np.bool_))
    for left in reversed(range(periods)):
        period = episodes.step(act(live))
        if watch is not None:
            watch()
        held.reward[live] += period.reward.total[live]
        held.terms[live] += period.reward.terms[live]
        held.failed[live] = period.failed[live]
        held.truncated[live] = period.truncated[live]
        over = live & (held.failed | held.truncated)
        if over.any():
            at_end(over, left, held)
            live &= ~over
        if not live.any():
            break
    return held
