"""What a command is about to do and about how long that takes, in words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ...envs.scenario.scenario import Scenario

# Seconds of one core for a second of one robot with its planner, on a server of 2023. Sensors, networks and
# MPC take up to twice as much, and robots that fall early less.
COST = {"Pendulum": 0.0015, "Biped": 0.015}
OTHERS = 0.03  # of robots that are not of this package
EVENT = 2.0  # when the moment of the gait comes that a push waits for [s]
UNITS = (("seconds", 1.0), ("minutes", 60.0), ("hours", 3600.0))


@dataclass(frozen=True)
class Work:
    """Said before it begins, so that nobody waits without knowing for what."""

    what: str
    how_long: str
    place: Path | None = None  # of the output

    def __str__(self) -> str:
        where = "" if self.place is None else f"; output in {self.place}"
        return f"{self.what}: {self.how_long}{where}"


def about(seconds: float) -> str:
    """A length of time as a guess is told: "a few seconds", "about 40 seconds", "about 3 minutes".

    Args:
        seconds: the guess; 0 where everything is there already.
    """
    if seconds <= 0.0:
        return "nothing is left to run"
    if seconds < 10.0:
        return "a few seconds"
    name, unit = [entry for entry in UNITS if seconds >= 1.5 * entry[1]][-1]
    step = 10 if seconds >= 20.0 * unit else 5 if seconds >= 10.0 * unit else 1
    return f"about {step * round(seconds / unit / step)} {name}"


def robot_seconds(env_id: str, simulated: float, workers: int = 1) -> float:
    """Wall seconds for so many simulated seconds of one robot, about.

    Args:
        env_id: environment.
        simulated: of all episodes together [s].
        workers: processes, each on a core of its own.
    """
    cost = next((value for kind, value in COST.items() if kind in env_id), OTHERS)
    return cost * simulated / max(workers, 1)


def episode_seconds(env_id: str, scenarios: Iterable[Scenario], workers: int = 1) -> float:
    """Wall seconds for one episode of each scenario, about, where no robot falls."""
    return robot_seconds(env_id, sum(map(_end, scenarios)), workers)


def _end(scenario: Scenario) -> float:
    """When an episode ends [s], about where its pushes wait for a moment of the gait."""
    starts = [push.start if isinstance(push.start, float) else EVENT for push in scenario.pushes]
    ends = [start + push.duration for start, push in zip(starts, scenario.pushes, strict=True)]
    return scenario.end_time(max(ends, default=0.0))
