"""A training run from start, or from a checkpoint, to a policy file.

How a policy came about: what stands under `training` in its JSON.

What happens between two updates of PPO: progress, checkpoints, the learning curve.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from ..controllers.errors import InvalidValueError
from ..controllers.files import write_atomically
from ..controllers.policies.learned import NetworkPolicy, policy_paths
from ..eval.output.progress import Work, about, progress_bars
from ..eval.output.rows import Writer, source_commit, versions
from ..eval.rollout.environments import EnvName, code_digest, size_of
from ..eval.rollout.load_policy import named_file
from .builders import completed, make_env, make_plain_env, make_ppo, make_vec_env, segment_seed
from .checkpoint import Checkpoint, find_checkpoints, load_checkpoint, restore, save_checkpoint
from .curve import CurvePoint, curve_scenarios, read_curve, score, write_curve
from .from_sb3 import export_policy
from .imitation import ImitationSettings, imitate_once
from .networks import ValueFirst, start_from
from .recipes import command_of
from .settings import TrainingSettings

PACKAGES = ("torch", "stable-baselines3", "mujoco", "gymnasium", "numpy", "numba")


def manifest(
    settings: TrainingSettings, timesteps: int, seconds: float, curve: Sequence[CurvePoint], file: str
) -> dict[str, Any]:
    """All that is needed to train a policy again, and what its training showed, as JSON.

    Args:
        settings: of the run.
        timesteps: learned actions that were taken.
        seconds: wall time of all parts of the run.
        curve: points of the learning curve.
        file: name of the policy's JSON.
    """
    return {
        "command": command_of(settings, file),
        "settings": settings.to_json(),
        "timesteps": timesteps,
        "seconds": round(seconds, 3),
        "curve": [asdict(point) for point in curve],
        "code": code_digest(),  # that of `config.json` beside rows: controllers and envs
        "commit": source_commit(Path(__file__)),
        "versions": versions(PACKAGES),
    }


class Progress(BaseCallback):
    """Reports timesteps after each of them, and the share of training episodes that recovered to TensorBoard.

    Args:
        report: Called with the timesteps so far and the recovered share of the last 100 episodes (or None).
    """

    def __init__(self, report: Callable[[int, float | None], None]):
        super().__init__()
        self.report = report
        self.recovered: deque[bool] = deque(maxlen=100)

    def _on_step(self) -> bool:
        ended: Any = self.locals["dones"]
        for index in np.flatnonzero(ended):
            info = self.locals["infos"][index]
            self.recovered.append(info.get("failure_reason") is None and info.get("recovered_at") is not None)
        return True

    def _on_rollout_end(self) -> None:
        share = float(np.mean(self.recovered)) if self.recovered else None
        if share is not None:
            self.logger.record("rollout/recovered", share)
        self.report(self.num_timesteps, share)


class Every(BaseCallback):
    """Calls `action` before a rollout whenever `period` timesteps have passed since it last did.

    Args:
        period: In timesteps.
        action: Called without arguments; sees the networks as the last update left them.
        start: Timesteps at which the count begins.
    """

    def __init__(self, period: int, action: Callable[[], None], start: int):
        super().__init__()
        self.period = period
        self.action = action
        self.last = start

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.last >= self.period:
            self.last = self.num_timesteps
            self.action()

    def _on_step(self) -> bool:
        return True


def record_point(logger: Any, point: CurvePoint) -> None:
    """Put a point of the learning curve into TensorBoard."""
    for name in ("recovered", "survived", "mean_reward"):
        logger.record(f"eval/{name}", getattr(point, name))


POLICY = "policy"  # file of the result, without its suffixes
TAUGHT = "taught"  # file of what a teacher has shown, without its suffixes
ROUND = 4.5  # seconds of one core that a round of showing takes, about
Report = Callable[[int, float | None], None]


@dataclass(frozen=True)
class TrainingResult:
    """What a run leaves."""

    policy: Path  # safetensors; its JSON beside it
    timesteps: int
    seconds: float  # of wall time, over all parts
    curve: tuple[CurvePoint, ...]


def silent(timesteps: int, recovered: float | None) -> None:
    """Report nothing."""


class Run:
    """One run in its folder: settings.json, curve.csv, checkpoints/, tensorboard/, policy.safetensors, .json.

    Args:
        settings: Of the run.
        out: Its folder.
        checkpoint: Where to go on; None from the start.
        own: Folder whose policies come before those of the package where `initial` is a name.
        report: Told of progress, for the first time when all that was given has been checked.
    """

    def __init__(
        self,
        settings: TrainingSettings,
        out: Path,
        checkpoint: Checkpoint | None = None,
        own: Path | None = None,
        report: Report = silent,
    ):
        self._began = time.monotonic()
        self.one = make_env(settings)
        self.settings, self.out = (settings := completed(settings, self.one)), out
        self.start = 0 if checkpoint is None else checkpoint.timesteps
        self._seconds_before = 0.0 if checkpoint is None else checkpoint.seconds
        self.env = make_plain_env(settings.env_id)
        self.scenarios = curve_scenarios(settings.evaluation_scenarios, settings.profile, size_of(self.env))
        anew = checkpoint is None and settings.initial is not None
        first = initial_policy(settings, own) if anew else None
        self._report = report
        taught = checkpoint is None and settings.teacher  # then imitation tells of itself first
        if not taught:
            report(self.start, None)  # the walks from which robots are pushed take long
        seed = segment_seed(settings.seed, self.start)
        self.venv: VecNormalize = make_vec_env(settings, self.one, seed)
        self.model: PPO = make_ppo(settings, self.venv, seed, out)
        if checkpoint is not None:
            restore(checkpoint, self.model, self.venv)
        elif first is not None:
            start_from(first, self.model, self.venv)
        elif taught:
            start_from(taught_policy(settings, out / TAUGHT), self.model, self.venv)
            report(self.start, None)
        self.curve = [p for p in read_curve(out / "curve.csv") if checkpoint and p.timesteps <= self.start]

    @property
    def seconds(self) -> float:
        """Wall time of all parts so far [s]."""
        return self._seconds_before + time.monotonic() - self._began

    def policy(self) -> NetworkPolicy:
        """The policy as it stands."""
        return export_policy(self.model, self.venv, self.one, self.settings)

    def train(self) -> TrainingResult:
        """Run PPO to the end; an interrupt keeps what was done as a checkpoint."""
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
                last = self.curve[-1].timesteps
                callbacks = [
                    Progress(self._report),
                    Every(settings.evaluate_every, self.evaluate, last),
                    Every(settings.checkpoint_every, self.checkpoint, self.start),
                    ValueFirst(settings.value_first),
                ]
                self.model.learn(
                    settings.timesteps - self.start,
                    callback=callbacks,
                    reset_num_timesteps=self.start == 0,
                    tb_log_name="ppo",
                )
        except KeyboardInterrupt:
            self.checkpoint()
            raise
        if self.curve[-1].timesteps < self.model.num_timesteps:
            self.evaluate()
        self.checkpoint()
        return self._finish()

    def evaluate(self) -> None:
        """Add a point to the learning curve."""
        point = score(self.env, self.policy(), self.scenarios, self.model.num_timesteps, self.seconds)
        self.curve.append(point)
        write_curve(self.out / "curve.csv", self.curve)
        if self.model.num_timesteps > 0 and hasattr(self.model, "_logger"):
            record_point(self.model.logger, point)

    def checkpoint(self) -> None:
        """Write a checkpoint."""
        save_checkpoint(self.out, self.settings, self.model, self.venv, self.seconds)

    def close(self) -> None:
        """Close every environment."""
        self.venv.close()
        self.one.close()
        self.env.close()

    def _finish(self) -> TrainingResult:
        steps, file = self.model.num_timesteps, f"{POLICY}.json"
        note = manifest(self.settings, steps, self.seconds, self.curve, file)
        path = self.policy().save(self.out / POLICY, note)
        folder = self.out / "sb3"  # for PPO.load and VecNormalize.load; this project never reads it
        folder.mkdir(exist_ok=True)
        self.model.save(folder / "model.zip")
        self.venv.save(str(folder / "vecnormalize.pkl"))
        return TrainingResult(path, self.model.num_timesteps, self.seconds, tuple(self.curve))


def initial_policy(settings: TrainingSettings, own: Path | None) -> NetworkPolicy:
    """What a run begins as.

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
    for what, (given, asked) in theirs.items():
        if given != asked:
            raise InvalidValueError(f"the run begins as {name}, whose {what} is {given!r}, not {asked!r}")
    return policy


def taught_policy(settings: TrainingSettings, path: Path) -> NetworkPolicy:
    """What the planner shows before PPO begins, with a bar; it takes as long as a run of its own."""
    shown = ImitationSettings(seed=settings.seed, layers=settings.policy_layers)
    seconds = 0.0 if all(file.exists() for file in policy_paths(path)) else ROUND * shown.rounds
    work = Work("imitation of the planner, before PPO", about(seconds), path)
    with progress_bars(["imitation"], shown.rounds, work) as bars:
        policy = imitate_once(
            shown, path, lambda told: bars.set("imitation", told.number + 1, f"loss {told.loss:.4f}")
        )
        bars.set("imitation", shown.rounds)
    return policy


def train(
    settings: TrainingSettings, out: Path, report: Report = silent, own: Path | None = None
) -> TrainingResult:
    """Train from the start into a folder that holds no run yet; one without a checkpoint is none.

    Args:
        settings: Of the run.
        out: Its folder.
        report: Told of progress.
        own: Folder whose policies come before those of the package where `initial` is a name.

    Raises:
        InvalidValueError: The folder holds a run, another run is writing there, or the environment or the
            initial policy does not fit.
        UnknownNameError: No such environment or policy.
    """
    with Writer(out):
        if find_checkpoints(out) or (out / POLICY).with_suffix(".safetensors").exists():
            raise InvalidValueError(
                f"{out} holds a run already: go on with --resume {out}, or choose another --out"
            )
        return _train(Run(settings, out, None, own, report))


def resume(
    path: Path, timesteps: int | None = None, report: Report = silent, env_id: str | None = None
) -> TrainingResult:
    """Go on from the newest checkpoint of a run's folder, or from one of its checkpoints, in that folder.

    Args:
        path: Of the run or of one of its checkpoints.
        timesteps: New end of the run; None keeps the old one. A run that is past it only writes its policy.
        report: Told of progress.
        env_id: Of the run, as the user names it; needed where to make the environment imports a module.

    Raises:
        InvalidValueError: There is no checkpoint, it is damaged, or it would import a module by itself; or
            another run is writing there.
    """
    out = path.parent.parent if (path / "state.json").is_file() else path
    with Writer(out):
        return _train(_resumed(path, out, timesteps, env_id, report))


def _resumed(path: Path, out: Path, timesteps: int | None, env_id: str | None, report: Report) -> Run:
    """The run in `out` as it was at the checkpoint in `path`, or at its newest one."""
    checkpoint = load_checkpoint(path)
    settings = checkpoint.settings
    name = EnvName.parse(settings.env_id)
    if name.runs_code and env_id != settings.env_id:
        raise InvalidValueError(
            f"the run in {path} is of {settings.env_id!r}, and going on would run the code of "
            f"{name.module!r}: say --env {settings.env_id} where that is wanted"
        )
    if timesteps is not None:
        settings = replace(settings, timesteps=timesteps)
    return Run(settings, out, checkpoint, report=report)


def _train(run: Run) -> TrainingResult:
    try:
        return run.train()
    finally:
        run.close()
