"""Every command that takes long, at a size that takes seconds, for `kills.py`."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from push_recovery.eval.score.suites import Suite, get_suite

PENDULUM = ("--env", "PushRecovery/Pendulum-v0")
BUDGET = ("--trials", "8", "--scenarios", "16", "--held-out", "16")
SEARCH = ("--population", "8", "--generations", "2", "--elites", "2")
TRAINING = (
    "--timesteps", "2048", "--n-envs", "4", "--n-steps", "64", "--checkpoint-every", "256",
    "--evaluate-every", "512", "--evaluation-scenarios", "8",
)  # fmt: skip
# The recipes of a shipped policy would take an hour: their names stand for short runs here.
SHORT_RECIPE = """
from push_recovery.eval.cli import main as command_line
def shortened(argv, run=command_line._run):  # within `main`, which turns Ctrl-C into an exit code
    from dataclasses import replace
    from push_recovery.training.settings import RECIPES
    RECIPES["residual"] = replace(
        RECIPES["residual"], timesteps=1024, n_envs=8, n_steps=32, walks=8, checkpoint_every=256,
        evaluate_every=512, evaluation_scenarios=8)
    return run(argv)
command_line._run = shortened
raise SystemExit(command_line.main())
"""
ROLLOUT = 256  # timesteps; a run that was interrupted within one ends less than one later
MODULE = ("-m", "push_recovery")
ROWS = ("**/outcomes.jsonl",)


@dataclass(frozen=True)
class LongCommand:
    """One command.

    Args:
        words: of its line, SUITE for a suite of 64 pushes, HARD for one of 8 hard ones, RESULTS for what
            `evaluate` has written.
        out: the option of its directory.
        kept: files whose lines must be the same in any order, whatever disturbed it.
        trains: with other pushes after it went on, so that only the end is compared.
        workers: whether it takes `--workers`.
        program: arguments of Python.
    """

    words: tuple[str, ...]
    out: str = "--out"
    kept: tuple[str, ...] = ROWS
    trains: bool = False
    workers: bool = True
    program: tuple[str, ...] = MODULE

    def line(self, place: Path, out: Path, workers: int) -> list[str]:
        """What to start, in a directory.

        Args:
            place: of what `prepare` has written.
            out: the command's own directory; a run of training goes on where it has a checkpoint there.
            workers: processes.
        """
        stands_for = {"SUITE": "suite.json", "HARD": "hard.json", "RESULTS": "results"}
        words = [str(place / stands_for[word]) if word in stands_for else word for word in self.words]
        if words[0] == "train" and any((out / "checkpoints").glob("[0-9]*")):
            words, where = ["train", "scratch"], ["--resume", str(out)]  # all else is that of the run
        else:
            where = [self.out, str(out)]
        number = ["--workers", str(workers)] if self.workers else []
        return [sys.executable, *self.program, *words, *number, *where]

    def content(self, out: Path) -> object:
        """What must be equal; of training the whole rollouts at its end, and what it leaves."""
        if self.trains:
            curve = next(out.rglob("curve.csv"))
            last = int(curve.read_text().splitlines()[-1].split(",")[0])
            folders = {out, curve.parent}
            return last // ROLLOUT, sorted(path.name for folder in folders for path in folder.iterdir())
        lines = {
            str(path.relative_to(out)): sorted(path.read_text().splitlines())
            for pattern in self.kept
            for path in out.glob(pattern)
        }
        return lines, [path.name for path in out.rglob("candidate*")]


COMMANDS = {
    "evaluate": LongCommand(
        ("evaluate", *PENDULUM, "--suite", "SUITE", "--policies", "stage-1", "two-stage")
    ),
    "compare": LongCommand(("compare", "stage-1", "fixed-time", "--suite", "HARD")),
    "frontier": LongCommand(
        ("frontier", *PENDULUM, "--policies", "stage-1", "two-stage", "--directions", "6", "--replicas", "4"),
        kept=("**/outcomes.jsonl", "frontier.json"),
    ),
    "basin": LongCommand(("basin", *PENDULUM, "--policies", "stage-1", "two-stage")),
    "ceiling": LongCommand(("ceiling", "--suite", "HARD", "--policies", "fixed-time", *SEARCH)),
    "reproduce": LongCommand(("reproduce", "limits"), kept=("**/outcomes.jsonl", "reproduction.json")),
    "tune": LongCommand(
        ("tune", *PENDULUM, "--policies", "stage-1", *BUDGET), kept=("**/outcomes.jsonl", "**/preset.json")
    ),
    "sensitivity": LongCommand(
        ("sensitivity", "--sample", "6", "--variations", "step-1ms", "--policies", "stage-1")
    ),
    "train": LongCommand(("train", "scratch", *PENDULUM, *TRAINING), trains=True, workers=False),
    "policies": LongCommand(
        ("policies", "residual"), trains=True, workers=False, program=("-c", SHORT_RECIPE)
    ),
    "kick": LongCommand(("protocol", "kick", "--episodes", "1", "--policies", "stage-1", "fixed-time")),
    "tour": LongCommand(("protocol", "tour", "--episodes", "2", "--policies", "stage-1")),
    "submit": LongCommand(
        ("submit", "RESULTS", "--suite", "SUITE", "--sample", "64", "--seed", "0"),
        out="--board", kept=("README.md", "*/*.json"),
    ),
}  # fmt: skip


def prepare(place: Path) -> None:
    """Write the suites, and the results that `submit` takes, into a folder."""
    place.mkdir(parents=True, exist_ok=True)
    Suite("head", "1", get_suite("standard").scenarios[:64]).save(place / "suite.json")
    Suite("hard-head", "1", get_suite("hard").scenarios[::128]).save(place / "hard.json")
    line = COMMANDS["evaluate"].line(place, place / "results", 1)
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603
