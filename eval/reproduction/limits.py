"""What theory allows by direction: the closed form, and a linear program over trajectories beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ...controllers.model.robot import RobotModel
from ...controllers.model.trajectory_program import TrajectoryProblem, trajectory_limit
from ..score.frontier import directions_deg
from .jobs import Job, Row, Rows, Table, key
from .pendulum import PUSH_TIME, PushKind, Variant
from .scenario_2 import LIMITS

NAME = "limits"
CHECKED = 12  # directions in which the program is solved
PERIOD = 0.01  # of planning: a velocity jump is seen this late at most [s]
PAPER = Variant("the paper's robot")
KINDS: dict[str, tuple[float, dict[str, Any]]] = {
    **{label: (PUSH_TIME, options) for label, options in LIMITS.items()},
    "F*, inputs frozen during the push": (PUSH_TIME, {"reaction": PUSH_TIME}),
    "velocity jump": (0.0, {}),
    "velocity jump, seen after one period": (0.0, {"reaction": PERIOD}),
}  # label -> duration [s], options of the closed form


@dataclass(frozen=True)
class ProgramJob:
    """The linear program in one direction."""

    FIELDS: ClassVar[tuple[str, ...]] = ("strength",)
    kind: str  # of KINDS
    psi_deg: float

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        return {"kind": "program", "limit": self.kind, "psi_deg": self.psi_deg}

    @property
    def text(self) -> str:
        """For the progress bar."""
        return f"{self.kind}, {self.psi_deg:g} deg"

    def run(self) -> Row:
        """Solve it; the strength in newtons, or in N s for a velocity jump."""
        duration, options = KINDS[self.kind]
        problem = TrajectoryProblem(RobotModel(), math.radians(self.psi_deg), duration, **options)
        found = trajectory_limit(problem)
        strength = None if found is None else found.force if duration > 0 else found.impulse
        return {"strength": strength}


def jobs(directions: int) -> Iterable[Job]:
    """The programs; the closed form costs nothing."""
    return [ProgramJob(kind, psi) for kind in KINDS for psi in directions_deg(CHECKED)]


def summary(rows: Rows, directions: int) -> dict[str, Any]:
    """Closed form by direction, and how far the program is from it."""
    closed = {}
    for kind, (duration, options) in KINDS.items():
        field = "limit_N" if duration > 0 else "limit_Ns"
        closed[kind] = [
            {"psi_deg": psi, field: PushKind(psi, duration).limit(PAPER, **options)}
            for psi in directions_deg(directions)
        ]
    return {"limits": {"closed_form": closed, "program": [_compared(rows, kind) for kind in KINDS]}}


def _compared(rows: Rows, kind: str) -> Row:
    duration, options = KINDS[kind]
    cases = []
    for psi in directions_deg(CHECKED):
        value = PushKind(psi, duration).limit(PAPER, **options)
        cases.append(
            {"psi_deg": psi, "closed_form": value, "program": rows[key(ProgramJob(kind, psi))]["strength"]}
        )
    differences = [
        abs(case["program"] - case["closed_form"]) for case in cases if case["program"] is not None
    ]
    return {
        "limit": kind,
        "unit": "N" if duration > 0 else "N s",
        "cases": cases,
        "largest_difference": max(differences, default=None),
        "unsolved": len(cases) - len(differences),
    }


def tables(content: dict[str, Any]) -> list[Table]:
    """The closed form in the directions of the program, and the largest difference between the two."""
    program = content["limits"]["program"]
    psi = [case["psi_deg"] for case in program[0]["cases"]]
    cells = [
        (entry["limit"], entry["unit"], *(f"{case['closed_form']:.1f}" for case in entry["cases"]),
         "-" if entry["largest_difference"] is None else f"{entry['largest_difference']:.3f}")
        for entry in program
    ]  # fmt: skip
    columns = ("limit", "unit", *(f"{angle:g}" for angle in psi), "difference")
    title = "Closed-form limits by psi [deg]; last the largest difference from the linear program"
    return [Table(title, columns, cells)]


def draw(content: dict[str, Any], directory: Path) -> list[Path]:
    """No pictures: the curves are on those of scenario 2."""
    return []
