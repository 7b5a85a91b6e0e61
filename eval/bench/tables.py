"""The numbers of `push-recovery bench` as tables for a terminal."""

from __future__ import annotations

import re
from typing import Any

from ..output.tables import print_table
from .keys import KEYS
from .solvers import MODULES

ROBOTS = re.compile(r"period_us_(\d+)_robots_(\d+)_threads")
SOLVER = re.compile(r"stage_1_(\w+)_us")
OURS = "this planner"


def number(value: Any) -> str:
    """A number, or a median and its 99th percentile."""
    if isinstance(value, dict):
        return f"{value['median']:.2f} (p99 {value['p99']:.2f})"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def key_cells(content: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Key, value and meaning of what stands alone."""
    return [(key, number(content[key]), meaning) for key, meaning in KEYS.items() if key in content]


def robot_cells(content: dict[str, Any]) -> list[tuple[str, ...]]:
    """Robots, threads, period of one robot, real-time factor, cost over physics."""
    cells = []
    for match in filter(None, map(ROBOTS.fullmatch, content)):
        label = f"{match[1]}_robots_{match[2]}_threads"
        values = [content[f"{name}_{label}"] for name in ("period_us", "rtf", "cost_over_physics")]
        cells.append((match[1], match[2], f"{values[0]:.0f}", f"{values[1]:.0f}", f"{values[2]:.2f}"))
    return cells


def solver_cells(content: dict[str, Any]) -> list[tuple[str, ...]]:
    """Solver, stage 1, stage 2, error of stage 2; the planner's own first, what is missing last."""
    if "solvers_missing" not in content:
        return []
    cells = [(OURS, number(content["stage_1_us"]), number(content["stage_2_us"]), "-")]
    for match in filter(None, map(SOLVER.fullmatch, content)):
        if f"stage_2_{match[1]}_error_m" in content:
            first, second = (number(content[f"stage_{stage}_{match[1]}_us"]) for stage in (1, 2))
            cells.append((match[1], first, second, f"{content[f'stage_2_{match[1]}_error_m']:.0e} m"))
    for name in content["solvers_missing"]:
        cells.append((name, "not installed", f"pip install {MODULES[name]}", "-"))
    return cells


def print_tables(content: dict[str, Any]) -> None:
    """All tables on standard output."""
    title = f"{content['env']}: rtf = simulated seconds per wall second, times in microseconds"
    print_table(title, ("", "value", "what"), key_cells(content))
    if cells := robot_cells(content):
        columns = ("robots", "threads", "period of a robot [us]", "rtf", "cost over bare physics")
        print_table("Closed loop of many robots", columns, cells)
    if cells := solver_cells(content):
        columns = ("solver", "stage 1 [us]", "stage 2, both axes [us]", "CoP from ours")
        print_table("The planner's problems from Python, one call each: median (p99)", columns, cells)
