"""What each choice is worth: the largest push in five directions while one parameter varies, in place.

Shares are of F* from the start of the nominal step. A late measurement or a small weight walks another gait,
whose start may lie better or worse; that is why a share can exceed 1.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from .jobs import Job, Row, Rows, Table, key
from .pendulum import PushKind, ScanJob, Variant, pairs

NAME = "ablations"
DIRECTIONS = (-90.0, -45.0, 0.0, 45.0, 90.0)  # psi [deg]
GRIDS, GRIDS_JERK = (20.0, 5.0), (40.0, 10.0, 5.0)  # [N]
NOISE_SEEDS = (0, 1, 2)
TWO_STAGE, STAGE_1, PAPER = (Variant(arm, arm) for arm in ("two-stage", "stage-1", "two-stage-paper"))
UNAIDED = Variant("two-stage, no push estimate", "two-stage", pairs({"push_carry": 0.0}))


@dataclass(frozen=True)
class Sweep:
    """One parameter of one arm."""

    arm: str
    parameter: str  # with its unit
    cases: tuple[tuple[str, Variant], ...]  # value for people, what is run


def planner_sweep(base: Variant, name: str, unit: str, values: Sequence[Any], scale: float = 1.0) -> Sweep:
    """A field of PlannerConfig; `scale` turns its unit into the one shown."""
    cases = tuple(
        (f"{value * scale:g}", replace(base, planner=pairs({**dict(base.planner), name: value})))
        for value in values
    )
    return Sweep(base.label, f"{name} [{unit}]", cases)


def robot_sweep(base: Variant, name: str, values: Sequence[float]) -> Sweep:
    """A field of RobotModel [m]."""
    cases = tuple((f"{value:g}", replace(base, robot=pairs({name: value}))) for value in values)
    return Sweep(base.label, f"{name} [m]", cases)


def _weights() -> list[Sweep]:
    powers = [10.0**k for k in range(1, 9)]
    return [
        planner_sweep(STAGE_1, "alpha_offset", "1/m^2", powers),
        planner_sweep(TWO_STAGE, "alpha_offset", "1/m^2", powers),
        planner_sweep(TWO_STAGE, "beta_dcm", "1/m^2", [10.0**k for k in range(2, 9)]),
        planner_sweep(TWO_STAGE, "beta_trunk", "s^4/rad^2", [10.0**k for k in range(-5, 2)]),
        planner_sweep(TWO_STAGE, "beta_cop", "1/m^2", [10.0**k for k in range(-2, 4)]),
    ]


def _forms() -> list[Sweep]:
    """The form of stage 2 by its sampling time: with the paper's weights, then with the scaled ones."""
    forms = (
        ("paper's weights, jerk, repaired", PAPER, {"form": "jerk", "jerk_cost": "repaired"}),
        ("paper's weights, jerk, literal", PAPER, {"form": "jerk", "jerk_cost": "literal"}),
        ("paper's weights, zero-order hold", PAPER, {"form": "zoh"}),
        ("scaled weights, jerk, repaired", TWO_STAGE, {"form": "jerk", "jerk_cost": "repaired"}),
        ("two-stage", TWO_STAGE, {"form": "zoh"}),
    )
    samplings = (0.02, 0.03, 0.05, 0.1)
    return [
        planner_sweep(replace(base, label=label, planner=pairs(form)), "sampling_time", "ms", samplings, 1e3)
        for label, base, form in forms
    ]


def _fixed(base: Variant) -> Sweep:
    """What the step may adapt."""
    choices = (
        ("place and time", {}),
        ("place only", {"adapt_duration": False}),
        ("time only", {"adapt_step": False}),
        ("neither", {"adapt_duration": False, "adapt_step": False}),
    )
    cases = tuple((text, replace(base, planner=pairs(fields))) for text, fields in choices)
    return Sweep(base.label, "the step adapts", cases)


def _measurements(base: Variant) -> list[Sweep]:
    noise = tuple(
        (f"{1e3 * std:g}", replace(base, dcm_noise=std)) for std in (0.0, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
    )
    delay = tuple((f"{10 * periods}", replace(base, delay=periods)) for periods in (0, 1, 2, 3, 5))
    return [Sweep(base.label, "DCM noise [mm]", noise), Sweep(base.label, "delay [ms]", delay)]


@cache
def sweeps() -> tuple[Sweep, ...]:
    """All tables, in the order of the report."""
    periods = tuple(
        (f"{1e3 * period:g}", replace(TWO_STAGE, control_hz=1.0 / period))
        for period in (0.002, 0.005, 0.01, 0.02, 0.05)
    )
    return (
        *_weights(),
        *_forms(),
        planner_sweep(TWO_STAGE, "tail_intervals", "-", (0, 2, 4, 6, 8, 10)),
        robot_sweep(TWO_STAGE, "foot_width", (0.06, 0.08, 0.10, 0.13, 0.16)),
        robot_sweep(TWO_STAGE, "pelvis_width", (0.15, 0.20, 0.25, 0.30)),
        Sweep("two-stage", "control period [ms]", periods),
        _fixed(STAGE_1),
        _fixed(TWO_STAGE),
        *_measurements(TWO_STAGE),
        *_measurements(UNAIDED),
    )


def scan_job(variant: Variant, psi_deg: float) -> ScanJob:
    """Scan of one direction to 5 N; with noise every seed must survive."""
    grids = GRIDS_JERK if variant.jerk_form else GRIDS
    return ScanJob(variant, PushKind(psi_deg), grids, NOISE_SEEDS if variant.dcm_noise else (0,))


def jobs(directions: int) -> Iterable[Job]:
    """All scans; `directions` does not matter here."""
    return [scan_job(variant, psi) for sweep in sweeps() for _, variant in sweep.cases for psi in DIRECTIONS]


def summary(rows: Rows, directions: int) -> dict[str, Any]:
    """Tables as data."""
    return {"ablations": [_table(rows, sweep) for sweep in sweeps()]}


def _table(rows: Rows, sweep: Sweep) -> Row:
    cases = []
    for value, variant in sweep.cases:
        forces = [rows[key(scan_job(variant, psi))]["survived"] for psi in DIRECTIONS]
        limits = [PushKind(psi).limit(variant) for psi in DIRECTIONS]
        shares = [force / limit for force, limit in zip(forces, limits, strict=True)]
        about = {"value": value, "max_force_N": forces, "limit_N": limits}
        cases.append({**about, "fraction_mean": sum(shares) / len(shares), "fraction_worst": min(shares)})
    return {"arm": sweep.arm, "parameter": sweep.parameter, "psi_deg": list(DIRECTIONS), "cases": cases}


def tables(content: dict[str, Any]) -> list[Table]:
    """One table a parameter and arm; shares are of the F* of the robot in that row."""
    found = []
    for table in content["ablations"]:
        columns = (
            table["parameter"],
            *(f"{psi:g} deg" for psi in table["psi_deg"]),
            "share of F*, mean",
            "worst",
        )
        cells = [
            (case["value"], *(f"{force:.0f}" for force in case["max_force_N"]),
             f"{case['fraction_mean']:.3f}", f"{case['fraction_worst']:.3f}")
            for case in table["cases"]
        ]  # fmt: skip
        found.append(Table(f"{table['arm']}: largest force [N] by {table['parameter']}", columns, cells))
    return found


def draw(content: dict[str, Any], directory: Path) -> list[Path]:
    """No pictures."""
    return []
