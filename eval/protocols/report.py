"""Tables of a protocol: this robot's policies over the published rows, and how the others' robots differ."""

import math
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from ...controllers.model.robot import GRAVITY, Similarity
from ..output.statistics import wilson_interval
from ..output.tables import Table, markdown_page, write_reports
from ..rollout.outcome import driven_joints
from .kick import FORCES, LEVELS, jump_of
from .run import PushProtocol, Results, Row
from .tour import CEILING, FASTEST_X, FASTEST_Y, LENGTH, PUNCH_DURATION, force_share

# RecoverFormer (Unitree G1), share of episodes without a fall [%] by level, paper's Table I of commit 70eabd2
KICK_ROWS: dict[str, dict[int, float]] = {
    "RecoverFormer, open floor, 200 each (published)": {
        50: 100.0, 100: 100.0, 150: 85.0, 200: 79.0, 250: 68.0, 300: 68.0,
    },
    "RecoverFormer, between walls, 100 each (published)": {
        100: 100.0, 150: 100.0, 200: 100.0, 250: 100.0, 300: 100.0,
    },
}  # fmt: skip
KICK_NOTE = (
    "The published rows are of a Unitree G1 (29 joints, arms, 1.27 m, 35 kg, CoM at about 0.69 m) under a "
    "learned policy at 50 Hz that stands still; its program multiplies the friction by a number from 0.5 to "
    "1.2 at every reset, again and again, and its episodes are not seeded. "
)


def kick_note(protocol: PushProtocol) -> str:
    """Differences between their robot and ours."""
    robot, rest = protocol.robot, "stands" if protocol.stands else "steps in place"
    jump = jump_of(FORCES[-1])
    share = jump / math.sqrt(GRAVITY * robot.com_height)
    return (
        f"{KICK_NOTE}This robot weighs {robot.mass:.1f} kg and has its CoM at {robot.com_height:.2f} m; its "
        f"arms, if it has any, are held or the policy's own. It {rest}, on friction 0.9; its planner knows "
        "model and true state, networks of others do not. "
        f"Jump over sqrt(g h): {jump:.3f} m/s is 0.33 on their G1 and {share:.2f} here.\n"
    )


class TourRow(NamedTuple):
    """A row of the benchmark's table; MuJoCo, then PhysX."""

    survival: tuple[float, float]  # mean [s] of 90
    completed: tuple[int, int]  # [%]
    runs: int
    position: tuple[int, int]  # error at the ends of segments [cm]
    heading: tuple[int, int]  # [degrees]


# README of commit 6d331a85: the rows of 5120 runs, and the best three of 512
TOUR_ROWS: dict[str, TourRow] = {
    "gr00t_wbc h066_p012": TourRow((84.9, 82.2), (80, 69), 5120, (16, 49), (7, 8)),
    "gr00t_wbc h066_p000": TourRow((84.7, 81.8), (79, 67), 5120, (17, 57), (8, 9)),
    "decoupled_wbc h066_p012": TourRow((83.9, 80.9), (75, 66), 5120, (10, 20), (7, 6)),
    "decoupled_wbc h066_p000": TourRow((83.9, 81.3), (74, 67), 5120, (10, 22), (7, 5)),
    "gr00t_wbc h070_p000": TourRow((83.3, 82.9), (73, 71), 5120, (14, 21), (5, 6)),
    "decoupled_wbc h070_p000": TourRow((83.1, 80.2), (72, 63), 5120, (10, 15), (7, 6)),
    "decoupled_wbc h074_p000": TourRow((82.3, 80.1), (69, 62), 5120, (11, 14), (8, 7)),
    "gr00t_wbc h074_p000": TourRow((80.1, 80.0), (63, 61), 5120, (13, 16), (5, 6)),
    "homie": TourRow((78.3, 77.4), (55, 52), 5120, (17, 19), (32, 37)),
    "amo": TourRow((75.7, 77.6), (53, 57), 5120, (24, 39), (18, 17)),
    "wbc_agile_velocity": TourRow((75.1, 79.3), (49, 60), 5120, (22, 23), (7, 6)),
    "wbc_agile": TourRow((70.9, 64.3), (33, 18), 512, (23, 41), (8, 11)),
    "sonic": TourRow((68.5, 52.9), (36, 11), 512, (30, 44), (9, 11)),
    "mimic_lite": TourRow((48.1, 59.5), (9, 21), 512, (76, 89), (12, 12)),
}
PUBLISHED_TOURS = (
    "The published rows are of a Unitree G1 (35.1 kg, 29 joints) in MuJoCo Warp at 2 ms; a fall there is a "
    "pelvis below 0.20 m. Its 26 other policies complete 8 % at most. "
)
NONE_PUBLISHED = (
    "In the benchmark's own table the harness moves the arms at random, so its rows stand beside those of "
    "--arms walking alone. "
)
TOUR_NOTE = (
    "A punch of a leg acts at the same joint here, on thigh, shank or foot, one of the waist on the trunk at "
    "the waist, one of an arm on the same link of it; a robot without arms gets those on the trunk, 0.24 m "
    "over the waist and 0.10 m aside. The robot begins in a nominal "
    "step without the three seconds in a crane, turns at 0.6 rad/s at most, and falls by this project's "
    "criterion, which is the stricter one; its planner knows model and true state, networks of others do "
    "not. Errors stand at the ends of the segments that were begun; energy and vibration are not counted. "
)


def as_published(protocol: PushProtocol) -> bool:
    """Whether a tour is the one of the published rows: punches, and arms that the harness moves at random."""
    return protocol.form == "arms walking" and protocol.pushed


ARM_NOTES = {
    "arms held": "The arms are held at the stance of the benchmark's harness, by the policy's own gains.",
    "arms walking": "The arms walk at random, as the benchmark's harness has it, by the policy's own gains.",
}
OWN_ARMS = "The arms are the policy's where it drives all joints, and held otherwise; no harness moves them."


def tour_note(protocol: PushProtocol) -> str:
    """Differences between their robot and ours."""
    robot, rest = protocol.robot, "stands" if protocol.stands else "steps in place"
    theirs = PUBLISHED_TOURS if as_published(protocol) else NONE_PUBLISHED
    share, velocity = force_share(robot), Similarity.of(robot).velocity
    forces = f"up to {CEILING * share:.0f} N for {PUNCH_DURATION} s"
    meets = (
        f"the published forces, {forces}" if share == 1.0 else f"forces scaled by mass, {forces}, 1.14 N s/kg"
    )
    return (
        f"{theirs}{TOUR_NOTE}This robot weighs {robot.mass:.1f} kg and meets {meets}; it walks forward at up "
        f"to {FASTEST_X * velocity:.2f} and aside at {FASTEST_Y * velocity:.2f} m/s, and {rest} at a "
        "waypoint. "
        f"{ARM_NOTES.get(protocol.form, OWN_ARMS)}\n"
    )


FORMS = {
    "stated": "8 directions in turn, horizontal jumps of the velocity, as the paper says",
    "coded": "direction uniform, jumps with a vertical part of -0.1 to 0.2, as the program does",
    "force": "a force on the pelvis for 0.1 s with the impulse of the jump, 8 directions in turn",
}
STOOD = "Share without a fall by RecoverFormer's criterion, % (Wilson, 95 %)"
RATES = {"stood": STOOD, "survived": "Survived by this project's criterion, %", "recovered": "Recovered, %"}
MEANS = {
    "time_to_stable": "Time to a base slower than 0.15 m/s [s], mean",
    "peak_tilt_deg": "Largest tilt of the trunk [degrees], mean",
}
KICK_CRITERION = (
    "By RecoverFormer's criterion an episode of 10 s is lost where the pelvis comes below 0.38 of its "
    "standing height or the trunk leans by more than 1.2 rad. Its time to stable is of little use for a "
    "robot that steps in place, whose base sways.\n"
)


def level_of(row: Row) -> int:
    """The level of a row, by its force on the G1 [N]."""
    return int(row["scenario_id"].split("-")[-2])


def rate_cell(values: Sequence[bool]) -> str:
    """Percentage with its Wilson interval."""
    count, of = sum(values), len(values)
    low, high = wilson_interval(count, of)
    return f"{100 * count / of:.1f} ({100 * low:.1f}-{100 * high:.1f})" if of else "-"


def mean_cell(values: Sequence[float]) -> str:
    """Mean of numbers."""
    return f"{fmean(values):.2f}" if values else "-"


def kick_table(results: Results, key: str, title: str) -> Table:
    """A rate or a mean of each policy, level by level; beside rates of `stood`, the published ones."""
    published, shown = KICK_ROWS if key == "stood" else {}, rate_cell if key in RATES else mean_cell
    cells = []
    for force in LEVELS:
        own = [shown([row[key] for row in rows if level_of(row) == force]) for rows in results.rows.values()]
        theirs = [f"{row[force]:.1f}" if force in row else "-" for row in published.values()]
        cells.append((f"{jump_of(force):.3f} m/s, {force} N on the G1", *own, *theirs))
    if key == "stood":
        driven = map(driven_joints, results.rows.values())
        cells.append(("targets of, joints", *driven, *("29" for _ in published)))
    return Table(title, ("level", *results.rows, *published), cells)


def kick_title(results: Results) -> str:
    """Title of a run of `kick`."""
    each = len(results.protocol.scenarios) // len(LEVELS)
    return f"{results.env_id}: kick, {results.protocol.form}, {each} episodes a level{_variant(results)}"


def kick_summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Level -> counts, rate and means of one policy."""
    found = {}
    for force in LEVELS:
        level = [row for row in rows if level_of(row) == force]
        if level:
            counts = {key: sum(row[key] for row in level) for key in RATES}
            means = {key: fmean(row[key] for row in level) for key in MEANS}
            interval = list(wilson_interval(counts["stood"], len(level)))
            found[str(force)] = {
                "jump": jump_of(force), "episodes": len(level), **counts, "ci95": interval, **means
            }  # fmt: skip
    return found


def tour_summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Completed tours, mean survival, and errors over all segments that were begun."""
    completed = sum(row["survived"] for row in rows)
    return {
        "runs": len(rows),
        "completed": completed,
        "ci95": list(wilson_interval(completed, len(rows))),
        "survival_s": fmean(min(row["end_time"], LENGTH) for row in rows),
        "position_error_cm": fmean(error for row in rows for error in row["position_errors_cm"]),
        "heading_error_deg": fmean(error for row in rows for error in row["heading_errors_deg"]),
    }


def tour_table(results: Results) -> Table:
    """One row of cells for each policy, then the published ones, where they are of the same tour."""
    cells, beside = [], as_published(results.protocol)
    for name, rows in results.rows.items():
        summary = tour_summary(rows)
        low, high = summary["ci95"]
        errors = f"{summary['position_error_cm']:.1f}", f"{summary['heading_error_deg']:.1f}"
        share = f"{100 * summary['completed'] / summary['runs']:.1f} %"
        interval, survival = f"{100 * low:.1f}-{100 * high:.1f}", f"{summary['survival_s']:.1f}"
        cells.append((name, str(summary["runs"]), share, interval, survival, *errors, driven_joints(rows)))
    for name, row in TOUR_ROWS.items() if beside else ():
        both = ("{}/{}".format(*pair) for pair in (row.survival, row.position, row.heading))
        completed = "{}/{} %".format(*row.completed)
        cells.append((f"{name} (published)", str(row.runs), completed, "", *both, ""))
    runs = f"run ids 0-{len(results.protocol.scenarios) - 1}{_variant(results)}"
    columns = (
        "policy", "runs", "completed", "95 % interval", "survival [s]", "position [cm]", "heading [deg]",
        "targets of",
    )  # fmt: skip
    title = f"{results.env_id}: tour, {runs}" + "; published rows in MuJoCo / PhysX" * beside
    return Table(title, columns, cells)


def result_tables(results: Results) -> list[Table]:
    """All tables of a protocol, the first one for the terminal too."""
    if results.protocol.name == "tour":
        return [tour_table(results)]
    titles = (RATES | MEANS) | {"stood": f"{kick_title(results)}. {STOOD}"}
    return [kick_table(results, key, title) for key, title in titles.items()]


def _variant(results: Results) -> str:
    protocol = results.protocol
    arms = f", {protocol.form}" * (protocol.watcher != protocol.name) + ", no punches" * (not protocol.pushed)
    return arms + ", bodies collide" * protocol.collisions + ", robots at rest stand" * protocol.stands


def to_dict(results: Results) -> dict[str, Any]:
    """One JSON object of the results."""
    summary = kick_summary if results.protocol.name == "kick" else tour_summary
    return {
        "protocol": results.protocol.summary()
        | {"collisions": results.protocol.collisions, "stand": results.protocol.stands},
        "env": results.env_id,
        "policies": {name: summary(rows) for name, rows in results.rows.items()},
        "out": str(results.directory),
    }


def write_protocol_reports(results: Results) -> Path:
    """Write report.json and report.md into the directory; returns the path of the latter."""
    protocol = results.protocol
    page = markdown_page(protocol.name.capitalize(), result_tables(results))
    if protocol.name == "kick":
        note = f"{FORMS[protocol.form].capitalize()}.\n\n{KICK_CRITERION}\n{kick_note(protocol)}"
    else:
        note = tour_note(protocol)
    return write_reports(results.directory, to_dict(results), f"{page}\n{note}")
