"""What became of one episode, and what it took: torque, energy, lean.

What became of one episode.

What an episode took: torque, energy, lean, and how near it came to a fall, by planning period.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.observation import TRUNK_ANGLE
from ...controllers.whole_body.kinematics import NU, NV
from ...envs.biped.env import BipedEpisodes
from ...envs.biped.limits_record import BoundsReport
from ...envs.episode.episodes import GaitEpisodes, Period
from ...envs.robots.indices import MISSING
from ...envs.scenario.scenario import Scenario
from ..output.statistics import wilson_interval

NO_BOUNDS = BoundsReport({}, {})
NOT_SETTLED = "not_settled"  # survived, but the recovery criterion does not hold at the end


@dataclass(frozen=True)
class Ending:
    """How one episode has ended, as its environment tells of it."""

    fell: bool
    time: float  # since reset [s]
    recovered_at: float | None  # time from which the recovery criterion held [s]
    failure_reason: str | None
    total_reward: float
    bounds: BoundsReport = NO_BOUNDS  # met; none where the core keeps no record
    measures: Mapping[str, float | int | None] = field(default_factory=dict)  # of `EffortMeter`, if any


@dataclass(frozen=True)
class Outcome:
    """One row of results: a scenario, a policy, what happened."""

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
    measures: Mapping[str, float | int | None] = field(default_factory=dict)  # in UNITS of measures/effort.py

    @classmethod
    def of(cls, scenario: Scenario, policy_name: str, ending: Ending, steps: int) -> Outcome:
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


def failure_label(row: Mapping[str, Any]) -> str:
    """Why a row does not count as recovered."""
    return row["failure_reason"] or ("unknown" if not row["survived"] else NOT_SETTLED)


@dataclass(frozen=True)
class Score:
    """Recovery rate of one policy over a set of rows."""

    recovered: int
    survived: int
    episodes: int
    failures: dict[str, int]  # reason -> episodes that did not recover

    @classmethod
    def of(cls, rows: Iterable[Mapping[str, Any]]) -> Score:
        """Count rows as written to the outcome file."""
        rows = list(rows)
        failures = Counter(failure_label(row) for row in rows if not row["recovered"])
        return cls(
            recovered=sum(row["recovered"] for row in rows),
            survived=sum(row["survived"] for row in rows),
            episodes=len(rows),
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
        """The contract's object of one policy."""
        return {
            "recovered": self.recovered,
            "survived": self.survived,
            "episodes": self.episodes,
            "rate": self.rate,
            "ci95": list(self.ci95),
            "failures": self.failures,
        }


Array = NDArray[np.float64]
Measures = dict[str, float | int | None]
DIGITS = 6  # of a number in a row, after the point
UNITS = {  # of what `EffortMeter.of` tells
    "steps": "1", "smallest_margin": "m", "dcm_error": "m", "velocity_error": "m/s", "trunk_excursion": "rad",
    "peak_torque": "N m", "mean_torque": "N m", "energy": "J",
}  # fmt: skip
JUDGED = {"dcm_error": 1, "velocity_error": 3}  # touchdowns after which it is known


class EffortMeter:
    """Measures n robots that share a core, at the end of every planning period; it only looks.

    Torques and rates are those of the period's last physics step, true ones where sensors tell others. Over
    the periods i of an episode, each dt long, with motors j:

        peak torque = max |tau_ij|,  mean torque = mean |tau_ij|,  energy = sum |tau_ij w_ij| dt.

    Args:
        episodes: of the robots. Pendulums have no motors.
    """

    def __init__(self, episodes: GaitEpisodes):
        self._episodes, n = episodes, episodes.n
        self._core: Any = episodes.core
        self._dt = 1.0 / episodes.control_hz
        self._motors = _motors(episodes)
        self._periods = np.zeros(n, np.int64)
        self._margin, self._lean = np.zeros(n), np.zeros(n)
        self._peak, self._torque, self._power = np.zeros(n), np.zeros(n), np.zeros(n)

    def begin(self, k: int) -> None:
        """Forget robot k, which begins an episode."""
        self._periods[k], self._margin[k] = 0, np.inf
        for sums in (self._lean, self._peak, self._torque, self._power):
            sums[k] = 0.0

    def look(self) -> None:
        """Take in the period that has ended, for all robots."""
        core, largest, added = self._core, np.maximum.reduce, np.add.reduce
        self._periods += 1
        np.fmin(self._margin, core.margin, out=self._margin)
        np.fmax(self._lean, largest(np.abs(core.truth[:, TRUNK_ANGLE]), axis=1), out=self._lean)
        if self._motors:
            torque = np.abs(self._of_motors(core.physics.ctrl))
            np.fmax(self._peak, largest(torque, axis=1), out=self._peak)
            self._torque += added(torque, axis=1)
            torque *= self._of_motors(self._rates())
            self._power += added(np.abs(torque, out=torque), axis=1)

    def _of_motors(self, values: Array) -> Array:
        """Columns (n, motors) of values (n, 14)."""
        return values if len(self._motors) == NU else values.take(self._motors, axis=1)

    def _rates(self) -> Array:
        """True rates of the joints that control moves, (n, 14) [rad/s]; held ones come after them."""
        exact, senses = self._core.physics.qvel, self._core.senses
        if senses.last.judged is not self._core.physics:
            exact = np.where(senses.onboard[:, None], senses.last.judged.qvel, exact)
        return exact[:, NV - NU : NV]

    def of(self, k: int) -> Measures:
        """What robot k has done in its episode, in UNITS; None where it is not known."""
        judged = self._episodes.monitor.state
        found: dict[str, float] = {
            "smallest_margin": self._margin.item(k),
            "dcm_error": judged.error.item(k, 0),
            "velocity_error": judged.speed_error.item(k),
            "trunk_excursion": self._lean.item(k),
        }
        if self._motors:
            samples = max(self._periods.item(k), 1) * len(self._motors)
            found["peak_torque"] = self._peak.item(k)
            found["mean_torque"] = self._torque.item(k) / samples
            found["energy"] = self._power.item(k) * self._dt
        touchdowns = judged.touchdowns.item(k)
        told = {
            name: round(value, DIGITS) if math.isfinite(value) and touchdowns >= JUDGED.get(name, 0) else None
            for name, value in found.items()
        }
        return {"steps": self._episodes.motion().steps.item(k), **told}


class StepMeter(EffortMeter):
    """Of the one robot of an environment; it looks by itself, at each period that an action is held for."""

    def begin(self, k: int) -> None:
        """Forget the robot, and look at every planning period from here on."""
        super().begin(k)
        self._episodes.step = self  # type: ignore[method-assign]

    def __call__(self, actions: NDArray[np.float32]) -> Period:
        """One planning period of the episodes, looked at."""
        period = type(self._episodes).step(self._episodes, actions)
        self.look()
        return period

    def of(self, k: int) -> Measures:
        """What the robot has done in its episode, which is over."""
        vars(self._episodes).pop("step", None)
        return super().of(k)


def _motors(episodes: GaitEpisodes) -> list[int]:
    """Which of control's 14 motors the robot has; none for a pendulum."""
    if not isinstance(episodes, BipedEpisodes):
        return []
    return [i for i, motor in enumerate(episodes.core.body.indices.motors) if motor != MISSING]
