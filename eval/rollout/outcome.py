"""Outcome of one episode, scores over many, and measures of what an episode took: torque, energy, lean."""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any, Self

import numpy as np

from ...controllers.model.observation import TRUNK_ANGLE
from ...controllers.validation import (
    Check,
    check_fields,
    each,
    or_none,
    require_integer,
    require_number,
    require_pair,
    require_text,
    require_truth,
    require_vector,
)
from ...controllers.whole_body.kinematics import NU, NV
from ...controllers.whole_body.swing import TURN
from ...envs.biped import env, limits_record
from ...envs.episode.episodes import GaitEpisodes
from ...envs.robots.indices import MISSING
from ...envs.scenario.scenario import Scenario
from ..output.statistics import Array, wilson_interval
from .strategy import StrategyMeter, take_in_stability

Row = Mapping[str, Any]  # an outcome as its file holds it
NO_LIMITS = limits_record.LimitsReport({}, {})
TURNED, BENT = math.radians(30.0), math.radians(90.0)  # what is reported beside recovered [rad]
NOT_SETTLED = "not_settled"  # survived, but the recovery criterion does not hold at the end
REASONS = {  # of a fall or of no recovery, by the key of rows and info
    NOT_SETTLED: "did not settle",
    "com_height": "sank too low",
    "pelvis_tilt": "tipped over",
    "dcm_diverged": "ran away from any step",
    "not_finite": "ran out of numbers",
}


@dataclass(frozen=True)
class Ending:
    """End of one episode, from its environment."""

    fell: bool
    time: float  # since reset [s]
    recovered_at: float | None  # time from which the recovery criterion held [s]
    failure_reason: str | None
    total_reward: float
    bounds: limits_record.LimitsReport = NO_LIMITS  # met; none where the core keeps no record
    measures: Mapping[str, float | int | None] = field(default_factory=dict)  # of an `EffortMeter`, if any


@dataclass(frozen=True)
class Outcome:
    """One row of results: a scenario, a policy and what became of it."""

    scenario_id: str
    policy: str
    survived: bool  # no fall until the end
    recovered: bool  # survived, and back at the nominal gait at the end
    recovered_at: float | None  # time from which the recovery criterion held [s]
    failure_reason: str | None  # of a fall
    end_time: float  # [s]
    env_steps: int
    total_reward: float
    impulse: float  # of the first push [N s]
    psi_deg: float | None  # its direction, counter-clockwise from forward [deg]
    pushes: int
    command: tuple[float, float]  # [m/s]
    first_limit: str | None = None  # of envs/biped/limits_record.py, met first since the first push began
    limits_met: Mapping[str, float] = field(default_factory=dict)  # bound -> when first [s], in that order
    limit_shares: Mapping[str, float] = field(default_factory=dict)  # bound -> share of the time since then
    # The last two are keys of the rows that have them alone.
    kick: tuple[float, float, float] | None = None  # first jump of the velocity [m/s]
    measures: Mapping[str, float | int | None] = field(default_factory=dict)  # by name, see MEASURES

    @classmethod
    def of(cls, scenario: Scenario, policy_name: str, ending: Ending, steps: int) -> Self:
        """The row of an episode that has ended after so many environment steps."""
        first = scenario.forces[0] if scenario.forces else None
        moving = first is not None and (first.force[0] != 0.0 or first.force[1] != 0.0)
        settled, bounds = ending.recovered_at, ending.bounds
        return cls(
            scenario_id=scenario.id,
            policy=policy_name,
            survived=not ending.fell,
            recovered=not ending.fell and settled is not None,
            recovered_at=None if settled is None else float(settled),
            failure_reason=str(ending.failure_reason or "fall") if ending.fell else None,
            end_time=ending.time,
            env_steps=steps,
            total_reward=ending.total_reward,
            impulse=first.impulse_magnitude if first else 0.0,
            psi_deg=math.degrees(first.direction) if first and moving else None,
            pushes=len(scenario.forces),
            command=(scenario.command.vx, scenario.command.vy),
            first_limit=next(iter(bounds.met), None),
            limits_met={name: round(time, 6) for name, time in bounds.met.items()},
            limit_shares={name: round(share, 6) for name, share in bounds.shares.items()},
            kick=scenario.jumps[0].velocity if scenario.jumps else None,
            measures=dict(ending.measures),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        values = {**asdict(self), "command": list(self.command)}
        kick, measures = values.pop("kick"), values.pop("measures")
        if kick is not None:
            values["kick"] = list(kick)
        return {**values, "measures": measures} if measures else values


FIELDS: dict[str, Check] = {  # of a row
    "scenario_id": require_text,
    "policy": require_text,
    "survived": require_truth,
    "recovered": require_truth,
    "recovered_at": or_none(require_number),
    "failure_reason": or_none(require_text),
    "end_time": partial(require_number, low=0.0),
    "env_steps": require_integer,
    "total_reward": require_number,
    "impulse": require_number,
    "psi_deg": or_none(require_number),
    "pushes": require_integer,
    "command": require_pair,
    "first_limit": or_none(require_text),
    "limits_met": each(require_number),
    "limit_shares": each(require_number),
    "kick": require_vector,
    "measures": each(or_none(require_number)),
    "policy_sha256": or_none(require_text),
}


def check_row(row: object, optional: Collection[str] = FIELDS) -> None:
    """Raise InvalidValueError for a field of a row that has a value of another kind than an outcome's."""
    check_fields(row, FIELDS, optional)


def reason_words(reason: str | None) -> str:
    """Why an episode does not count as recovered; a reason of an environment of others stays as it is."""
    return REASONS.get(reason or "", reason or "")


def limit_words(name: str) -> str:
    """The name of a limit as it is spoken."""
    return {"cop": "CoP", "dcm_tracking": "DCM tracking"}.get(name, name.replace("_", " "))


def failure_label(row: Row) -> str:
    """Why a row does not count as recovered."""
    return row["failure_reason"] or ("unknown" if not row["survived"] else NOT_SETTLED)


@dataclass(frozen=True)
class Score:
    """Recovery rate of one policy over a set of rows."""

    recovered: int
    survived: int
    episodes: int
    failures: dict[str, int]  # reason -> episodes that did not recover
    turned: int | None = None  # of those recovered, how many end over TURNED off their heading
    bent: int | None = None  # and how many had a trunk that leaned over BENT; None: not measured

    @classmethod
    def of(cls, rows: Iterable[Row]) -> Self:
        """Count rows as written to the outcome file."""
        rows = list(rows)
        failures = Counter(failure_label(row) for row in rows if not row["recovered"])
        measures = [row["measures"] for row in rows if row["recovered"] and "measures" in row]

        def over(name: str, most: float) -> int | None:
            values = [one[name] for one in measures if one.get(name) is not None]
            return sum(value > most for value in values) if values else None

        return cls(
            recovered=sum(row["recovered"] for row in rows),
            survived=sum(row["survived"] for row in rows),
            episodes=len(rows),
            turned=over("heading_error", TURNED),
            bent=over("trunk_excursion", BENT),
            failures=dict(sorted(failures.items(), key=lambda item: (-item[1], item[0]))),
        )

    @property
    def rate(self) -> float:
        """Share of episodes recovered; 0 without episodes."""
        return self.recovered / self.episodes if self.episodes else 0.0

    @property
    def ci95(self) -> tuple[float, float]:
        """Wilson interval of the rate."""
        return wilson_interval(self.recovered, self.episodes)

    def to_dict(self) -> dict[str, Any]:
        """JSON object of one policy."""
        return {
            "recovered": self.recovered,
            "survived": self.survived,
            "episodes": self.episodes,
            "rate": self.rate,
            "ci95": list(self.ci95),
            "failures": self.failures,
        }


DIGITS = 6  # of a measure in a row, after the point


class EffortMeter:
    """Sums and extremes of n robots that share a core, over the planning periods of their episodes.

    Torques and rates are those of the period's last physics step, true ones where sensors tell others. It
    looks at the robots and touches nothing.

    Args:
        episodes: of the robots. Pendulums have no motors.
    """

    def __init__(self, episodes: GaitEpisodes):
        self.episodes, n = episodes, episodes.n
        self.core: Any = episodes.core
        self.motors = _motors(episodes)
        self.strategy = StrategyMeter(episodes)
        self.driven = sum(name is not None for name in getattr(episodes, "joints", ()))
        self.heading = np.zeros(n)  # that the commands so far ask for [rad]
        self.periods = np.zeros(n, np.int64)  # so far
        self.margin = np.zeros(n)  # smallest capture margin [m]
        self.stability = np.zeros(n)  # smallest margin of stability [m]
        robot = episodes.robot
        self._sole = 0.5 * robot.foot_length, 0.5 * robot.foot_width  # [m]
        self.lean = np.zeros(n)  # largest trunk angle [rad]
        self.peak = np.zeros(n)  # largest torque of a motor [N m]
        self.torque = np.zeros(n)  # sum of |torque| over motors and periods [N m]
        self.power = np.zeros(n)  # sum of |torque x rate| over motors and periods [W]

    def begin(self, k: int) -> None:
        """Forget robot k, which begins an episode."""
        self.periods[k], self.margin[k], self.stability[k] = 0, np.inf, np.inf
        self.strategy.begin(k)
        self.heading[k] = self.episodes.motion().heading[k]
        for sums in (self.lean, self.peak, self.torque, self.power):
            sums[k] = 0.0

    def look(self) -> None:
        """Take in the period that has ended, for all robots."""
        core, largest, added = self.core, np.maximum.reduce, np.add.reduce
        self.periods += 1
        if self.episodes.both_feet:
            self.strategy.look()
        np.fmin(self.margin, core.margin, out=self.margin)
        take_in_stability(core.truth, *self._sole, self.stability)
        np.fmax(self.lean, largest(np.abs(core.truth[:, TRUNK_ANGLE]), axis=1), out=self.lean)
        if self.motors:
            self.heading += core.command[:, TURN] * (1.0 / self.episodes.control_hz)
            torque = np.abs(self._of_motors(core.physics.ctrl[:, :NU]))
            np.fmax(self.peak, largest(torque, axis=1), out=self.peak)
            self.torque += added(torque, axis=1)
            torque *= self._of_motors(self._rates())
            self.power += added(np.abs(torque, out=torque), axis=1)

    def _of_motors(self, values: Array) -> Array:
        """Columns (n, motors) of values (n, 14)."""
        return values if len(self.motors) == NU else values.take(self.motors, axis=1)

    def _rates(self) -> Array:
        """True rates of the joints that control moves, (n, 14) [rad/s]; held ones come after them."""
        return self.core.true_values("qvel")[:, NV - NU : NV]

    def first_push(self, k: int) -> float:
        """When the first push or kick of robot k began, since reset [s]; inf where none has."""
        start = float(self.core.pushes.start[k].min(initial=np.inf))
        return start if start < self.episodes.motion().time[k] else np.inf

    def turned(self, k: int) -> float:
        """How far robot k is off the heading that its commands ask for [rad], up to pi."""
        off = self.episodes.motion().heading.item(k) - self.heading.item(k)
        return abs(math.remainder(off, math.tau))

    def of(self, k: int) -> dict[str, float | int | None]:
        """Measures of robot k in its episode by name; None where one is not known."""
        touchdowns = self.episodes.monitor.state.touchdowns.item(k)
        stood, lawful = self.strategy.strategy(k) is not None, bool(self.core.pushes.law[k].any())
        found = {}
        for name, measure in MEASURES.items():
            has = (self.motors or not measure.motors) and (stood or not measure.stood)
            has = has and (self.driven > 0 or not measure.driven) and (lawful or not measure.lawful)
            if measure.of is not None and has:
                value = measure.of(self, k)
                known = math.isfinite(value) and touchdowns >= measure.touchdowns
                found[name] = round(value, DIGITS) if known else None
        return found


@dataclass(frozen=True)
class Measure:
    """A number of an episode: how a row gets it, and how tables and pages show it."""

    of: Callable[[EffortMeter, int], float | int] | None = None  # of robot k; not finite: not known
    label: str = ""  # of its column; what has none stands in rows alone
    unit: str = ""  # of the column
    digits: int = 0
    factor: float = 1.0  # from the unit of the row to that of the column
    about: str = ""  # what the label leaves open
    brief: str = ""  # the number in a line about one episode, as a format; none: it has no place there
    touchdowns: int = 0  # before which it is not known
    motors: bool = False  # only of robots that have some
    stood: bool = False  # only of robots that have stood on both feet when told to
    driven: bool = False  # only of robots all of whose joints follow an action
    lawful: bool = False  # only of robots with a push that follows a law
    value: Callable[[Row, Scenario], float | None] | None = None  # of the column; by default that of the row

    def text(self, value: float | None) -> str:
        """A value of a row, in the unit of the column."""
        return "-" if value is None else f"{value * self.factor:.{self.digits}f}"


NONE_DRIVEN = "-"


def driven_joints(rows: Sequence[Row]) -> str:
    """How many joints a policy gives targets of; NONE_DRIVEN for one that acts otherwise."""
    counts = {row.get("measures", {}).get("driven_joints") for row in rows} - {None}
    return ", ".join(map(str, sorted(counts))) or NONE_DRIVEN


def recovered_after(row: Row, scenario: Scenario) -> float | None:
    """Time from the end of the last push, or from a later change of command, to recovery [s].

    An episode ends `settle_time` after that.
    """
    if row.get("recovered_at") is None:
        return None
    return max(row["recovered_at"] - (row["end_time"] - scenario.settle_time), 0.0)


# By the key of a row; one that is added here stands in every row, and in every report if it has a label. Over
# the periods i of an episode, each dt long, with m motors j:
#     peak torque = max |tau_ij|,  mean torque = mean |tau_ij|,  energy = sum |tau_ij w_ij| dt.
MEASURES: dict[str, Measure] = {
    "recovered_after": Measure(
        None, "recovered after", "s", 2, value=recovered_after,
        about="from the end of the last push to the touchdown at which the recovery criterion holds",
    ),
    "first_push": Measure(lambda seen, k: seen.first_push(k)),  # [s]
    "steps": Measure(lambda seen, k: seen.episodes.motion().steps.item(k), "steps"),
    "smallest_margin": Measure(  # [m]
        lambda seen, k: seen.margin.item(k), "smallest margin", "cm", 1, 100.0, brief="margin {:.0f} cm",
        about="by how much the DCM could still be off before no step catches it; the smallest of an episode "
        "says how near a fall was",
    ),
    "margin_of_stability": Measure(  # [m]
        lambda seen, k: seen.stability.item(k), "margin of stability", "cm", 1, 100.0,
        "the smallest distance of the extrapolated CoM, which is the DCM, from the border of the base of "
        "support (Hof 2005); negative outside",
    ),
    "dcm_error": Measure(lambda seen, k: seen.episodes.monitor.state.error.item(k, 0), touchdowns=1),  # [m]
    "velocity_error": Measure(  # [m/s]
        lambda seen, k: seen.episodes.monitor.state.speed_error.item(k), touchdowns=3
    ),
    "trunk_excursion": Measure(  # [rad]
        lambda seen, k: seen.lean.item(k), "largest lean", "deg", 1, math.degrees(1.0),
        "of the trunk, in pitch or roll", "lean {:.0f} deg",
    ),
    "heading_error": Measure(  # [rad]
        lambda seen, k: seen.turned(k), "off heading", "deg", 1, math.degrees(1.0),
        "at the end of the episode, against the commanded turn", motors=True,
    ),
    "peak_torque": Measure(
        lambda seen, k: seen.peak.item(k), "peak torque", "N m", about="of a single motor", motors=True
    ),
    "mean_torque": Measure(
        lambda seen, k: seen.torque.item(k) / (max(seen.periods.item(k), 1) * len(seen.motors)),
        "mean torque", "N m", 1, about="over motors and time", motors=True,
    ),
    "energy": Measure(  # [J]
        lambda seen, k: seen.power.item(k) * (1.0 / seen.episodes.control_hz), "energy", "kJ", 2, 1e-3,
        "the sum of |torque times joint speed| over motors and time, braking included", "{:.1f} kJ",
        motors=True,
    ),
    "driven_joints": Measure(lambda seen, k: seen.driven, driven=True),
    "delivered": Measure(  # [N s]
        lambda seen, k: float(np.linalg.norm(seen.core.pushes.delivered[k].sum(axis=0))), lawful=True
    ),
    "soles_margin": Measure(lambda seen, k: seen.strategy.stance.soles.item(k), stood=True),  # [m]
    "lift_off_margin": Measure(lambda seen, k: seen.strategy.stance.lift_off.item(k), stood=True),  # [m]
}  # fmt: skip


def _motors(episodes: GaitEpisodes) -> list[int]:
    """Indices of control's 14 motors that the robot has; none for a pendulum."""
    if not isinstance(episodes, env.BipedEpisodes):
        return []
    return [i for i, motor in enumerate(episodes.core.body.indices.motors) if motor != MISSING]
