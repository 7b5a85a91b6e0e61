"""DAgger: a learner is shown what a teacher would do in the states that the learner itself comes to.

Ross, Gordon, Bagnell, A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning, AISTATS 2011. All rounds' samples are kept, and every round fits on batches of all. The learner is a
tanh network on normalised joint observations.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.optim import swa_utils

from ..controllers.errors import InvalidValueError
from ..controllers.files import read_file
from ..controllers.joint_control import JOINT_OBSERVATION_SIZE, PREVIOUS_ACTION
from ..controllers.policies.learned import NetworkPolicy, PolicyDescription, policy_paths
from ..controllers.policies.mlp import Mlp, Normalisation
from ..controllers.validation import parse_json, require_integer, require_kind
from ..controllers.whole_body.kinematics import NU
from ..envs.joint.env import JointEpisodes
from ..envs.joint.taught import TaughtEpisodes
from ..envs.scenario.distribution import PushDistribution
from .from_sb3 import ActingNetwork

Floats = NDArray[np.float32]
Act = Callable[[NDArray[np.float64]], Floats]  # observations (n, 58) -> targets (n, 14)

SHOWN_PUSHES = PushDistribution(impulse_max=180.0, first_step=1, settle_time=2.0)


@dataclass(frozen=True)
class ImitationSettings:
    """Settings of DAgger; the defaults give a policy that walks, in a quarter of an hour of one core."""

    teacher: str = "two-stage"  # name of the planner that shows
    seed: int = 0  # of weights, pushes and batches
    robots: int = 128  # side by side
    rounds: int = 200  # of collecting and fitting
    periods: int = 50  # planning periods of all robots in a round
    batches: int = 100  # gradient steps in a round
    batch_size: int = 1024  # samples of a gradient step, from all rounds so far
    shown_rounds: int = 3  # at first, in which the teacher leads all along
    free_share: float = 0.9  # of later episodes in the end, in which it never leads; grows to that
    growth: float = 0.02  # of that share in a round, from 0.1
    longest_lead: float = 1.5  # in the other episodes the teacher leads for up to this long at first [s]
    unpushed: float = 0.3  # share of episodes without a push
    settle_rounds: int = 12  # at first, over which the observations' mean and variance are taken
    learning_rate: float = 1e-3  # of Adam; falls linearly to a tenth over the rounds
    last_batches: int = 8000  # gradient steps after the rounds, whose rate falls from the first one's to 0
    averaging: float = 0.003  # share of each of these steps in the mean of the weights, which is the result
    beta: float = 0.1  # error of a target from which the loss is no longer quadratic, in action units
    largest: float = 1.5  # samples whose target is beyond this in any joint are left out, in action units
    layers: tuple[int, ...] = (256, 256)  # widths of the hidden layers
    pushes: PushDistribution = SHOWN_PUSHES

    def __post_init__(self) -> None:
        for name in ("robots", "periods", "batches", "batch_size", "settle_rounds"):
            require_integer(f"imitation setting {name}", getattr(self, name), 1)
        for name in ("rounds", "shown_rounds", "last_batches", "seed"):
            require_integer(f"imitation setting {name}", getattr(self, name), 0)
        for name in ("free_share", "unpushed", "averaging"):
            self._check(name, 0.0 <= getattr(self, name) <= 1.0, "in [0, 1]")
        for name in ("longest_lead", "learning_rate", "beta", "largest", "growth"):
            value = getattr(self, name)
            self._check(name, math.isfinite(value) and value > 0.0, "positive and finite")
        self._check("layers", all(isinstance(n, int) and n >= 1 for n in self.layers), "widths >= 1")
        require_kind("imitation setting pushes", self.pushes, PushDistribution)

    def _check(self, name: str, good: bool, wanted: str) -> None:
        if not good:
            raise InvalidValueError(f"imitation setting {name} must be {wanted}, got {getattr(self, name)!r}")

    def free(self, number: int) -> float:
        """Share of the episodes of a round that the learner walks alone from the start."""
        return 0.0 if number < self.shown_rounds else min(self.free_share, 0.1 + self.growth * number)

    def rate(self, number: int) -> float:
        """Learning rate of a round."""
        return self.learning_rate * max(0.1, 1.0 - number / max(self.rounds, 1))

    def last_rate(self, batch: int) -> float:
        """Learning rate of a gradient step after the rounds."""
        return self.learning_rate * (1.0 - batch / self.last_batches)


# The previous action is hidden: it tells what the teacher asks next so well that a learner copies it, and
# then goes on with its own errors.
HIDDEN = slice(PREVIOUS_ACTION, PREVIOUS_ACTION + NU)
HIDE = 1e12  # variance of an entry that the network is not to see
SMALLEST = 1e-4  # variance of an entry that does not move


class Student:
    """A network and the normalisation before it, as `NetworkPolicy` has them."""

    def __init__(self, settings: ImitationSettings):
        generator = torch.Generator().manual_seed(settings.seed)
        widths, layers = (JOINT_OBSERVATION_SIZE, *settings.layers, NU), []
        for inputs, outputs in pairwise(widths):
            layers += [_linear(inputs, outputs, generator), nn.Tanh()]
        self.network = nn.Sequential(*layers[:-1])
        self.beta = settings.beta
        self.mean: swa_utils.AveragedModel | None = None
        self.optimiser = torch.optim.Adam(self.network.parameters())
        self.normalisation = normalisation_of(np.zeros((1, JOINT_OBSERVATION_SIZE), np.float32))

    def act(self, observations: NDArray[np.float64]) -> Floats:
        """Targets (n, 14) in action units, clipped to [-1, 1]."""
        with torch.no_grad():
            targets = self.network(torch.from_numpy(self.normalisation.apply(observations)))
        return np.clip(targets.numpy(), np.float32(-1.0), np.float32(1.0))

    def fit(self, observations: Floats, targets: Floats, rate: float) -> float:
        """One gradient step towards the targets (n, 14) of observations (n, 58); returns the loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        seen = torch.from_numpy(self.normalisation.apply(observations.astype(np.float64)))
        loss = nn.functional.smooth_l1_loss(self.network(seen), torch.from_numpy(targets), beta=self.beta)
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        if self.mean is not None:
            self.mean.update_parameters(self.network)
        return loss.item()

    def begin_mean(self, share: float) -> None:
        """Let the result be a running mean of the weights from here on, of which each step has a share."""
        average = swa_utils.get_ema_multi_avg_fn(1.0 - share)
        self.mean = swa_utils.AveragedModel(self.network, multi_avg_fn=average)

    def mlp(self) -> Mlp:
        """The network in numpy."""
        modules = (self.mean or self.network).modules()
        return ActingNetwork([one for one in modules if isinstance(one, nn.Linear)]).mlp()


def normalisation_of(observations: Floats) -> Normalisation:
    """Mean and variance of observations (n, 58); the previous action is hidden."""
    mean = observations.mean(axis=0, dtype=np.float64)
    variance = observations.var(axis=0, dtype=np.float64) + SMALLEST
    mean[HIDDEN], variance[HIDDEN] = 0.0, HIDE
    return Normalisation(mean, variance)


def _linear(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    """A layer whose weights are drawn as torch draws them, from a generator of its own."""
    layer, bound = nn.Linear(inputs, outputs), inputs**-0.5
    for parameter in layer.parameters():
        nn.init.uniform_(parameter, -bound, bound, generator=generator)
    return layer


@dataclass(frozen=True)
class Shown:
    """Samples of one round, and how the learner fared in it."""

    observations: Floats  # (samples, 58)
    targets: Floats  # (samples, 14) of the teacher, within [-1, 1]
    alone: float  # robot seconds that the learner has walked [s]
    falls: int  # of robots that it led


class Collector:
    """Robots under joint targets that go on from round to round.

    In a free episode the learner leads from the start, in the others after a while. The teacher's torques
    lead before that, and what its targets were is taken for the action.
    """

    def __init__(self, settings: ImitationSettings, episodes: TaughtEpisodes, rng: np.random.Generator):
        self.settings, self.episodes, self.rng = settings, episodes, rng
        self._turn = np.zeros(episodes.n)  # time from which the learner leads [s]
        self._begun = False

    def collect(self, act: Act, number: int) -> Shown:
        """Let all robots walk for a round."""
        if not self._begun:
            for k in range(self.episodes.n):
                self._begin(k, number)
            self._begun = True
        seen, asked, alone, falls = [], [], 0.0, 0
        episodes, settings = self.episodes, self.settings
        for _ in range(settings.periods):
            led = episodes.core.gait.time < self._turn
            episodes.lead(led)
            observations = episodes.seen.astype(np.float32)
            actions = act(episodes.seen)
            actions[led] = np.clip(episodes.targets[led], -1.0, 1.0)
            # a teacher who takes the robot to stand on the other foot would show the mirrored answer
            agree = episodes.core.walk.stance == episodes.core.gait.stance
            period = episodes.step(actions)
            good = agree & ~period.failed & (np.abs(episodes.targets).max(axis=1) < settings.largest)
            seen.append(observations[good])
            asked.append(np.clip(episodes.targets, -1.0, 1.0).astype(np.float32)[good])
            alone += float((~led).sum()) / episodes.control_hz
            falls += int((period.failed & ~led).sum())
            for k in np.flatnonzero(period.failed | period.truncated).tolist():
                self._begin(k, number)
        return Shown(np.concatenate(seen), np.concatenate(asked), alone, falls)

    def _begin(self, k: int, number: int) -> None:
        settings, rng = self.settings, self.rng
        scenario = self.episodes.drawn(settings.pushes, rng)
        if rng.random() < settings.unpushed:
            scenario = replace(scenario, pushes=(), duration=4.0)
        self.episodes.begin(k, scenario)
        free = rng.random() < settings.free(number)
        shown = number < settings.shown_rounds
        self._turn[k] = np.inf if shown else 0.0 if free else rng.uniform(0.0, settings.longest_lead)


@dataclass(frozen=True)
class Round:
    """How a round went."""

    number: int
    samples: int  # so far
    loss: float  # mean of its gradient steps
    alone: float  # robot seconds that the learner has walked in it [s]
    falls: int  # of robots that it led


Report = Callable[[Round], object]


def imitate(
    settings: ImitationSettings, episodes: TaughtEpisodes | None = None, report: Report = lambda _: None
) -> NetworkPolicy:
    """A policy on joints that does what the teacher would; equal settings give equal weights bit for bit.

    Args:
        settings: of the run.
        episodes: its robots; None: the biped, on one thread.
        report: called after every round.
    """
    torch.set_num_threads(1)  # a small network gains nothing from more, and its sums would depend on them
    episodes = TaughtEpisodes(settings.robots, policy=settings.teacher) if episodes is None else episodes
    rng, student = np.random.default_rng(settings.seed), Student(settings)
    collector = Collector(settings, episodes, rng)
    seen, asked = np.empty((0, JOINT_OBSERVATION_SIZE), np.float32), np.empty((0, NU), np.float32)

    def fit(rates: Sequence[float]) -> float:
        """Gradient steps at learning rates on batches of all samples; returns the mean loss."""
        losses = []
        for rate in rates:
            rows = rng.integers(len(seen), size=settings.batch_size)
            losses.append(student.fit(seen[rows], asked[rows], rate))
        return float(np.mean(losses)) if losses else 0.0

    for number in range(settings.rounds):
        shown = collector.collect(student.act, number)
        seen, asked = np.concatenate([seen, shown.observations]), np.concatenate([asked, shown.targets])
        if number < settings.settle_rounds:
            student.normalisation = normalisation_of(seen)
        loss = fit([settings.rate(number)] * settings.batches)
        report(Round(number, len(seen), loss, shown.alone, shown.falls))
    if settings.rounds:
        student.begin_mean(settings.averaging)
        fit([settings.last_rate(batch) for batch in range(settings.last_batches)])
    description = PolicyDescription(JointEpisodes.name, episodes.robot, episodes.limits)
    return NetworkPolicy(student.mlp(), student.normalisation, description)


def imitate_once(settings: ImitationSettings, path: Path, report: Report = lambda _: None) -> NetworkPolicy:
    """The policy of an earlier run of the same settings at PATH.safetensors, or `imitate` and keep it there.

    A run takes minutes and is not resumed: one that was killed leaves nothing, and begins again.

    Raises:
        InvalidValueError: what lies there is no policy, or of other settings.
    """
    note = {"imitation": asdict(settings)}
    files = policy_paths(path)
    if all(file.exists() for file in files):
        found = parse_json(f"policy description {files[1]}", read_file(files[1])).get("training")
        if found != json.loads(json.dumps(note)):
            raise InvalidValueError(
                f"{files[1]} is of other settings of imitation; remove it, or name another"
            )
        return NetworkPolicy.load(path)
    policy = imitate(settings, report=report)
    policy.save(path, note)
    return policy
