"""DAgger: a learner is shown what the teacher would do in the states that the learner itself comes to.

Ross, Gordon, Bagnell, A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning, AISTATS 2011. All rounds' samples are kept, and every round fits on batches of all.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file
from ...controllers.json_text import parse_json
from ...controllers.learned.description import PolicyDescription
from ...controllers.learned.network import NetworkPolicy
from ...controllers.learned.policy_file import policy_paths
from ...envs.joint.episodes import JointEpisodes
from ...envs.joint.taught import TaughtEpisodes
from .collector import Collector, Floats
from .settings import ImitationSettings
from .student import Student


@dataclass(frozen=True)
class Round:
    """How a round went."""

    number: int
    samples: int  # so far
    loss: float  # mean of its gradient steps
    alone: float  # robot seconds that the learner has walked in it [s]
    falls: int  # of robots that it led


Report = Callable[[Round], None]


def silent(told: Round) -> None:
    """Report nothing."""


class Samples:
    """All rounds' samples in arrays that grow."""

    def __init__(self) -> None:
        self._parts: list[tuple[Floats, Floats]] = []

    def add(self, observations: Floats, targets: Floats) -> None:
        """Keep the samples of a round."""
        self._parts.append((observations, targets))

    def all(self) -> tuple[Floats, Floats]:
        """Observations (samples, 58) and targets (samples, 14)."""
        seen, asked = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        self._parts = [(seen, asked)]
        return seen, asked


def imitate(
    settings: ImitationSettings, episodes: TaughtEpisodes | None = None, report: Report = silent
) -> NetworkPolicy:
    """A policy on joints that does what the teacher would; equal settings give equal weights bit for bit.

    Args:
        settings: of the run.
        episodes: its robots; None: the biped, on one thread.
        report: called after every round.
    """
    torch.set_num_threads(1)  # a small network gains nothing from more, and its sums would depend on them
    episodes = TaughtEpisodes(settings.robots, settings.teacher) if episodes is None else episodes
    rng, student, kept = np.random.default_rng(settings.seed), Student(settings), Samples()
    collector = Collector(settings, episodes, rng)
    for number in range(settings.rounds):
        shown = collector.collect(student.act, number)
        kept.add(shown.observations, shown.targets)
        if number < settings.settle_rounds:
            student.see(kept.all()[0])
        rates = [settings.rate(number)] * settings.batches
        loss = _fit(student, kept, rates, settings.batch_size, rng)
        report(Round(number, len(kept.all()[0]), loss, shown.alone, shown.falls))
    if settings.rounds:
        student.begin_mean(settings.averaging)
        rates = [settings.last_rate(batch) for batch in range(settings.last_batches)]
        _fit(student, kept, rates, settings.batch_size, rng)
    description = PolicyDescription(JointEpisodes.name, episodes.robot, episodes.limits)
    return NetworkPolicy(student.mlp(), student.normalisation, description)


def _fit(
    student: Student, kept: Samples, rates: Sequence[float], batch_size: int, rng: np.random.Generator
) -> float:
    """Gradient steps at learning rates on batches of all samples; returns the mean loss."""
    seen, asked = kept.all()
    losses = []
    for rate in rates:
        rows = rng.integers(len(seen), size=batch_size)
        losses.append(student.fit(seen[rows], asked[rows], rate))
    return float(np.mean(losses)) if losses else 0.0


def imitate_once(settings: ImitationSettings, path: Path, report: Report = silent) -> NetworkPolicy:
    """The policy of an earlier run of the same settings at PATH.safetensors, or `imitate` and keep it there.

    A run takes minutes and is not resumed: one that was killed leaves nothing, and begins again.

    Raises:
        InvalidValueError: what lies there is no policy, or of other settings.
    """
    note = {"imitation": asdict(settings)}
    files = policy_paths(path)
    if all(file.exists() for file in files):
        told = parse_json(f"policy description {files[1]}", read_file(files[1])).get("training")
        if told != json.loads(json.dumps(note)):
            raise InvalidValueError(
                f"{files[1]} is of other settings of imitation; remove it, or name another"
            )
        return NetworkPolicy.load(path)
    policy = imitate(settings, report=report)
    policy.save(path, note)
    return policy
