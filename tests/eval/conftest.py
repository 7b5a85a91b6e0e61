"""The toy environment for spawned workers, and evaluations whose rows are written by hand."""

import hashlib
import io
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from PIL import Image
from push_recovery.eval.output.rows import RowFile
from push_recovery.eval.score.evaluate import Evaluation
from push_recovery.eval.score.suites import Suite, get_suite

# Spawned workers inherit sys.path and import the toy environment by name, as gym.make("MODULE:ID") does.
sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def interrupted(monkeypatch) -> Callable[..., None]:
    """Calls a function to which Ctrl-C comes when so many of its rows are on disk."""

    def call(rows: int, function: Callable, *arguments) -> None:
        def counting(store: RowFile, row: dict, append=RowFile.append) -> None:
            append(store, row)
            if len(store.rows) == rows:
                raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(RowFile, "append", counting)
            with pytest.raises(KeyboardInterrupt):
                function(*arguments)

    return call


@pytest.fixture(scope="session")
def sketching() -> Callable[[], AbstractContextManager[None]]:
    """Where figures are saved in a few bytes that differ where lines, marks or words do, and not drawn."""

    @contextmanager
    def context() -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Figure, "savefig", sketch)
            yield

    return context


@pytest.fixture
def sketched(sketching) -> Iterator[None]:
    """A test whose figures are sketched."""
    with sketching():
        yield


@pytest.fixture
def evaluation(tmp_path, evaluation_in) -> Callable[..., Evaluation]:
    """Of policies given as words of r (recovers), s (survives), f (falls), one letter a push of `quick`."""
    return partial(evaluation_in, tmp_path)


@pytest.fixture(scope="session")
def evaluation_in() -> Callable[..., Evaluation]:
    """The same, whose rows lie in a directory that is given."""

    def make(
        directory: Path, policies: dict[str, str], env_id: str = "PushRecovery/Pendulum-v0"
    ) -> Evaluation:
        scenarios = get_suite("quick").scenarios[: len(next(iter(policies.values())))]
        suite = Suite("head", "1", scenarios)
        rows = {name: [row(name, *pair) for pair in zip(scenarios, word, strict=True)]
                for name, word in policies.items()}  # fmt: skip
        write(directory, rows.values())
        return Evaluation(suite, env_id, rows, directory, 0.0)

    return make


def sketch(figure: Figure, file: Any, **options: Any) -> None:
    """Write a figure's size and a digest of what is in it."""
    digest = hashlib.sha512()
    for artist in figure.findobj():
        digest.update(type(artist).__name__.encode())
        for shown in ("get_text", "get_xydata", "get_offsets", "get_array"):
            if (content := getattr(artist, shown, str)()) is not None:
                digest.update(content.encode() if isinstance(content, str) else bytes(content))
    if options["format"] == "svg":
        width, height = 72.0 * figure.get_size_inches()
        drawn = f'<svg viewBox="0 0 {width} {height}"><text>{digest.hexdigest()}</text></svg>'
        file.write(drawn if isinstance(file, io.TextIOBase) else drawn.encode())
    else:
        Image.frombytes("RGB", (4, 4), digest.digest()[:48]).save(file, options["format"])


def row(policy: str, scenario, letter: str) -> dict:
    return {
        "scenario_id": scenario.id, "policy": policy, "recovered": letter == "r", "survived": letter != "f",
        "failure_reason": "com_height" if letter == "f" else None, "end_time": 3.25,
        "impulse": scenario.pushes[0].impulse_magnitude,
        "psi_deg": math.degrees(scenario.pushes[0].direction),
        "first_limit": "cop" if letter == "f" else None,
        "limit_shares": {"cop": 0.5} if letter == "f" else {}, "policy_sha256": None,
        "recovered_at": 2.0 if letter == "r" else None,
        "measures": {"steps": 7, "smallest_margin": 0.251, "dcm_error": 0.01, "velocity_error": 0.02,
                     "trunk_excursion": 0.5, "peak_torque": 123.0, "mean_torque": 45.6, "energy": 7890.0},
    }  # fmt: skip


def write(directory: Path, groups: Iterable) -> None:
    lines = [json.dumps(one) + "\n" for rows in groups for one in rows]
    (directory / "outcomes.jsonl").write_text("".join(lines))
