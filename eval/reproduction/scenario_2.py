"""Scenario 2 (Fig. 7): the largest push by direction, every arm against the closed-form limits, in place.

The same for a velocity jump, where knowing of a push early is worth nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from ..score.frontier import directions_deg
from .jobs import Job, Rows, Table, key
from .pendulum import PUSH_TIME, PushKind, ScanJob, Variant, pairs

NAME = "scenario-2"
TWO_STAGE, STAGE_1 = Variant("two-stage", "two-stage"), Variant("stage-1", "stage-1")
ARMS = (
    Variant("stage-1-paper", "stage-1-paper"),
    STAGE_1,
    Variant("stage-1+cop", "stage-1+cop"),
    Variant("stage-1+momentum", "stage-1+momentum"),
    Variant("two-stage-paper", "two-stage-paper"),
    TWO_STAGE,
)
EXTRA_ARMS = (
    Variant("two-stage+double-support", "two-stage", preset="double-support"),
    Variant("two-stage, no push estimate", "two-stage", pairs({"push_carry": 0.0})),
    Variant("two-stage, no trunk debt", "two-stage", pairs({"trunk_debt": False})),
    Variant("two-stage, plain DCM", "two-stage", pairs({"push_carry": 0.0, "trunk_debt": False})),
)  # what belongs to `two-stage` taken away, or added to it
JUMP_ARMS = (STAGE_1, TWO_STAGE, *EXTRA_ARMS)

LIMITS = {
    "point foot": {"foot": False, "flywheel": False},
    "+ foot": {"foot": True, "flywheel": False},
    "+ flywheel": {"foot": False, "flywheel": True},
    "F*": {"foot": True, "flywheel": True},
}  # label -> options of the closed form
JUMP = 0.0  # duration of a velocity jump [s]
GRIDS = (5.0, 1.0)  # [N]
GRIDS_JERK = (20.0, 5.0, 1.0)  # the paper's form costs ten times as much
LIMIT_DIRECTIONS = 180  # of the limits' curves
STRENGTH = {"N": "max_force_N", "Ns": "max_impulse_Ns"}  # field by unit
PICTURES = (
    ("fig7_limits", "scenario_2", "N", PUSH_TIME, (*ARMS, EXTRA_ARMS[0])),
    ("fig7_variants", "scenario_2", "N", PUSH_TIME, (TWO_STAGE, *EXTRA_ARMS[1:])),
    ("fig7_jump", "jump", "Ns", JUMP, (STAGE_1, TWO_STAGE, *EXTRA_ARMS[2:])),
)  # stem, part of the result, unit, duration of the push [s], curves
INWARD = (45.0, 135.0)  # towards the stance foot: psi in this range [deg]


def scan_job(variant: Variant, psi_deg: float, duration: float = PUSH_TIME, vx: float = 0.0) -> ScanJob:
    """Scan of one direction to 1 N."""
    return ScanJob(variant, PushKind(psi_deg, duration, vx), GRIDS_JERK if variant.jerk_form else GRIDS)


def jobs(directions: int) -> Iterable[Job]:
    """All scans of the section."""
    angles = directions_deg(directions)
    pushed = [scan_job(variant, psi) for variant in (*ARMS, *EXTRA_ARMS) for psi in angles]
    return [*pushed, *(scan_job(variant, psi, JUMP) for variant in JUMP_ARMS for psi in angles)]


def summary(rows: Rows, directions: int) -> dict[str, Any]:
    """The contract's `scenario_2`, the same for a velocity jump, and both in short."""
    angles = directions_deg(directions)
    pushed = {variant.label: _entries(rows, variant, angles, PUSH_TIME) for variant in (*ARMS, *EXTRA_ARMS)}
    jumped = {variant.label: _entries(rows, variant, angles, JUMP) for variant in JUMP_ARMS}
    return {
        "scenario_2": pushed,
        "scenario_2_overview": overview(pushed, "N"),
        "scenario_2_holes": _holes(rows, angles),
        "jump": jumped,
        "jump_overview": overview(jumped, "Ns"),
    }


def limit_curves(directions: int, duration: float = PUSH_TIME) -> dict[str, list[tuple[float, float]]]:
    """Closed-form limits by direction: label -> (psi [deg], strength)."""
    return {
        label: [
            (psi, PushKind(psi, duration).limit(TWO_STAGE, **options)) for psi in directions_deg(directions)
        ]
        for label, options in LIMITS.items()
    }


def overview(section: dict[str, list[dict[str, Any]]], unit: str) -> dict[str, dict[str, float]]:
    """Share of the limit in the mean and in the worst direction, and the least ratio to `stage-1`, by arm."""
    largest, limit = STRENGTH[unit], f"limit_{unit}"
    base = {entry["psi_deg"]: entry[largest] for entry in section["stage-1"]}
    found = {}
    for arm, entries in section.items():
        shares = [entry[largest] / entry[limit] for entry in entries]
        ratio = {e["psi_deg"]: e[largest] / base[e["psi_deg"]] for e in entries if base[e["psi_deg"]] > 0}
        inward = [r for psi, r in ratio.items() if INWARD[0] <= psi <= INWARD[1]]
        found[arm] = {
            "fraction_mean": sum(shares) / len(shares),
            "fraction_worst": min(shares),
            "worst_psi_deg": entries[shares.index(min(shares))]["psi_deg"],
            "ratio_to_stage_1_min": min(ratio.values(), default=0.0),
            "ratio_to_stage_1_min_inward": min(inward, default=0.0),
        }
    return found


def _entries(rows: Rows, variant: Variant, angles: Sequence[float], duration: float) -> list[dict[str, Any]]:
    unit, entries = "N" if duration > 0 else "Ns", []
    for psi in angles:
        job = scan_job(variant, psi, duration)
        found, limit = rows[key(job)]["survived"], job.push.limit(variant)
        entries.append({"psi_deg": psi, STRENGTH[unit]: found, f"limit_{unit}": limit})
    return entries


def _holes(rows: Rows, angles: Sequence[float]) -> list[dict[str, Any]]:
    """Where a larger force than the first that fails is survived."""
    found = []
    for variant, psi in product((*ARMS, *EXTRA_ARMS), angles):
        row = rows[key(scan_job(variant, psi))]
        if row["largest_survived"] > row["survived"]:
            about = {"max_force_N": row["survived"], "largest_survived_N": row["largest_survived"]}
            found.append({"arm": variant.label, "psi_deg": psi, **about})
    return found


def tables(content: dict[str, Any]) -> list[Table]:
    """Every arm by direction, and in short; pushes, then jumps."""
    found = []
    for name, unit, what in (("scenario_2", "N", "push of 0.1 s"), ("jump", "Ns", "velocity jump")):
        section, text = content[name], unit.replace("Ns", "N s")
        columns = ("psi [deg]", f"limit F* [{text}]", *section)
        digits = 0 if unit == "N" else 1
        cells = [
            (f"{entries[0]['psi_deg']:g}", f"{entries[0][f'limit_{unit}']:.{digits}f}",
             *(f"{entry[STRENGTH[unit]]:.{digits}f}" for entry in entries))
            for entries in zip(*section.values(), strict=True)
        ]  # fmt: skip
        found.append(Table(f"Scenario 2: largest {what} [{text}] in place", columns, cells))
        columns = ("arm", "share of F*, mean", "worst", "at psi [deg]", "least ratio to stage-1", "inward")
        cells = [
            (arm, f"{o['fraction_mean']:.3f}", f"{o['fraction_worst']:.3f}", f"{o['worst_psi_deg']:g}",
             f"{o['ratio_to_stage_1_min']:.2f}", f"{o['ratio_to_stage_1_min_inward']:.2f}")
            for arm, o in content[f"{name}_overview"].items()
        ]  # fmt: skip
        found.append(Table(f"Scenario 2 in short: {what}", columns, cells))
    return found


def draw(content: dict[str, Any], directory: Path) -> list[Path]:
    """Fig. 7; what belongs to `two-stage` taken away; and both sets for a velocity jump."""
    from . import figures as figure_polar

    paths = []
    for stem, name, unit, duration, variants in PICTURES:
        curves = {
            variant.label: [
                (entry["psi_deg"], entry[STRENGTH[unit]]) for entry in content[name][variant.label]
            ]
            for variant in variants
            if variant.label in content[name]
        }
        what = "push of 0.1 s" if duration else "velocity jump"
        title = f"Largest recoverable {what} at the start of a left stance, stepping in place"
        limits = limit_curves(LIMIT_DIRECTIONS, duration)
        paths += figure_polar.draw_limits(curves, limits, directory, stem, title, unit.replace("Ns", "N s"))
    return paths
