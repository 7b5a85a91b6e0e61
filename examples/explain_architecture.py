"""Draw the picture of docs/architecture.md: python examples/explain_architecture.py [DIR]."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle
from push_recovery.eval.record import style

COLOURS = {"controllers": "#cfe3f5", "envs": "#d9efd3", "eval": "#fbe3c8", "training": "#e6dbf2"}
INK = "#333333"
# All lengths are in inches; 8 points are read well where the picture is as wide as a page.
SIZE = (7.2, 7.0)  # of the picture
BOX = (1.32, 0.62)  # of a room
PITCH = (1.89, 0.99)  # from one room to the next
EDGE = 0.1  # around it all
LIST = 1.06  # from the bottom to the top of the list of rooms that are not drawn
GAP = 0.03  # between an arrow and a room
WORDS: Any = {"size": 8, "color": INK, "linespacing": 1.05}


class Room(NamedTuple):
    """A folder or a file of the tree, and its place: column from the left and row from the top."""

    folder: str
    says: str
    column: int
    row: int


ROOMS = (
    Room("envs/sensing", "sensors, or\nthe true state", 0, 0),
    Room("controllers/estimation", "what is seen", 1, 0),
    Room("controllers/stage_1", "where and\nwhen to step", 2, 0),
    Room("controllers/stage_2", "CoP and trunk", 3, 0),
    Room("controllers/policies", "planner,\nlearned policies", 3, 1),
    Room("envs/simulation", "MuJoCo", 0, 2),
    Room("envs/biped", "a period of\nn robots", 1, 2),
    Room("controllers/whole_body", "gait machine,\ntorques", 2, 2),
    Room("envs/wrappers", "corrections", 3, 2),
    Room("envs/pendulum", "the theory's\nmodel", 0, 3),
    Room("envs/episode", "start, reward,\nend", 1, 3),
    Room("envs/joint", "actions on\nthe joints", 2, 3),
    Room("training", "PPO", 3, 3),
    Room("envs/scenario", "pushes, command,\nmodel errors", 1, 4),
    Room("eval/rollout", "outcomes", 2, 4),
    Room("eval/score", "suites, F*,\nstatistics", 3, 4),
    Room("eval/report", "pages", 3, 5),
    Room("eval/cli", "the command line", 2, 5),
)
BELOW = (  # what is not drawn, on which the rest stands or which stands on it
    ("controllers", "model, settings, qp, jit, array_table, math3, validation, files, errors, joint_control"),
    ("envs", "robots, snapshot (a robot put back), rendering"),
    (
        "eval",
        "api, output (rows, tables, processes), search, sampling_mpc, hindsight, ceiling,\n"
        "record (histories, films), play (a robot to push), protocols, reproduction,\n"
        "tuning, robot_tools, bench",
    ),
)
FLOW = (  # from, to, what goes along
    ("envs/sensing", "controllers/estimation", "readings"),
    ("controllers/estimation", "controllers/stage_1", "observed"),
    ("controllers/stage_1", "controllers/stage_2", "step,\nDCM goal"),
    ("controllers/stage_2", "controllers/policies", "CoP, trunk"),
    ("controllers/policies", "envs/wrappers", "action"),
    ("envs/wrappers", "controllers/whole_body", "action"),
    ("controllers/whole_body", "envs/biped", "torque"),
    ("envs/biped", "envs/simulation", "torque,\npush"),
    ("envs/simulation", "envs/sensing", "state"),
    ("envs/scenario", "envs/episode", "push"),
    ("envs/scenario", "eval/rollout", "scenario"),
    ("envs/episode", "envs/biped", "start, push"),
    ("envs/episode", "envs/pendulum", "start,\npush"),
    ("eval/rollout", "eval/score", "rows"),
    ("eval/score", "eval/report", ""),
    ("eval/report", "eval/cli", "page"),
    ("training", "envs/wrappers", "learned\naction"),
    ("training", "envs/joint", ""),
)


def draw() -> Figure:
    """The rooms, coloured by package, and what goes from one to the next."""
    figure = Figure(figsize=SIZE, facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, SIZE[0]), ylim=(0, SIZE[1]))
    axes.axis("off")
    middles = {room.folder: _middle(room) for room in ROOMS}
    for room in ROOMS:
        package, _, name = room.folder.rpartition("/")
        middle = middles[room.folder]
        look = {"fc": COLOURS[package or name], "ec": INK, "lw": 0.8}
        corner = middle - np.array(BOX) / 2
        axes.add_patch(FancyBboxPatch(corner, *BOX, "round,pad=0,rounding_size=0.05", **look))
        axes.text(*middle + (0, 0.17), name, ha="center", va="center", weight="bold", size=9.5)
        axes.text(*middle - (0, 0.11), room.says, ha="center", va="center", **WORDS)
    for start, end, word in FLOW:
        _arrow(axes, middles[start], middles[end], word)
    inside = middles["controllers/estimation"][0], middles["controllers/policies"][1]
    axes.text(*inside, "one planning\nperiod, 10 ms", ha="center", va="center", style="italic", size=9.5)
    _list(axes)
    return figure


def _middle(room: Room) -> Any:
    left, top = EDGE + BOX[0] / 2, SIZE[1] - EDGE - BOX[1] / 2
    return np.array([left + room.column * PITCH[0], top - room.row * PITCH[1]])


def _arrow(axes: Any, start: Any, end: Any, word: str) -> None:
    """From the side of one box to that of the other that faces it, with a word above or beside it."""
    way = np.sign(end - start) * (np.array(BOX) / 2 + GAP)
    tail, head = start + way, end - way
    look = {"arrowstyle": "-|>", "color": INK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", head, tail, arrowprops=look)
    if start[1] == end[1]:
        axes.text(*(tail + head) / 2 + (0, 0.06), word, ha="center", va="bottom", **WORDS)
    else:
        axes.text(*(tail + head) / 2 + (0.08, 0), word, ha="left", va="center", **WORDS)


def _list(axes: Any) -> None:
    """The colours of the packages, and the rooms that are not drawn."""
    y = LIST
    for package, rooms in BELOW:
        axes.add_patch(Rectangle((EDGE, y - 0.13), 0.14, 0.14, fc=COLOURS[package], ec=INK, lw=0.8))
        axes.text(EDGE + 0.22, y, package, weight="bold", size=9, va="top")
        axes.text(EDGE + 1.15, y, f"also {rooms}", va="top", size=8, color=INK)
        y -= 0.23


def main() -> None:
    """Write the picture into the directory given, docs/pictures by default."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "pictures")
    with style.print_style():
        _, svg = style.save(draw(), directory, "architecture")
    svg.unlink()


if __name__ == "__main__":
    main()
