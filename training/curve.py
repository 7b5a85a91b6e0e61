"""The learning curve: scores on one fixed set of scenarios as training goes on, reported as they are."""

import csv
import io
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import get_type_hints

import gymnasium as gym
import numpy as np

from ..controllers.errors import InvalidValueError
from ..controllers.files import write_atomically
from ..controllers.model.robot import SAME, Similarity
from ..controllers.policies.interface import Policy
from ..envs.scenario.distribution import PushDistribution, ScenarioDistribution
from ..envs.scenario.scenario import Scenario, get_profile
from ..eval.rollout.episodes import rollout_all
from ..eval.rollout.workers import SLOTS

# Entropy of the scenarios of the curve: not those of any suite, nor of any training episode.
SCENARIO_ENTROPY = 20_260_417
PUSHES = PushDistribution(impulse_min=80.0, impulse_max=200.0)


@dataclass(frozen=True)
class CurvePoint:
    """The policy's score after some training."""

    timesteps: int
    seconds: float  # of wall time, over all parts of the run
    scenarios: int
    recovered: float  # share
    survived: float  # share
    mean_reward: float  # per episode


def curve_scenarios(
    count: int, profile: str = "exact", size: Similarity = SAME, pushes: ScenarioDistribution = PUSHES
) -> list[Scenario]:
    """The first `count` scenarios of the curve: the same ones in every run.

    `profile` is that of the robots, `size` their size against the robot of 60 kg; `pushes` are by default
    like those of `hard`.
    """
    streams, robots = np.random.SeedSequence(SCENARIO_ENTROPY).spawn(count), get_profile(profile)
    drawn = [pushes.sample(np.random.default_rng(s), f"curve-{i:03d}") for i, s in enumerate(streams)]
    return [robots.applied(scenario).scaled(size) for scenario in drawn]


def score(
    env: gym.Env, policy: Policy, scenarios: list[Scenario], timesteps: int, seconds: float
) -> CurvePoint:
    """Run every scenario once on the plain environment."""
    outcomes = rollout_all(env, policy, scenarios, "training", SLOTS)
    recovered, survived, reward = (
        float(np.mean([getattr(outcome, name) for outcome in outcomes]))
        for name in ("recovered", "survived", "total_reward")
    )
    return CurvePoint(timesteps, round(seconds, 3), len(outcomes), recovered, survived, reward)


def write_curve(path: Path, points: list[CurvePoint]) -> None:
    """All points as CSV, whole or not at all."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(CurvePoint)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(point) for point in points)
    write_atomically(path, text.getvalue().encode())


def read_curve(path: Path) -> list[CurvePoint]:
    """The points of a CSV that `write_curve` wrote; none where there is no file.

    Raises:
        InvalidValueError: The file is no learning curve.
    """
    if not path.exists():
        return []
    try:
        with path.open(newline="") as file:
            kinds = get_type_hints(CurvePoint)
            rows = csv.DictReader(file)
            return [CurvePoint(**{name: kind(row[name]) for name, kind in kinds.items()}) for row in rows]
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(f"{path} is no learning curve: {error}") from error
