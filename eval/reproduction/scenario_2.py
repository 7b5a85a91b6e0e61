"""Scenario 2 (Fig. 7): the largest push by direction, every arm against the closed-form limits, in place.

The same for a velocity jump, where knowing of a push early is worth nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..frontier import directions_deg
from .jobs import Rows, key
from .scan import PushKind, ScanJob
from .variants import Variant, pairs

ARMS = (
    Variant("stage-1-paper", "stage-1-paper"),
    Variant("stage-1", "stage-1"),
    Variant("stage-1+cop", "stage-1+cop"),
    Variant("stage-1+momentum", "stage-1+momentum"),
    Variant("two-stage-paper", "two-stage-paper"),
    Variant("two-stage", "two-stage"),
)
EXTRA_ARMS = (
    Variant("two-stage, no push estimate", "two-stage", pairs({"push_carry": 0.0})),
    Variant("two-stage, no trunk debt", "two-stage", pairs({"trunk_debt": False})),
    Variant("two-stage, plain DCM", "two-stage", pairs({"push_carry": 0.0, "trunk_debt": False})),
)  # what belongs to `two-stage` taken away, or added to it
JUMP_ARMS = (ARMS[1], ARMS[5], *EXTRA_ARMS)

LIMITS = {
    "point foot": {"foot": False, "flywheel": False},
    "+ foot": {"foot": True, "flywheel": False},
    "+ flywheel": {"foot": False, "flywheel": True},
    "F*": {"foot": True, "flywheel": True},
}  # label -> options of the closed form
JUMP = 0.0  # duration of a velocity jump [s]
GRIDS = (5.0, 1.0)  # [N]
GRIDS_JERK = (20.0, 5.0, 1.0)  # the paper's form costs ten times as much
INWARD = (45.0, 135.0)  # towards the stance foot: psi in this range [deg]


def scan_job(variant: Variant, psi_deg: float, duration: float = 0.1, vx: float = 0.0) -> ScanJob:
    """Scan of one direction to 1 N."""
    return ScanJob(variant, PushKind(psi_deg, duration, vx), GRIDS_JERK if variant.jerk_form else GRIDS)


def jobs(directions: int) -> list[ScanJob]:
    """All scans of the section."""
    angles = directions_deg(directions)
    pushed = [scan_job(variant, psi) for variant in (*ARMS, *EXTRA_ARMS) for psi in angles]
    return [*pushed, *(scan_job(variant, psi, JUMP) for variant in JUMP_ARMS for psi in angles)]


def summary(rows: Rows, directions: int) -> dict[str, list[dict[str, Any]]]:
    """The contract's object: by arm one entry a direction."""
    angles = directions_deg(directions)
    return {variant.label: _entries(rows, variant, angles, 0.1) for variant in (*ARMS, *EXTRA_ARMS)}


def jump_summary(rows: Rows, directions: int) -> dict[str, list[dict[str, Any]]]:
    """The same for a velocity jump."""
    angles = directions_deg(directions)
    return {variant.label: _entries(rows, variant, angles, JUMP) for variant in JUMP_ARMS}


def limit_curves(directions: int, duration: float = 0.1) -> dict[str, list[tuple[float, float]]]:
    """Closed-form limits by direction: label -> (psi [deg], strength)."""
    return {
        label: [
            (psi, PushKind(psi, duration).limit(ARMS[5], **options)) for psi in directions_deg(directions)
        ]
        for label, options in LIMITS.items()
    }


def overview(section: dict[str, list[dict[str, Any]]]) -> dict[str, dict[str, float]]:
    """Share of the limit in the mean and in the worst direction, and the least ratio to `stage-1`, by arm."""
    found = {}
    base = {entry["psi_deg"]: entry[_strength(entry)] for entry in section["stage-1"]}
    for arm, entries in section.items():
        shares = [entry["fraction"] for entry in entries]
        ratio = {
            e["psi_deg"]: e[_strength(e)] / base[e["psi_deg"]] for e in entries if base[e["psi_deg"]] > 0
        }
        inward = [r for psi, r in ratio.items() if INWARD[0] <= psi <= INWARD[1]]
        found[arm] = {
            "fraction_mean": sum(shares) / len(shares),
            "fraction_worst": min(shares),
            "worst_psi_deg": entries[shares.index(min(shares))]["psi_deg"],
            "ratio_to_stage_1_min": min(ratio.values(), default=0.0),
            "ratio_to_stage_1_min_inward": min(inward, default=0.0),
        }
    return found


def _strength(entry: dict[str, Any]) -> str:
    return "max_force_N" if "max_force_N" in entry else "max_impulse_Ns"


def _entries(rows: Rows, variant: Variant, angles: Sequence[float], duration: float) -> list[dict[str, Any]]:
    push_unit = "force_N" if duration > 0 else "impulse_Ns"
    entries = []
    for psi in angles:
        job = scan_job(variant, psi, duration)
        row, limit = rows[key(job)], job.push.limit(variant)
        entries.append(
            {
                "psi_deg": psi,
                f"max_{push_unit}": row["survived"],
                "limit_N" if duration > 0 else "limit_Ns": limit,
                "fraction": row["survived"] / limit,
                f"largest_survived_{push_unit}": row["largest_survived"],
            }
        )
    return entries
