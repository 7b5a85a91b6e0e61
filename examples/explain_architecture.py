"""Draw the picture of docs/architecture.md: python examples/explain_architecture.py [DIR]."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

COLOURS = {"controllers": "#cfe3f5", "envs": "#d9efd3", "eval": "#fbe3c8", "training": "#e6dbf2"}
INK = "#333333"
BOX = (1.98, 0.95)  # width and height of a room


class Room(NamedTuple):
    """A folder of the tree and where it is drawn."""

    folder: str
    says: str
    x: float
    y: float


ROOMS = (
    Room("envs/sensing", "sensors of its own,\nor the true state", 0.0, 5.0),
    Room("controllers/estimation", "what is seen", 2.7, 5.0),
    Room("controllers/stage_1", "where and when\nto step", 5.4, 5.0),
    Room("controllers/stage_2", "CoP and trunk", 8.1, 5.0),
    Room("controllers/policies", "planner, arms", 10.8, 5.0),
    Room("envs/physics", "MuJoCo", 0.0, 3.4),
    Room("envs/biped", "a period of n robots", 2.7, 3.4),
    Room("controllers/whole_body", "gait machine,\ntorques", 5.4, 3.4),
    Room("envs/residual", "corrections", 8.1, 3.4),
    Room("controllers/baselines", "the field's planners", 10.8, 3.4),
    Room("envs/scenario", "pushes, command,\nmodel errors", 0.0, 1.9),
    Room("envs/episode", "start, reward, end", 2.7, 1.9),
    Room("envs/pendulum", "the theory's model", 5.4, 1.9),
    Room("training", "PPO", 8.1, 1.9),
    Room("envs/joint", "actions on the joints", 10.8, 1.9),
    Room("eval/rollout", "outcomes", 0.0, 0.4),
    Room("eval/score", "suites, statistics", 2.7, 0.4),
    Room("eval/frontier", "largest push, F*", 5.4, 0.4),
    Room("eval/sensitivity", "what outcomes\nhang on", 8.1, 0.4),
    Room("eval/cli", "the command line", 10.8, 0.4),
)
BELOW = (
    "Beneath all of it, in controllers/: model (robot, gait box, frame, nominal gait, largest push), "
    "settings (presets), solvers, compiled; joints (PD control, proprioception), "
    "learned (networks).\n"
    "Beside them, in envs/: snapshot (a robot put back); in eval/: processes (workers, locks), output (rows, "
    "tables), measures (effort), shipped (what was learned), learned (how, and what it adds),\n"
    "api (Python functions), bench, tuning, ceiling, robots (made of models), export (ONNX), "
    "protocols (pushes of others), leaderboard,\n"
    "report (a page), reproduction, record (time histories), film (moving pictures), play (a robot to push)."
)
FLOW = (  # from, to, what goes along
    ("envs/sensing", "controllers/estimation", "readings"),
    ("controllers/estimation", "controllers/stage_1", "observation"),
    ("controllers/stage_1", "controllers/stage_2", "step, DCM goal"),
    ("controllers/stage_2", "controllers/policies", "CoP, trunk"),
    ("controllers/baselines", "controllers/policies", "step"),
    ("controllers/policies", "envs/residual", "action"),
    ("envs/residual", "controllers/whole_body", "action"),
    ("controllers/whole_body", "envs/biped", "torque"),
    ("envs/biped", "envs/physics", "torque, push"),
    ("envs/physics", "envs/sensing", "state"),
    ("envs/scenario", "envs/episode", "push"),
    ("envs/scenario", "eval/rollout", "scenario"),
    ("envs/episode", "envs/biped", "start, push"),
    ("envs/episode", "envs/pendulum", "start, push"),
    ("eval/rollout", "eval/score", "rows"),
    ("eval/score", "eval/frontier", ""),
    ("eval/frontier", "eval/sensitivity", ""),
    ("eval/sensitivity", "eval/cli", "report"),
    ("training", "envs/residual", "learned action"),
    ("training", "envs/joint", ""),
)


def draw() -> Any:
    """The rooms, coloured by package, and what goes from one to the next."""
    figure = Figure(figsize=(13.8, 6.3), facecolor="white")
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set(xlim=(-0.2, 13.1), ylim=(-0.75, 6.5))
    axes.axis("off")
    at = {room.folder: (room.x, room.y) for room in ROOMS}
    for room in ROOMS:
        colour = COLOURS[room.folder.split("/")[0]]
        patch = FancyBboxPatch((room.x, room.y), *BOX, "round,pad=0.03", fc=colour, ec=INK, lw=0.8)
        axes.add_patch(patch)
        middle = room.x + BOX[0] / 2
        axes.text(middle, room.y + 0.76, room.folder, ha="center", va="center", weight="bold", size=8.5)
        axes.text(middle, room.y + 0.33, room.says, ha="center", va="center", size=8, color=INK)
    for start, end, word in FLOW:
        _arrow(axes, at[start], at[end], word)
    axes.text(0.0, 6.25, "one planning period, 10 ms", style="italic", size=9)
    axes.text(0.0, -0.55, BELOW, size=8, color=INK)
    return figure


def _arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], word: str) -> None:
    """From the side of one box that faces the other, with a word beside it."""
    (x0, y0), (x1, y1) = start, end
    width, height = BOX
    if y0 == y1:
        side = 1 if x1 > x0 else -1
        tail = x0 + (width + 0.06 if side > 0 else -0.06), y0 + height / 2
        head = x1 + (-0.06 if side > 0 else width + 0.06), y1 + height / 2
        place, align = ((tail[0] + head[0]) / 2, tail[1] + 0.1), "center"
    else:
        down = y1 < y0
        tail = x0 + width / 2, y0 + (-0.06 if down else height + 0.06)
        head = x1 + width / 2, y1 + (height + 0.06 if down else -0.06)
        shift, align = ((-0.2, 0.06), "right") if x0 != x1 else ((0.08, -0.04), "left")
        place = (tail[0] + head[0]) / 2 + shift[0], (tail[1] + head[1]) / 2 + shift[1]
    axes.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.0})
    lines = word.replace(", ", ",\n")
    axes.text(*place, lines, ha=align, va="bottom" if align == "center" else "center", size=7, color=INK)


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures")
    draw().savefig(folder / "architecture.png", dpi=130)
