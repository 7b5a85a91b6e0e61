"""Two studies beside the paper's scenarios: ablations, and the closed-form limits against a linear program.

Ablations: the largest push in five directions while one parameter varies, in place. Shares are of F* from the
start of the nominal step. A late measurement or a small weight walks another gait, whose start may lie better
or worse; that is why a share can exceed 1.

Limits: the largest push that theory allows by direction, in closed form and by a linear program over
trajectories.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar

from ...controllers.model.robot import RobotModel
from ...controllers.model.trajectory_program import TrajectoryProblem, trajectory_limit
from ..output.tables import Table
from ..score.threshold import directions_deg
from .jobs import Job, Row, Rows, ScanJob, Section, key
from .pendulum import PUSH_TIME, PushKind, Variant, pairs
from .scenarios import LIMITS, STAGE_1, TWO_STAGE

DIRECTIONS = (-90.0, -45.0, 0.0, 45.0, 90.0)  # psi [deg]
GRIDS, GRIDS_JERK = (20.0, 5.0), (40.0, 10.0, 5.0)  # [N]
NOISE_SEEDS = (0, 1, 2)
PAPER = Variant("two-stage-paper", "two-stage-paper")
UNAIDED = Variant("two-stage, no push estimate", "two-stage", pairs({"push_carry": 0.0}))


@dataclass(frozen=True)
class Sweep:
    """One parameter of one variant."""

    base: str  # label of the variant
    parameter: str  # with its unit
    cases: tuple[tuple[str, Variant], ...]  # value for people, variant that has it


def planner_sweep(base: Variant, name: str, unit: str, values: Sequence[Any], scale: float = 1.0) -> Sweep:
    """A field of PlannerConfig; `scale` turns its unit into the one shown."""
    fields = ({"planner": pairs({**dict(base.planner), name: value})} for value in values)
    texts = (f"{value * scale:g}" for value in values)
    return variant_sweep(base, f"{name} [{unit}]", zip(texts, fields, strict=True))


def variant_sweep(base: Variant, parameter: str, cases: Iterable[tuple[str, dict[str, Any]]]) -> Sweep:
    """Fields of the variant itself, by value for people."""
    return Sweep(base.label, parameter, tuple((text, replace(base, **fields)) for text, fields in cases))


def robot_sweep(name: str, values: Sequence[float]) -> Sweep:
    """A field of RobotModel [m] under `two-stage`."""
    cases = ((f"{value:g}", {"robot": pairs({name: value})}) for value in values)
    return variant_sweep(TWO_STAGE, f"{name} [m]", cases)


def adaptation_sweep(base: Variant) -> Sweep:
    """The step adapts its place, its time, both or neither."""
    no_place, no_time = {"adapt_step": False}, {"adapt_duration": False}
    choices = {
        "place and time": {}, "place only": no_time, "time only": no_place, "neither": no_place | no_time
    }  # fmt: skip
    cases = ((text, {"planner": pairs(fields)}) for text, fields in choices.items())
    return variant_sweep(base, "the step adapts", cases)


def measurement_sweeps(base: Variant) -> list[Sweep]:
    """Noise and delay of the measured motion."""
    noise = ((f"{1e3 * std:g}", {"dcm_noise": std}) for std in (0.0, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2))
    delay = ((f"{10 * periods}", {"delay": periods}) for periods in (0, 1, 2, 3, 5))
    return [variant_sweep(base, "DCM noise [mm]", noise), variant_sweep(base, "delay [ms]", delay)]


@cache
def sweeps() -> tuple[Sweep, ...]:
    """All tables, in the order of the report."""

    def powers(low: int, high: int) -> list[float]:
        return [10.0**k for k in range(low, high + 1)]

    forms = (  # of stage 2, by its sampling time: with the paper's weights, then with the scaled ones
        ("paper's weights, jerk, repaired", PAPER, {"form": "jerk", "jerk_cost": "repaired"}),
        ("paper's weights, jerk, literal", PAPER, {"form": "jerk", "jerk_cost": "literal"}),
        ("paper's weights, zero-order hold", PAPER, {"form": "zoh"}),
        ("scaled weights, jerk, repaired", TWO_STAGE, {"form": "jerk", "jerk_cost": "repaired"}),
        ("two-stage", TWO_STAGE, {"form": "zoh"}),
    )
    periods = (
        (f"{1e3 * period:g}", {"control_hz": 1.0 / period}) for period in (0.002, 0.005, 0.01, 0.02, 0.05)
    )
    by_form = [replace(base, label=label, planner=pairs(form)) for label, base, form in forms]
    return (
        planner_sweep(STAGE_1, "alpha_offset", "1/m^2", powers(1, 8)),
        planner_sweep(TWO_STAGE, "alpha_offset", "1/m^2", powers(1, 8)),
        planner_sweep(TWO_STAGE, "beta_dcm", "1/m^2", powers(2, 8)),
        planner_sweep(TWO_STAGE, "beta_trunk", "s^4/rad^2", powers(-5, 1)),
        planner_sweep(TWO_STAGE, "beta_cop", "1/m^2", powers(-2, 3)),
        *(planner_sweep(base, "sampling_time", "ms", (0.02, 0.03, 0.05, 0.1), 1e3) for base in by_form),
        planner_sweep(TWO_STAGE, "tail_intervals", "-", (0, 2, 4, 6, 8, 10)),
        robot_sweep("foot_width", (0.06, 0.08, 0.10, 0.13, 0.16)),
        robot_sweep("pelvis_width", (0.15, 0.20, 0.25, 0.30)),
        variant_sweep(TWO_STAGE, "control period [ms]", periods),
        adaptation_sweep(STAGE_1),
        adaptation_sweep(TWO_STAGE),
        *measurement_sweeps(TWO_STAGE),
        *measurement_sweeps(UNAIDED),
    )  # fmt: skip


def scan_job(variant: Variant, psi_deg: float) -> ScanJob:
    """Scan of one direction to 5 N; with noise every seed must survive."""
    grids = GRIDS_JERK if variant.jerk_form else GRIDS
    return ScanJob(variant, PushKind(psi_deg), grids, NOISE_SEEDS if variant.dcm_noise else (0,))


def ablation_jobs(directions: int) -> Iterable[Job]:
    """All scans; `directions` does not matter here."""
    return [scan_job(variant, psi) for sweep in sweeps() for _, variant in sweep.cases for psi in DIRECTIONS]


def ablation_summary(rows: Rows, directions: int) -> Row:
    """Tables as data."""
    found = []
    for sweep in sweeps():
        cases = []
        for value, variant in sweep.cases:
            forces = [rows[key(scan_job(variant, psi))]["survived"] for psi in DIRECTIONS]
            limits = [PushKind(psi).limit(variant) for psi in DIRECTIONS]
            shares = [force / limit for force, limit in zip(forces, limits, strict=True)]
            about = {"value": value, "max_force_N": forces, "limit_N": limits}
            cases.append({**about, "fraction_mean": sum(shares) / len(shares), "fraction_worst": min(shares)})
        about = {"arm": sweep.base, "parameter": sweep.parameter, "psi_deg": list(DIRECTIONS)}
        found.append({**about, "cases": cases})
    return {"ablations": found}


def ablation_tables(content: Row) -> list[Table]:
    """One table a parameter and variant; shares are of the F* of the robot in that row."""
    found = []
    for table in content["ablations"]:
        directions = [f"{psi:g} deg" for psi in table["psi_deg"]]
        cells = [
            (case["value"], *(f"{force:.0f}" for force in case["max_force_N"]),
             f"{case['fraction_mean']:.3f}", f"{case['fraction_worst']:.3f}")
            for case in table["cases"]
        ]  # fmt: skip
        title = f"{table['arm']}: largest force [N] by {table['parameter']}"
        found.append(Table(title, (table["parameter"], *directions, "share of F*, mean", "worst"), cells))
    return found


CHECKED = 12  # directions at most in which the program is solved
PERIOD = 0.01  # of planning: a velocity jump is seen this late at most [s]
KINDS: dict[str, tuple[float, dict[str, Any]]] = {
    **{label: (PUSH_TIME, options) for label, options in LIMITS.items()},
    "F*, inputs frozen during the push": (PUSH_TIME, {"reaction": PUSH_TIME}),
    "velocity jump": (0.0, {}),
    "velocity jump, seen after one period": (0.0, {"reaction": PERIOD}),
}  # label -> duration [s], options of the closed form


@dataclass(frozen=True)
class ProgramJob(Job):
    """The linear program in one direction."""

    FIELDS: ClassVar[tuple[str, ...]] = ("strength",)
    kind: str  # of KINDS
    psi_deg: float

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        return {"kind": "program", "limit": self.kind, "psi_deg": self.psi_deg}

    @property
    def text(self) -> str:
        """Words for the progress bar."""
        return f"{self.kind}, {self.psi_deg:g} deg"

    def run(self) -> Row:
        """Solve it; the strength in newtons, or in N s for a velocity jump."""
        duration, options = KINDS[self.kind]
        problem = TrajectoryProblem(RobotModel(), math.radians(self.psi_deg), duration, **options)
        found = trajectory_limit(problem)
        return {"strength": None if found is None else found.force if duration > 0 else found.impulse}


def limit_jobs(directions: int) -> Iterable[Job]:
    """The programs; the closed form costs nothing."""
    return [ProgramJob(kind, psi) for kind in KINDS for psi in directions_deg(min(directions, CHECKED))]


def limit_summary(rows: Rows, directions: int) -> Row:
    """Closed form by direction, and how far the program is from it."""
    closed, programs, robot = {}, [], Variant("the paper's robot")
    for kind, (duration, options) in KINDS.items():

        def limit(psi: float, duration: float = duration, options: dict[str, Any] = options) -> float:
            return PushKind(psi, duration).limit(robot, **options)

        field, unit = ("limit_N", "N") if duration > 0 else ("limit_Ns", "N s")
        closed[kind] = [{"psi_deg": psi, field: limit(psi)} for psi in directions_deg(directions)]
        cases = []
        for psi in directions_deg(min(directions, CHECKED)):
            program = rows[key(ProgramJob(kind, psi))]["strength"]
            cases.append({"psi_deg": psi, "closed_form": limit(psi), "program": program})
        solved = [case for case in cases if case["program"] is not None]
        difference = max((abs(case["program"] - case["closed_form"]) for case in solved), default=None)
        about = {"limit": kind, "unit": unit, "cases": cases, "largest_difference": difference}
        programs.append({**about, "unsolved": len(cases) - len(solved)})
    return {"limits": {"closed_form": closed, "program": programs}}


def limit_tables(content: Row) -> list[Table]:
    """The closed form in the directions of the program, and the largest difference between the two."""
    program = content["limits"]["program"]
    cells = [
        (entry["limit"], entry["unit"], *(f"{case['closed_form']:.1f}" for case in entry["cases"]),
         "-" if entry["largest_difference"] is None else f"{entry['largest_difference']:.3f}")
        for entry in program
    ]  # fmt: skip
    columns = ("limit", "unit", *(f"{case['psi_deg']:g}" for case in program[0]["cases"]), "difference")
    title = "Closed-form limits by psi [deg]; last the largest difference from the linear program"
    return [Table(title, columns, cells)]


ABLATIONS = Section("ablations", ablation_jobs, ablation_summary, ablation_tables)
LIMITS_STUDY = Section("limits", limit_jobs, limit_summary, limit_tables)  # its curves are on Fig. 7
