"""Does it pay to choose the planner's numbers for each push? python benchmarks/preset_per_push.py [N].

N presets (the shipped one, and others drawn about it as the first generation of a search draws them) meet
the same 1024 development pushes like those of `hard`. Printed are the best of them for all pushes; the
pushes that one at least recovers from, which is what a choice with hindsight reaches; and a chooser that is
told the true push: it takes the preset that did best on like pushes, other than those it is scored on.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from push_recovery.envs.scenario.push import GaitEvent
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout import default_workers
from push_recovery.eval.score.kinds import DRAWS
from push_recovery.eval.tuning.pushes import BIPED, RECOVERED, Scorer
from push_recovery.eval.tuning.study import TuningSettings, preset_of, space_of

SEED = 20270116
FOLDS = 8
WIDTHS = (0.25, 0.5, 1.0)  # of the kernel, in units of `likeness`
UNITS = (20.0, 0.15, 0.15)  # impulse [N s], phase, speed [m/s] that count as much as 0.35 rad of direction


def likeness(scenario: Scenario) -> NDArray[np.float64]:
    """Where a push lies among pushes; those on a right stance are mirrored, (6,)."""
    push = scenario.pushes[0]
    assert isinstance(push.start, GaitEvent)  # noqa: S101
    side = 1.0 if push.start.side == "left" else -1.0
    x, y = push.force[0], side * push.force[1]
    force = math.hypot(x, y)
    command = scenario.command
    return np.array([
        x / force / 0.35, y / force / 0.35, force * push.duration / UNITS[0], push.start.fraction / UNITS[1],
        command.vx / UNITS[2], side * command.vy / UNITS[2],
    ])  # fmt: skip


def chosen(
    recovered: NDArray[np.bool_], places: NDArray[np.float64], width: float, fold: NDArray[np.int64]
) -> int:
    """Pushes recovered from where each fold takes the presets that did best on like pushes of the others."""
    distance = np.sum((places[:, None] - places[None]) ** 2, axis=2)
    weight = np.exp(-0.5 * distance / width**2) + 1e-6  # where nothing is near, the best of all
    weight *= fold[:, None] != fold[None]
    mean = weight @ recovered.T / weight.sum(axis=1, keepdims=True)
    return int(recovered.T[np.arange(len(places)), mean.argmax(axis=1)].sum())


def main() -> None:
    """Print a line for each preset, and what choosing brings."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    settings = TuningSettings(BIPED, "two-stage", space="planner")
    space, rng = space_of(settings), np.random.default_rng(SEED)
    points = [np.zeros(len(space.dimensions)), *rng.normal(size=(count - 1, len(space.dimensions)))]
    scenarios = DRAWS["hard"].stratified("choice", 4, SEED)
    rows = []
    with tempfile.TemporaryDirectory() as folder, Scorer(BIPED, "two-stage", default_workers()) as scorer:
        for number, point in enumerate(points):
            path = Path(folder) / f"{number}.json"
            preset_of(settings, space.settings(point)).save(path)
            rows.append(np.array(scorer.values(path, scenarios)) == RECOVERED)
            print(f"preset {number}: {rows[-1].sum()} of {len(scenarios)}, any so far "
                  f"{np.any(rows, axis=0).sum()}", flush=True)  # fmt: skip
    recovered, places = np.array(rows), np.array([likeness(one) for one in scenarios])
    fold = np.arange(len(scenarios)) % FOLDS
    print(f"shipped {recovered[0].sum()}, best of all {recovered.sum(axis=1).max()}, "
          f"one at least {recovered.any(axis=0).sum()}")  # fmt: skip
    for width in WIDTHS:
        print(f"chosen by the true push, kernel {width:g}: {chosen(recovered, places, width, fold)}")


if __name__ == "__main__":
    main()
