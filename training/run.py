"""A training run in its folder: from the start or from a checkpoint to a policy file.

Beside the policy (policy.safetensors, .json) lie the best of the curve (best.safetensors, .json),
settings.json, curve.csv, tensorboard/, the model in Stable-Baselines3's own form (sb3/) and checkpoints/. A
checkpoint is whole or absent: safetensors and JSON in a folder that is renamed into place, with all that the
algorithm needs to go on; reading one runs no code.
"""

import csv
import io
import json
import os
import shutil
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import gymnasium as gym
import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import safe_mean

from ..controllers.errors import InvalidValueError
from ..controllers.files import read_file, sync_names, write_atomically
from ..controllers.model.robot import SAME, Similarity
from ..controllers.policies.interface import Policy
from ..controllers.policies.learned import NetworkPolicy, policy_paths
from ..controllers.validation import parse_json
from ..envs.scenario.distribution import PushDistribution, ScenarioDistribution
from ..envs.scenario.scenario import SETTLE_TIME, Scenario, get_profiles
from ..eval.output import progress, rows
from ..eval.rollout import environments
from ..eval.rollout.episodes import rollout_all
from ..eval.rollout.load_policy import named_file, training_note
from ..eval.rollout.workers import SLOTS
from ..eval.score.kinds import SuiteDistribution
from . import builders
from .algorithm import Tensors, make_algorithm
from .from_sb3 import export_policy, residual_base
from .imitation import ImitationSettings, imitate_once
from .settings import Report, TrainingSettings, command_of

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
    count: int,
    profile: str | Sequence[str] = "exact",
    size: Similarity = SAME,
    pushes: ScenarioDistribution = PUSHES,
) -> list[Scenario]:
    """The first `count` scenarios of the curve: the same ones in every run.

    `profile` is that of the robots, of several each draws one; `size` is their size against the robot of
    60 kg; `pushes` are by default like those of `hard`.
    """
    streams, robots = np.random.SeedSequence(SCENARIO_ENTROPY).spawn(count), get_profiles(profile)
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


# Files of the result, of the best of the curve and of what a teacher showed, without suffixes
POLICY, BEST, TAUGHT = "policy", "best", "taught"
CHECKPOINTS, KEPT_CHECKPOINTS, FORMAT_VERSION = "checkpoints", 2, 1
PACKAGES = ("torch", "stable-baselines3", "mujoco", "gymnasium", "numpy", "numba")
ROUND = 4.5  # seconds of one core that a round of imitation takes, about
SILENT: Report = lambda timesteps, words: None  # noqa: E731


@dataclass(frozen=True)
class Checkpoint:
    """A run at one moment."""

    settings: TrainingSettings
    timesteps: int
    updates: int  # gradient epochs so far, Stable-Baselines3's counter
    seconds: float  # of training so far, over all its parts
    tensors: Tensors


def find_checkpoints(out: Path) -> list[Path]:
    """The whole checkpoints of a run, oldest first."""
    folder = out / CHECKPOINTS
    return sorted(path for path in folder.glob("[0-9]*") if path.is_dir()) if folder.is_dir() else []


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint, or the newest one of a run's folder.

    Raises:
        InvalidValueError: There is none, or it is damaged.
    """
    if not (path / "state.json").is_file():
        found = find_checkpoints(path)
        if not found:
            raise InvalidValueError(
                f"no checkpoint in {path}: name a run's folder (its --out) or one of its {CHECKPOINTS}"
            )
        path = found[-1]
    try:
        state = parse_json("state.json", read_file(path / "state.json"))
        tensors = load(read_file(path / "tensors.safetensors"))
        if state["format_version"] != FORMAT_VERSION:
            raise InvalidValueError(f"format {state['format_version']}, this version reads {FORMAT_VERSION}")
        settings = TrainingSettings.from_json(state["settings"])
        return Checkpoint(
            settings, int(state["timesteps"]), int(state["updates"]), float(state["seconds"]), tensors
        )
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(f"the checkpoint {path} is damaged: {error}") from error


@dataclass(frozen=True)
class TrainingResult:
    """A run's policy and how it came about."""

    policy: Path  # safetensors; its JSON beside it
    timesteps: int
    seconds: float  # of wall time, over all parts
    curve: tuple[CurvePoint, ...]


class Progress(BaseCallback):
    """Reports after each rollout, and the share of training episodes that recovered to TensorBoard.

    Args:
        report: called with the mean reward and the recovered share of the last 100 episodes, then what
            `judged` says.
        judged: how the policy does without noise, in words.
    """

    def __init__(self, report: Report, judged: Callable[[], str]):
        super().__init__()
        self.report, self.judged = report, judged
        self.recovered: deque[bool] = deque(maxlen=100)

    def _on_step(self) -> bool:
        for index in np.flatnonzero(self.locals["dones"]):
            info = self.locals["infos"][index]
            self.recovered.append(info.get("failure_reason") is None and info.get("recovered_at") is not None)
        return True

    def _on_rollout_end(self) -> None:
        words = [self.judged()]
        if self.recovered:
            share = float(np.mean(self.recovered))
            self.logger.record("rollout/recovered", share)
            reward = safe_mean([episode["r"] for episode in self.model.ep_info_buffer or ()])
            words.insert(0, f"reward {reward:.3g}, recovered {share:.0%}")
        self.report(self.num_timesteps, ", ".join(words))


class Every(BaseCallback):
    """Calls `action` before a rollout whenever `period` timesteps have passed since it last did."""

    def __init__(self, period: int, action: Callable[[], None], start: int):
        super().__init__()
        self.period, self.action, self.last = period, action, start

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.last >= self.period:
            self.last = self.num_timesteps
            self.action()

    def _on_step(self) -> bool:
        return True


class Run:
    """One run in its folder.

    Args:
        settings: Of the run.
        out: Its folder.
        checkpoint: Where to go on; None from the start.
        own: Folder whose policies come before those of the package where `initial` is a name.
        report: Called with progress, for the first time when all that was given has been checked.
    """

    def __init__(
        self,
        settings: TrainingSettings,
        out: Path,
        checkpoint: Checkpoint | None = None,
        own: Path | None = None,
        report: Report = SILENT,
    ):
        self._began = time.monotonic()
        self.one = builders.make_env(settings)
        self.settings, self.out = (settings := builders.completed(settings, self.one)), out
        self.start = 0 if checkpoint is None else checkpoint.timesteps
        self._seconds_before = 0.0 if checkpoint is None else checkpoint.seconds
        self.env = builders.make_plain_env(settings.env_id)
        size = environments.size_of(self.env)
        pushes = SuiteDistribution(settings.like, SETTLE_TIME) if settings.like else PUSHES
        self.scenarios = curve_scenarios(settings.evaluation_scenarios, settings.profile, size, pushes)
        anew = checkpoint is None and settings.initial is not None
        first = initial_policy(settings, own, self.one) if anew else None
        self._report = report
        taught = checkpoint is None and settings.teacher  # then imitation reports first
        if not taught:
            report(self.start, "")  # the walks from which robots are pushed take long
        seed = builders.segment_seed(settings.seed, self.start)
        self.venv = builders.make_vec_env(settings, self.one, seed)
        self.algorithm = make_algorithm(settings, self.venv, seed, out / "tensorboard")
        if checkpoint is not None:
            self.algorithm.restore(checkpoint.tensors, checkpoint.timesteps, checkpoint.updates)
        elif first is not None:
            self.algorithm.start_from(first)
        elif taught:
            self.algorithm.start_from(taught_policy(settings, out / TAUGHT))
            report(self.start, "")
        self.curve = [p for p in read_curve(out / "curve.csv") if checkpoint and p.timesteps <= self.start]
        self._best = None if checkpoint is None else best_recovered(out, self.start)

    @property
    def timesteps(self) -> int:
        """Learned actions that have been taken, over all parts."""
        return self.algorithm.model.num_timesteps

    @property
    def seconds(self) -> float:
        """Wall time of all parts so far [s]."""
        return self._seconds_before + time.monotonic() - self._began

    def policy(self) -> NetworkPolicy:
        """The policy as it stands."""
        return export_policy(self.algorithm.network(), self.venv, self.one, self.settings)

    def train(self) -> TrainingResult:
        """Learn to the end; an interrupt keeps what was done as a checkpoint."""
        settings = self.settings
        write_atomically(
            self.out / "settings.json", json.dumps(settings.to_json(), indent=1).encode() + b"\n"
        )
        try:
            if self.start == 0:
                self.checkpoint()
            if not self.curve:
                self.evaluate()
            if settings.timesteps > self.start:
                callbacks = [
                    Progress(self._report, self.judged),
                    Every(settings.evaluate_every, self._judge, self.curve[-1].timesteps),
                    Every(settings.checkpoint_every, self.checkpoint, self.start),
                ]
                self.algorithm.learn(settings.timesteps - self.start, callbacks)
        except KeyboardInterrupt:
            self.checkpoint()
            raise
        self.checkpoint()
        if self.curve[-1].timesteps < self.timesteps or self._best is None:
            self.evaluate()
        whole = self.manifest(POLICY)
        path = self.policy().save(self.out / POLICY, whole)
        best, note = NetworkPolicy.load(self.out / BEST), training_note(policy_paths(self.out / BEST)[1])
        best.save(self.out / BEST, note | {name: whole[name] for name in ("seconds", "curve")})
        folder = self.out / "sb3"  # for the user's own `load` of both; this project never reads it
        folder.mkdir(exist_ok=True)
        self.algorithm.model.save(folder / "model.zip")
        self.venv.save(str(folder / "vecnormalize.pkl"))
        return TrainingResult(path, self.timesteps, self.seconds, tuple(self.curve))

    def manifest(self, name: str) -> dict[str, Any]:
        """All that is needed to train the policy of this name again, and how its training went, as JSON."""
        return {
            "command": command_of(self.settings, f"{name}.json"),
            "settings": self.settings.to_json(),
            "timesteps": self.timesteps,
            "seconds": round(self.seconds, 3),
            "curve": [asdict(point) for point in self.curve],
            "code": environments.code_digest(),  # that of `config.json` beside rows: controllers and envs
            "commit": rows.source_commit(Path(__file__)),
            "versions": rows.versions(PACKAGES),
        }

    def evaluate(self) -> None:
        """Add a point to the learning curve; keep its policy unless an earlier one recovered more often."""
        policy = self.policy()
        point = score(self.env, policy, self.scenarios, self.timesteps, self.seconds)
        self.curve = [earlier for earlier in self.curve if earlier.timesteps < point.timesteps]
        self.curve.append(point)
        if self._best is None or point.recovered >= self._best:
            policy.save(self.out / BEST, self.manifest(BEST))
            self._best = point.recovered
        write_curve(self.out / "curve.csv", self.curve)
        if self.timesteps > 0 and hasattr(self.algorithm.model, "_logger"):
            for name in ("recovered", "survived", "mean_reward"):
                self.algorithm.model.logger.record(f"eval/{name}", getattr(point, name))

    def _judge(self) -> None:
        """Add a point to the curve, from which a run that is killed then can go on with the best so far."""
        self.checkpoint()
        self.evaluate()

    def judged(self) -> str:
        """The first point of the curve, which of corrections is the planner's, and the newest, in words."""
        first, newest = self.curve[0], self.curve[-1]
        return f"curve {first.recovered:.0%} -> {newest.recovered:.0%}"

    def checkpoint(self) -> None:
        """Write OUT/checkpoints/<timesteps> whole, then drop later ones and all but the newest two."""
        final = self.out / CHECKPOINTS / f"{self.timesteps:012d}"
        for left in final.parent.glob(".*.tmp"):  # by a kill, or on a full disk
            shutil.rmtree(left, ignore_errors=True)
        temporary = final.with_name(f".{final.name}.tmp")
        temporary.mkdir(parents=True)
        state = {
            "format_version": FORMAT_VERSION,
            "timesteps": self.timesteps,
            "updates": self.algorithm.updates,
            "seconds": self.seconds,
            "settings": self.settings.to_json(),
        }
        write_atomically(temporary / "tensors.safetensors", save(self.algorithm.tensors()))
        write_atomically(temporary / "state.json", json.dumps(state, indent=1).encode())
        shutil.rmtree(final, ignore_errors=True)
        os.replace(temporary, final)
        sync_names(final.parent)
        found = find_checkpoints(self.out)  # later ones are of a part that the run has given up
        kept = [one for one in found if one.name <= final.name][-KEPT_CHECKPOINTS:]
        for old in found:
            if old not in kept:
                shutil.rmtree(old, ignore_errors=True)

    def close(self) -> None:
        """Close every environment."""
        self.venv.close()
        self.one.close()
        self.env.close()


def best_recovered(out: Path, timesteps: int) -> float | None:
    """Share of recoveries of the best policy in a run's folder; None where it is none of the run's.

    A kill between its two files leaves it in part, and a run that goes on from an older checkpoint finds one
    of the part that it gives up.
    """
    try:
        NetworkPolicy.load(out / BEST)
        note = training_note(policy_paths(out / BEST)[1])
    except InvalidValueError:
        return None
    taken = int(note["timesteps"])
    shares = {int(point["timesteps"]): float(point["recovered"]) for point in note["curve"]}
    return shares.get(taken) if taken <= timesteps else None


def initial_policy(settings: TrainingSettings, own: Path | None, one: gym.Env) -> NetworkPolicy:
    """The policy that a run begins as.

    Raises:
        InvalidValueError: It is not there, or acts otherwise than the policy of the run is to act.
    """
    name = str(settings.initial)
    beside = None if own is None else policy_paths(own / name)[0]
    policy = NetworkPolicy.load(beside if beside is not None and beside.is_file() else named_file(name))
    about = policy.description
    theirs = {
        "environment": (about.env_id, settings.env_id),
        "inputs": (about.inputs, settings.inputs),
        "hold": (about.hold, settings.hold),
        "residual": (about.residual is not None, settings.residual),
    }
    wrapper = builders.find_residual(one)
    if about.residual is not None and wrapper is not None:
        below = residual_base(wrapper, settings.policy)
        theirs |= {
            name: (getattr(about.residual, name), getattr(below, name))
            for name in ("policy", "scale", "gate")
        }
    for what, (given, asked) in theirs.items():
        if given != asked:
            raise InvalidValueError(f"the run begins as {name}, whose {what} is {given!r}, not {asked!r}")
    return policy


def taught_policy(settings: TrainingSettings, path: Path) -> NetworkPolicy:
    """The policy of imitation before a run, with a bar; it takes as long as a run of its own."""
    shown = ImitationSettings(seed=settings.seed, layers=settings.policy_layers)
    seconds = 0.0 if all(file.exists() for file in policy_paths(path)) else ROUND * shown.rounds
    work = progress.Work("imitation of the planner, before PPO", progress.about(seconds), path)
    with progress.progress_bars(["imitation"], shown.rounds, work) as bars:
        policy = imitate_once(
            shown, path, lambda one: bars.set("imitation", one.number + 1, f"loss {one.loss:.4f}")
        )
        bars.set("imitation", shown.rounds)
    return policy


def train(
    settings: TrainingSettings, out: Path, report: Report = SILENT, own: Path | None = None
) -> TrainingResult:
    """Train from the start into a folder that holds no run yet; one without a checkpoint is none.

    Args:
        settings: Of the run.
        out: Its folder.
        report: Called with progress.
        own: Folder whose policies come before those of the package where `initial` is a name.

    Raises:
        InvalidValueError: The folder holds a run, another run is writing there, or the environment or the
            initial policy does not fit.
        UnknownNameError: No such environment or policy.
    """
    with rows.Writer(out):
        if find_checkpoints(out) or (out / POLICY).with_suffix(".safetensors").exists():
            raise InvalidValueError(
                f"{out} holds a run already: go on with --resume {out}, or choose another --out"
            )
        with closing(Run(settings, out, None, own, report)) as run:
            return run.train()


def resume(
    path: Path,
    timesteps: int | None = None,
    report: Report = SILENT,
    env_id: str | None = None,
    device: str | None = None,
) -> TrainingResult:
    """Go on from the newest checkpoint of a run's folder, or from one of its checkpoints, in that folder.

    Args:
        path: Of the run or of one of its checkpoints.
        timesteps: New end of the run; None keeps the old one. A run that is past it only writes its policy.
        report: Called with progress.
        env_id: Of the run, as the user names it; needed where to make the environment imports a module.
        device: Where it goes on; None keeps the old one.

    Raises:
        InvalidValueError: There is no checkpoint, it is damaged, or it would import a module by itself; or
            another run is writing there.
    """
    out = path.parent.parent if (path / "state.json").is_file() else path
    with rows.Writer(out):
        checkpoint = load_checkpoint(path)
        settings = checkpoint.settings
        name = environments.EnvName.parse(settings.env_id)
        if name.runs_code and env_id != settings.env_id:
            raise InvalidValueError(
                f"the run in {path} is of {settings.env_id!r}, and going on would run the code of "
                f"{name.module!r}: say --env {settings.env_id} where that is wanted"
            )
        if timesteps is not None:
            settings = replace(settings, timesteps=timesteps)
        if device is not None:
            settings = replace(settings, device=device)
        with closing(Run(settings, out, checkpoint, report=report)) as run:
            return run.train()
