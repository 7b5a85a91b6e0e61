"""What became of one episode."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from ...envs.biped.bounds_record import BoundsReport
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
    first_limit: str | None = None  # of envs/biped/bounds_record.py, met first since the first push began
    limits_met: Mapping[str, float] = field(default_factory=dict)  # bound -> when first [s], in that order
    limit_shares: Mapping[str, float] = field(default_factory=dict)  # bound -> share of the time since then
    # The last two are keys of the rows that have them alone.
    kick: tuple[float, float, float] | None = None  # first jump of the velocity [m/s]
    measures: Mapping[str, float | int | None] = field(default_factory=dict)  # in UNITS of measures/effort.py

    @classmethod
    def of(cls, scenario: Scenario, policy_name: str, ending: Ending, steps: int) -> Outcome:
        """The row of an episode that has ended after so many environment steps."""
        first = scenario.pushes[0] if scenario.pushes else None
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
            pushes=len(scenario.pushes),
            command=(scenario.command.vx, scenario.command.vy),
            first_limit=next(iter(bounds.met), None),
            limits_met={name: round(time, 6) for name, time in bounds.met.items()},
            limit_shares={name: round(share, 6) for name, share in bounds.shares.items()},
            kick=scenario.kicks[0].velocity if scenario.kicks else None,
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
