"""Scenario 1 (Figs. 3-5): 0.5 m/s, a push to the right for 0.1 s at 2.6 s, the start of the fifth step.

The paper leaves the foot, l_p, the control period and the sampling time of stage 2 open; how much they decide
is measured by varying each alone, and both cases at 315 N over all of them together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from .jobs import Job, Row, Rows, Table, key
from .pendulum import EpisodeJob, PushKind, Variant, pairs
from .recording import CaseJob, record
from .scenario_2 import ARMS, LIMITS, TWO_STAGE, scan_job

NAME = "scenario-1"
PSI, VX, FORCE = -90.0, 0.5, 315.0  # [deg], [m/s], [N]
PUSH = PushKind(PSI, vx=VX)
FEET = ((0.16, 0.08), (0.20, 0.10), (0.23, 0.115), (0.26, 0.13))  # length, width [m]
PELVES = (0.15, 0.20, 0.25, 0.30)  # l_p [m]
PERIODS = (0.002, 0.005, 0.01, 0.02)  # [s]
SAMPLINGS = (0.03, 0.05, 0.07, 0.1)  # [s]
JERK_COSTS = ("repaired", "literal")
VARIED_ARMS = ("stage-1-paper", "stage-1", "two-stage-paper", "two-stage")
CASES = ("stage-1-paper", "two-stage-paper")  # (a), (b)
BETA_3 = (1.0, 0.1, 0.01, 0.001)  # weight of the trunk's jerk, whose unit the text leaves open
SWAYING = tuple(
    (value, Variant(f"two-stage-paper, beta_3 {value:g}", "two-stage-paper", pairs({"beta_trunk": value})))
    for value in BETA_3
)
DRAWN = {"": CASES, "scaled-weights": ("stage-1", "two-stage")}  # folder -> cases (a) and (b) of the figures


def free_variants(arm: str) -> Iterator[tuple[str, str, Variant]]:
    """Parameter, value and variant: each open parameter alone."""
    base = Variant(arm, arm)
    for length, width in FEET:
        robot = pairs({"foot_length": length, "foot_width": width})
        yield "foot [m]", f"{length:g} x {width:g}", replace(base, robot=robot)
    for pelvis in PELVES:
        yield "l_p [m]", f"{pelvis:g}", replace(base, robot=pairs({"pelvis_width": pelvis}))
    for period in PERIODS:
        yield "control period [ms]", f"{1e3 * period:g}", replace(base, control_hz=1.0 / period)
    if arm.startswith("two-stage"):
        for sampling in SAMPLINGS:
            planner = pairs({"sampling_time": sampling})
            yield "sampling time [ms]", f"{1e3 * sampling:g}", replace(base, planner=planner)
    if arm == "two-stage-paper":
        for cost in JERK_COSTS:
            yield "jerk cost", cost, replace(base, planner=pairs({"jerk_cost": cost}))


def together(arm: str) -> Iterator[tuple[dict[str, Any], Variant]]:
    """All open parameters at once: what they are, and the variant; short periods left out for their cost."""
    stage_2 = arm == "two-stage-paper"
    choices = product(FEET, PELVES, PERIODS[2:], SAMPLINGS if stage_2 else (0.05,), JERK_COSTS[: 1 + stage_2])
    for (length, width), pelvis, period, sampling, cost in choices:
        about = {"foot_length": length, "foot_width": width, "pelvis_width": pelvis, "control_period": period}
        stage = {"sampling_time": sampling, "jerk_cost": cost} if stage_2 else {}
        robot = {name: about[name] for name in ("foot_length", "foot_width", "pelvis_width")}
        yield {**about, **stage}, Variant(arm, arm, pairs(stage), pairs(robot), 1.0 / period)


def jobs(directions: int) -> Iterable[Job]:
    """Scans and single pushes of the section; `directions` does not matter here."""
    for arm in ARMS:
        yield scan_job(arm, PSI, vx=VX)
        yield EpisodeJob(arm, PUSH, FORCE)
    for arm in VARIED_ARMS:
        for _, _, variant in free_variants(arm):
            yield scan_job(variant, PSI, vx=VX)
            yield EpisodeJob(variant, PUSH, FORCE)
    for arm in CASES:
        for _, variant in together(arm):
            yield EpisodeJob(variant, PUSH, FORCE)
    for arm in ARMS:
        yield CaseJob(arm, PUSH, FORCE)
    for _, variant in SWAYING:
        yield scan_job(variant, PSI, vx=VX)
        yield CaseJob(variant, PUSH, FORCE)


def summary(rows: Rows, directions: int) -> dict[str, Any]:
    """The contract's `scenario_1`, and what the open parameters make of it."""
    arms = {arm.label: _entry(rows, arm) for arm in ARMS}
    return {
        "scenario_1": arms,
        "scenario_1_limits_N": {label: PUSH.limit(TWO_STAGE, **options) for label, options in LIMITS.items()},
        "scenario_1_interval": {arm: _interval(rows, arm) for arm in VARIED_ARMS},
        "scenario_1_together": {arm: _together(rows, arm) for arm in CASES},
        "scenario_1_cases": {arm.label: _case(rows, arm) for arm in ARMS},
        "scenario_1_sway": [
            {"beta_3": value, "max_force_N": rows[key(scan_job(variant, PSI, vx=VX))]["survived"],
             **_case(rows, variant)}
            for value, variant in SWAYING
        ],
    }  # fmt: skip


def _case(rows: Rows, variant: Variant) -> Row:
    """What `case_numbers` found, without what identifies the row."""
    job = CaseJob(variant, PUSH, FORCE)
    about = {"key", "label", *job.identity()}
    return {name: value for name, value in rows[key(job)].items() if name not in about}


def _entry(rows: Rows, variant: Variant) -> Row:
    return {
        "recovers_315_N": rows[key(EpisodeJob(variant, PUSH, FORCE))]["recovered"],
        "max_force_N": rows[key(scan_job(variant, PSI, vx=VX))]["survived"],
    }


def _interval(rows: Rows, arm: str) -> Row:
    """Each open parameter alone, and the range of the largest force over all of these."""
    cases = []
    for parameter, value, variant in free_variants(arm):
        found = _entry(rows, variant)
        limit, point = PUSH.limit(variant), PUSH.limit(variant, foot=False, flywheel=False)
        cases.append(
            {"parameter": parameter, "value": value, **found, "limit_N": limit, "point_foot_limit_N": point}
        )
    forces = [case["max_force_N"] for case in cases]
    return {"max_force_N": [min(forces), max(forces)], "cases": cases}


def _together(rows: Rows, arm: str) -> Row:
    """How many of all combinations survive and recover from 315 N, by jerk cost, and which do not recover."""
    found: dict[str, Row] = {}
    names = ("foot_length", "foot_width", "pelvis_width", "control_period", "sampling_time")
    for about, variant in together(arm):
        row = rows[key(EpisodeJob(variant, PUSH, FORCE))]
        group = found.setdefault(
            about.get("jerk_cost", "none"),
            {"combinations": 0, "survived": 0, "recovered": 0, "parameters": names, "does_not_recover": []},
        )
        group["combinations"] += 1
        group["survived"] += row["survived"]
        group["recovered"] += row["recovered"]
        if not row["recovered"]:
            group["does_not_recover"].append([about[name] for name in names if name in about])
    return found


def tables(content: dict[str, Any]) -> list[Table]:
    """Arms; then the open parameters."""
    arms = [
        (arm, "yes" if entry["recovers_315_N"] else "no", f"{entry['max_force_N']:.0f}")
        for arm, entry in content["scenario_1"].items()
    ]
    limits = [
        (f"limit: {name}", "", f"{value:.1f}") for name, value in content["scenario_1_limits_N"].items()
    ]
    title = "Scenario 1: 0.5 m/s, pushed to the right for 0.1 s at 2.6 s"
    found = [Table(title, ("arm", "recovers from 315 N", "largest force [N]"), [*arms, *limits])]
    for arm, interval in content["scenario_1_interval"].items():
        low, high = interval["max_force_N"]
        cells = [
            (case["parameter"], case["value"], "yes" if case["recovers_315_N"] else "no",
             f"{case['max_force_N']:.0f}", f"{case['point_foot_limit_N']:.0f}", f"{case['limit_N']:.0f}")
            for case in interval["cases"]
        ]  # fmt: skip
        columns = ("open parameter", "value", "recovers from 315 N", "largest force [N]", "point foot [N]",
                   "F* of this robot [N]")  # fmt: skip
        found.append(
            Table(f"{arm}: {low:.0f} to {high:.0f} N over what the paper leaves open", columns, cells)
        )
    cells = [
        (arm, cost, *(str(group[name]) for name in ("combinations", "survived", "recovered")))
        for arm, groups in content["scenario_1_together"].items()
        for cost, group in groups.items()
    ]
    columns = ("arm", "jerk cost", "combinations", "survive 315 N", "recover")
    found.append(Table("Foot, l_p, control period and sampling time varied together", columns, cells))
    cells = [
        (f"{case['beta_3']:g}", f"{case['max_force_N']:.0f}",
         *(f"{case[name]:.2f}" for name in ("peak_lean_within_1_s", "peak_lean", "final_lean")))
        for case in content["scenario_1_sway"]
    ]  # fmt: skip
    columns = ("beta_3 [s^6/rad^2]", "largest force [N]", "peak lean within 1 s [rad]", "peak lean [rad]",
               "lean after 4 s [rad]")  # fmt: skip
    return [*found, Table("two-stage-paper: sway of the trunk at 315 N", columns, cells)]


def draw(content: dict[str, Any], directory: Path) -> list[Path]:
    """Figs. 3, 4 and 5 of cases (a) and (b) and the animation: the paper's weights, then the scaled ones."""
    from . import cartoon as animation
    from . import cartoon as figure_cartoon
    from . import figures as figure_histories
    from . import figures as figure_paths

    paths = []
    for folder, cases in DRAWN.items():
        into = directory / folder
        into.mkdir(parents=True, exist_ok=True)
        records = [record(arm, PUSH, FORCE) for name in cases for arm in ARMS if arm.label == name]
        for module in (figure_paths, figure_histories, figure_cartoon):
            paths += module.draw(records, into)
        paths.append(animation.save(records, into))
    return paths
