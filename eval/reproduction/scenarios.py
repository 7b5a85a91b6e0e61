"""The paper's two scenarios: one push with the parameters that it leaves open, and the largest by direction.

Scenario 1 (Figs. 3-5): 0.5 m/s, a push to the right for 0.1 s at 2.6 s, the start of the fifth step. The
paper leaves the foot, l_p, the control period and the sampling time of stage 2 open; how much they decide is
measured by varying each alone, and both cases at 315 N over all of them together.

Scenario 2 (Fig. 7): the largest push by direction, every variant against the closed-form limits, in place.
The same for a velocity jump, where knowing of a push early is worth nothing.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from ..output.tables import Table
from ..score.threshold import directions_deg
from .jobs import CaseJob, EpisodeJob, Job, Row, Rows, ScanJob, Section, key
from .pendulum import PUSH_TIME, PushKind, Variant, pairs, record

TWO_STAGE, STAGE_1 = Variant("two-stage", "two-stage"), Variant("stage-1", "stage-1")
VARIANTS = (
    Variant("stage-1-paper", "stage-1-paper"),
    STAGE_1,
    Variant("stage-1+cop", "stage-1+cop"),
    Variant("stage-1+momentum", "stage-1+momentum"),
    Variant("two-stage-paper", "two-stage-paper"),
    TWO_STAGE,
)
EXTRA_VARIANTS = (
    Variant("two-stage+double-support", "two-stage", preset="double-support"),
    Variant("two-stage, no push estimate", "two-stage", pairs({"push_carry": 0.0})),
    Variant("two-stage, no trunk debt", "two-stage", pairs({"trunk_debt": False})),
    Variant("two-stage, plain DCM", "two-stage", pairs({"push_carry": 0.0, "trunk_debt": False})),
)  # what belongs to `two-stage` taken away, or added to it
JUMP_VARIANTS = (STAGE_1, TWO_STAGE, *EXTRA_VARIANTS)
LIMITS = {
    "point foot": {"foot": False, "flywheel": False},
    "+ foot": {"foot": True, "flywheel": False},
    "+ flywheel": {"foot": False, "flywheel": True},
    "F*": {"foot": True, "flywheel": True},
}  # label -> options of the closed form
JUMP = 0.0  # duration of a velocity jump [s]
GRIDS = (5.0, 1.0)  # [N]
GRIDS_JERK = (20.0, 5.0, 1.0)  # the paper's form costs ten times as much

PSI, VX, FORCE = -90.0, 0.5, 315.0  # of scenario 1 [deg], [m/s], [N]
PUSH = PushKind(PSI, vx=VX)
FEET = ((0.16, 0.08), (0.20, 0.10), (0.23, 0.115), (0.26, 0.13))  # length, width [m]
PELVES = (0.15, 0.20, 0.25, 0.30)  # l_p [m]
PERIODS = (0.002, 0.005, 0.01, 0.02)  # [s]
SAMPLINGS = (0.03, 0.05, 0.07, 0.1)  # [s]
JERK_COSTS = ("repaired", "literal")
VARIED = ("stage-1-paper", "stage-1", "two-stage-paper", "two-stage")
CASES = ("stage-1-paper", "two-stage-paper")  # (a), (b)
BETA_3 = (1.0, 0.1, 0.01, 0.001)  # weight of the trunk's jerk, whose unit the text leaves open
SWAYING = tuple(
    (value, Variant(f"two-stage-paper, beta_3 {value:g}", "two-stage-paper", pairs({"beta_trunk": value})))
    for value in BETA_3
)
DRAWN = {"": CASES, "scaled-weights": ("stage-1", "two-stage")}  # folder -> cases (a) and (b) of the figures


def scan_job(variant: Variant, psi_deg: float, duration: float = PUSH_TIME, vx: float = 0.0) -> ScanJob:
    """Scan of one direction to 1 N."""
    return ScanJob(variant, PushKind(psi_deg, duration, vx), GRIDS_JERK if variant.jerk_form else GRIDS)


def free_variants(policy: str) -> Iterator[tuple[str, str, Variant]]:
    """Parameter, value and variant: each open parameter alone."""
    base = Variant(policy, policy)
    for length, width in FEET:
        robot = pairs({"foot_length": length, "foot_width": width})
        yield "foot [m]", f"{length:g} x {width:g}", replace(base, robot=robot)
    for pelvis in PELVES:
        yield "l_p [m]", f"{pelvis:g}", replace(base, robot=pairs({"pelvis_width": pelvis}))
    for period in PERIODS:
        yield "control period [ms]", f"{1e3 * period:g}", replace(base, control_hz=1.0 / period)
    if policy.startswith("two-stage"):
        for sampling in SAMPLINGS:
            planner = pairs({"sampling_time": sampling})
            yield "sampling time [ms]", f"{1e3 * sampling:g}", replace(base, planner=planner)
    if policy == "two-stage-paper":
        for cost in JERK_COSTS:
            yield "jerk cost", cost, replace(base, planner=pairs({"jerk_cost": cost}))


def together(policy: str) -> Iterator[tuple[Row, Variant]]:
    """All open parameters at once: their values, and the variant; short periods left out for their cost."""
    stage_2 = policy == "two-stage-paper"
    choices = product(FEET, PELVES, PERIODS[2:], SAMPLINGS if stage_2 else (0.05,), JERK_COSTS[: 1 + stage_2])
    for (length, width), pelvis, period, sampling, cost in choices:
        robot = {"foot_length": length, "foot_width": width, "pelvis_width": pelvis}
        stage = {"sampling_time": sampling, "jerk_cost": cost} if stage_2 else {}
        variant = Variant(policy, policy, pairs(stage), pairs(robot), 1.0 / period)
        yield {**robot, "control_period": period, **stage}, variant


def jobs_1(directions: int) -> Iterable[Job]:
    """Scans and single pushes of scenario 1; `directions` does not matter here."""
    varied = [variant for policy in VARIED for _, _, variant in free_variants(policy)]
    for variant in (*VARIANTS, *varied):
        yield scan_job(variant, PSI, vx=VX)
        yield EpisodeJob(variant, PUSH, FORCE)
    for policy in CASES:
        for _, variant in together(policy):
            yield EpisodeJob(variant, PUSH, FORCE)
    for variant in VARIANTS:
        yield CaseJob(variant, PUSH, FORCE)
    for _, variant in SWAYING:
        yield scan_job(variant, PSI, vx=VX)
        yield CaseJob(variant, PUSH, FORCE)


def summary_1(rows: Rows, directions: int) -> Row:
    """The contract's `scenario_1`, and how far the open parameters decide it."""
    limits = {label: PUSH.limit(TWO_STAGE, **options) for label, options in LIMITS.items()}
    sway = [
        {"beta_3": value, "max_force_N": _largest_force(rows, variant), **_case(rows, variant)}
        for value, variant in SWAYING
    ]
    return {
        "scenario_1": {variant.label: _entry(rows, variant) for variant in VARIANTS},
        "scenario_1_limits_N": limits,
        "scenario_1_interval": {policy: _interval(rows, policy) for policy in VARIED},
        "scenario_1_together": {policy: _together(rows, policy) for policy in CASES},
        "scenario_1_cases": {variant.label: _case(rows, variant) for variant in VARIANTS},
        "scenario_1_sway": sway,
    }


def _case(rows: Rows, variant: Variant) -> Row:
    """Result of `case_numbers`, without what identifies the row."""
    job = CaseJob(variant, PUSH, FORCE)
    about = {"key", "label", *job.identity()}
    return {name: value for name, value in rows[key(job)].items() if name not in about}


def _largest_force(rows: Rows, variant: Variant) -> float:
    return rows[key(scan_job(variant, PSI, vx=VX))]["survived"]


def _entry(rows: Rows, variant: Variant) -> Row:
    recovers = rows[key(EpisodeJob(variant, PUSH, FORCE))]["recovered"]
    return {"recovers_315_N": recovers, "max_force_N": _largest_force(rows, variant)}


def _interval(rows: Rows, policy: str) -> Row:
    """Each open parameter alone, and the range of the largest force over all of these."""
    cases = []
    for parameter, value, variant in free_variants(policy):
        limit, point = PUSH.limit(variant), PUSH.limit(variant, foot=False, flywheel=False)
        about = {"parameter": parameter, "value": value, **_entry(rows, variant)}
        cases.append({**about, "limit_N": limit, "point_foot_limit_N": point})
    forces = [case["max_force_N"] for case in cases]
    return {"max_force_N": [min(forces), max(forces)], "cases": cases}


def _together(rows: Rows, policy: str) -> Row:
    """Counts of combinations that survive and recover from 315 N by jerk cost, and those that do not."""
    groups: dict[str, Row] = {}
    names = ("foot_length", "foot_width", "pelvis_width", "control_period", "sampling_time")
    for about, variant in together(policy):
        row = rows[key(EpisodeJob(variant, PUSH, FORCE))]
        group = groups.setdefault(
            about.get("jerk_cost", "none"),
            {"combinations": 0, "survived": 0, "recovered": 0, "parameters": names, "does_not_recover": []},
        )
        group["combinations"] += 1
        group["survived"] += row["survived"]
        group["recovered"] += row["recovered"]
        if not row["recovered"]:
            group["does_not_recover"].append([about[name] for name in names if name in about])
    return groups


def tables_1(content: Row) -> list[Table]:
    """Variants; then the open parameters."""

    def recovers(entry: Row) -> tuple[str, str]:
        return "yes" if entry["recovers_315_N"] else "no", f"{entry['max_force_N']:.0f}"

    cells = [(name, *recovers(entry)) for name, entry in content["scenario_1"].items()]
    cells += [
        (f"limit: {name}", "", f"{value:.1f}") for name, value in content["scenario_1_limits_N"].items()
    ]
    title = "Scenario 1: 0.5 m/s, pushed to the right for 0.1 s at 2.6 s"
    found = [Table(title, ("variant", "recovers from 315 N", "largest force [N]"), cells)]
    columns = ("open parameter", "value", "recovers from 315 N", "largest force [N]", "point foot [N]",
               "F* of this robot [N]")  # fmt: skip
    for policy, interval in content["scenario_1_interval"].items():
        low, high = interval["max_force_N"]
        cells = [
            (case["parameter"], case["value"], *recovers(case),
             f"{case['point_foot_limit_N']:.0f}", f"{case['limit_N']:.0f}")
            for case in interval["cases"]
        ]  # fmt: skip
        title = f"{policy}: {low:.0f} to {high:.0f} N over what the paper leaves open"
        found.append(Table(title, columns, cells))
    cells = [
        (policy, cost, *(str(group[name]) for name in ("combinations", "survived", "recovered")))
        for policy, groups in content["scenario_1_together"].items()
        for cost, group in groups.items()
    ]
    columns = ("variant", "jerk cost", "combinations", "survive 315 N", "recover")
    found.append(Table("Foot, l_p, control period and sampling time varied together", columns, cells))
    leans = ("peak_lean_within_1_s", "peak_lean", "final_lean")
    cells = [
        (f"{case['beta_3']:g}", f"{case['max_force_N']:.0f}", *(f"{case[name]:.2f}" for name in leans))
        for case in content["scenario_1_sway"]
    ]
    columns = ("beta_3 [s^6/rad^2]", "largest force [N]", "peak lean within 1 s [rad]", "peak lean [rad]",
               "lean after 4 s [rad]")  # fmt: skip
    return [*found, Table("two-stage-paper: sway of the trunk at 315 N", columns, cells)]


def draw_1(content: Row, directory: Path) -> list[Path]:
    """Figs. 3, 4 and 5 of cases (a) and (b) and the animation: the paper's weights, then the scaled ones."""
    from . import figures

    paths = []
    for folder, cases in DRAWN.items():
        (directory / folder).mkdir(parents=True, exist_ok=True)
        walks = [record(Variant(name, name), PUSH, FORCE) for name in cases]
        paths += figures.draw_scenario_1(walks, directory / folder)
    return paths


LIMIT_DIRECTIONS = 180  # of the limits' curves
STRENGTH = {"N": "max_force_N", "Ns": "max_impulse_Ns"}  # field by unit
PICTURES = (
    ("fig7_limits", "scenario_2", "N", PUSH_TIME, (*VARIANTS, EXTRA_VARIANTS[0])),
    ("fig7_variants", "scenario_2", "N", PUSH_TIME, (TWO_STAGE, *EXTRA_VARIANTS[1:])),
    ("fig7_jump", "jump", "Ns", JUMP, (STAGE_1, TWO_STAGE, *EXTRA_VARIANTS[2:])),
)  # stem, part of the result, unit, duration of the push [s], curves
INWARD = (45.0, 135.0)  # towards the stance foot: psi in this range [deg]


def jobs_2(directions: int) -> Iterable[Job]:
    """All scans of scenario 2."""
    angles = directions_deg(directions)
    pushed = [scan_job(variant, psi) for variant in (*VARIANTS, *EXTRA_VARIANTS) for psi in angles]
    return [*pushed, *(scan_job(variant, psi, JUMP) for variant in JUMP_VARIANTS for psi in angles)]


def summary_2(rows: Rows, directions: int) -> Row:
    """The contract's `scenario_2`, the same for a velocity jump, and both in short."""
    angles, variants = directions_deg(directions), (*VARIANTS, *EXTRA_VARIANTS)
    pushed = {variant.label: _entries(rows, variant, angles, PUSH_TIME) for variant in variants}
    jumped = {variant.label: _entries(rows, variant, angles, JUMP) for variant in JUMP_VARIANTS}
    holes = []  # where a larger force than the first that fails is survived
    for variant, psi in product(variants, angles):
        row = rows[key(scan_job(variant, psi))]
        if row["largest_survived"] > row["survived"]:
            about = {"max_force_N": row["survived"], "largest_survived_N": row["largest_survived"]}
            holes.append({"arm": variant.label, "psi_deg": psi, **about})
    return {
        "scenario_2": pushed,
        "scenario_2_overview": overview(pushed, "N"),
        "scenario_2_holes": holes,
        "jump": jumped,
        "jump_overview": overview(jumped, "Ns"),
    }


def _entries(rows: Rows, variant: Variant, angles: Sequence[float], duration: float) -> list[Row]:
    unit, entries = "N" if duration > 0 else "Ns", []
    for psi in angles:
        job = scan_job(variant, psi, duration)
        largest, limit = rows[key(job)]["survived"], job.push.limit(variant)
        entries.append({"psi_deg": psi, STRENGTH[unit]: largest, f"limit_{unit}": limit})
    return entries


def overview(section: dict[str, list[Row]], unit: str) -> dict[str, Row]:
    """Mean and least share of the limit, and the least ratio to `stage-1`, by variant."""
    largest, limit = STRENGTH[unit], f"limit_{unit}"
    base = {entry["psi_deg"]: entry[largest] for entry in section["stage-1"]}
    found = {}
    for label, entries in section.items():
        shares = [entry[largest] / entry[limit] for entry in entries]
        ratio = {e["psi_deg"]: e[largest] / base[e["psi_deg"]] for e in entries if base[e["psi_deg"]] > 0}
        inward = [r for psi, r in ratio.items() if INWARD[0] <= psi <= INWARD[1]]
        found[label] = {
            "fraction_mean": sum(shares) / len(shares),
            "fraction_worst": min(shares),
            "worst_psi_deg": entries[shares.index(min(shares))]["psi_deg"],
            "ratio_to_stage_1_min": min(ratio.values(), default=0.0),
            "ratio_to_stage_1_min_inward": min(inward, default=0.0),
        }
    return found


def tables_2(content: Row) -> list[Table]:
    """Every variant by direction, and in short; pushes, then jumps."""
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
        columns = ("variant", "share of F*, mean", "worst", "at psi [deg]", "least ratio to stage-1",
                   "inward")  # fmt: skip
        cells = [
            (label, f"{o['fraction_mean']:.3f}", f"{o['fraction_worst']:.3f}", f"{o['worst_psi_deg']:g}",
             f"{o['ratio_to_stage_1_min']:.2f}", f"{o['ratio_to_stage_1_min_inward']:.2f}")
            for label, o in content[f"{name}_overview"].items()
        ]  # fmt: skip
        found.append(Table(f"Scenario 2 in short: {what}", columns, cells))
    return found


def draw_2(content: Row, directory: Path) -> list[Path]:
    """Fig. 7; what belongs to `two-stage` taken away; and both sets for a velocity jump."""
    from . import figures

    paths, angles = [], directions_deg(LIMIT_DIRECTIONS)
    for stem, name, unit, duration, variants in PICTURES:
        section = content[name]
        curves = {
            variant.label: [(entry["psi_deg"], entry[STRENGTH[unit]]) for entry in section[variant.label]]
            for variant in variants
            if variant.label in section
        }
        limits = {
            label: [(psi, PushKind(psi, duration).limit(TWO_STAGE, **options)) for psi in angles]
            for label, options in LIMITS.items()
        }
        what = "push of 0.1 s" if duration else "velocity jump"
        title = f"Largest recoverable {what} at the start of a left stance, stepping in place"
        paths += figures.draw_limits(curves, limits, directory, stem, title, unit.replace("Ns", "N s"))
    return paths


SCENARIO_1 = Section("scenario-1", jobs_1, summary_1, tables_1, draw_1)
SCENARIO_2 = Section("scenario-2", jobs_2, summary_2, tables_2, draw_2)
