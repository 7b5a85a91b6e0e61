"""Table, pictures and page of `frontier`: the hardest push by direction, beside F* and F*_stand.

On the page policies have their labels as names; rows keep the names that commands take.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...controllers.whole_body.limits import LIMIT_NAMES
from ..output.tables import Table, markdown_page, named_apart, write_pictures, write_reports
from ..record.words import DIRECTIONS, sector_of
from ..rollout.environments import make_env
from ..rollout.outcome import limit_words, reason_words
from ..score.frontier import Frontier, Search
from ..score.limits import OWN, PAPER, PHASES, POINT_FOOT, STAND, limit_curves
from . import page
from .page import Command

CURVE_STEP = 3.0  # between the points of a limit's curve [deg]
Rows = Sequence[Mapping[str, Any]]


def fall_cell(falls: Sequence[Mapping[str, Any]]) -> str:
    """Fall of the weakest force that failed: the limit met first, the three met for the longest time."""
    if not falls or falls[0]["first_limit"] is None:
        return "-"
    shares = falls[0]["limit_shares"]
    longest = sorted(shares, key=lambda name: (-shares[name], LIMIT_NAMES.index(name)))[:3]
    at = ", ".join(f"{limit_words(name)} {shares[name]:.2f}" for name in longest)
    return f"{limit_words(falls[0]['first_limit'])}; {at}"


def _stand_cell(entry: Mapping[str, Any]) -> str:
    """Largest force caught without a step, its interval where it has one, and its share of F*_stand."""
    low, high = entry.get("stand_ci95", (None, None))
    interval = "" if low is None else f"{low:.0f} to {high:.0f}; "
    return f"{entry['stand_N']:.0f} ({interval}{entry['stand_N'] / entry['own_stand_limit_N']:.2f})"


def frontier_table(
    frontier: Frontier, name_of: Callable[[float], str] = "{:g}".format, falls: bool = True
) -> Table:
    """Limits, forces of each policy, and what fells it (`falls`), by direction, named by `name_of`.

    Where replicas are run, the last row has those that nobody pushes.
    """
    search, names = frontier.settings.search, list(frontier.rows)
    objects = [frontier.to_dict(name) for name in names]
    stands, lines = frontier.settings.command.stand, []
    for index, (psi, limit) in enumerate(frontier.limits.items()):
        entries = [one["directions"][index] for one in objects]
        forces = [*map(search.cell, entries), *(_stand_cell(entry) for entry in entries if stands)]
        cells = (fall_cell(rows[index]["falls"]) for rows in frontier.rows.values()) if falls else ()
        limits = (f"{force:.0f}" for force in (limit.own, limit.paper, limit.stand))
        lines.append((name_of(psi), *limits, *forces, *cells))
    if search.control:
        counts = [f"{one['unpushed_recovered']} of {one['replicas']['count']} recover" for one in objects]
        rest = ["-"] * (len(names) * (stands + falls))
        lines.append(("unpushed", "-", "-", "-", *counts, *rest))
    in_place = [f"{name} without a step" for name in names if stands]
    falls_by = ["falls by"] if len(names) == 1 else [f"{name} falls by" for name in names]
    columns = "psi [deg]", "own F* [N]", "paper's F* [N]", "own F*_stand [N]"
    return Table(
        f"{frontier.settings.env_id}: {search.meaning} [N]",
        (*columns, *names, *in_place, *(falls_by if falls else ())),
        lines,
        f"{search.bracket_note} F*_stand is what a robot at rest on both feet can at most be pushed with so "
        "that it need not step."
        + (" Without a step: in brackets the share of it." if stands else "")
        + (
            " Falls by: the limit that the first failure met first, then the three that it met for the "
            "longest share of the time."
            if falls
            else ""
        ),
    )


def replicas_table(frontier: Frontier, name_of: Callable[[float], str] = "{:g}".format) -> Table:
    """J95 and J50 of each policy by direction, and first failure and islands; no rows without replicas."""
    lines = []
    for name in frontier.rows if frontier.settings.search.control else ():
        for entry in frontier.to_dict(name)["directions"]:
            impulses = (_impulse_cell(entry, of) for of in ("J95", "J50"))
            first, islands = entry["first_failure_N"], entry["islands"]
            beyond = ", ".join(f"{one['force_N']:g} ({one['replicas']})" for one in islands)
            cells = "-" if first is None else f"{first:g}", beyond or "-"
            lines.append((name, name_of(entry["psi_deg"]), *impulses, *cells))
    impulses = "J95 [N s]; [N s/kg]", "J50 [N s]; [N s/kg]"
    columns = "policy", "psi [deg]", *impulses, "first failure [N]", "islands [N]"
    note = (
        "J95 and J50: impulse from which 95 % and 50 % of the replicas recover, with its 95 % interval. "
        "First failure: the weakest force tried from which one of them does not. Islands: forces from which "
        "replicas recover that do not from a weaker one, and how many of them."
    )
    return Table("Impulses, first failures and islands", columns, lines, note, words=2)


def _impulse_cell(entry: Mapping[str, Any], name: str) -> str:
    """An impulse with its interval [N s], and by the robot's mass."""
    low, high = entry[f"{name}_ci95"]
    return f"{entry[f'{name}_Ns']:.0f} ({low:.0f} to {high:.0f}); {entry[f'{name}_Ns_per_kg']:.2f}"


def question(frontier: Frontier) -> tuple[str, ...]:
    """What one frontier of a directory asks, besides its policies, that another one may not."""
    return (f"{len(next(iter(frontier.rows.values())))} directions",)


def write_frontier_reports(frontier: Frontier) -> Path:
    """Write report.md, whose path is returned, and report.json, with the limits of every fall."""
    policies = {}
    for name, rows in frontier.rows.items():
        content = frontier.to_dict(name)
        entries = zip(content["directions"], rows, strict=True)
        policies[name] = content | {
            "directions": [{**entry, "falls": row["falls"]} for entry, row in entries]
        }
    markdown = markdown_page("Frontier", [frontier_table(frontier), replicas_table(frontier)])
    return write_reports(frontier.directory, {"policies": policies}, markdown, question(frontier))


STYLES = {OWN: "k-", PAPER: "k--", POINT_FOOT: "k:", STAND: "k-."}


def closed(values: Sequence[float]) -> list[float]:
    """Values around the robot, the first one again at the end."""
    return [*values, values[0]]


def draw_marks(axes: Any, entries: Rows, color: Any) -> None:
    """Draw interval, first failures and islands of thresholds, each where entries have them."""
    if "threshold_ci95" not in entries[0]:
        return
    psi = [math.radians(entry["psi_deg"]) for entry in entries]
    around = np.array([*psi, psi[0] + 2.0 * math.pi])
    low, high = (closed([entry["threshold_ci95"][end] for entry in entries]) for end in (0, 1))
    axes.fill_between(around, low, high, color=color, alpha=0.25, linewidth=0.0)
    first = [(at, entry["first_failure_N"]) for at, entry in zip(psi, entries, strict=True)]
    axes.plot(*zip(*first, strict=True), "x", color=color, markersize=4, alpha=0.5)
    beyond = [
        (at, one["force_N"]) for at, entry in zip(psi, entries, strict=True) for one in entry["islands"]
    ]
    if beyond:
        axes.plot(*zip(*beyond, strict=True), ".", color=color, markersize=4, alpha=0.3)


def furthest_of(frontier: Frontier, curves: Mapping[str, Sequence[float]]) -> float:
    """How far out a map goes [N]."""
    keys = frontier.settings.search.headline, "stand_N"
    entries = [entry for name in frontier.rows for entry in frontier.to_dict(name)["directions"]]
    forces = [entry[key] for entry in entries for key in keys if key in entry]
    forces += [entry["threshold_ci95"][1] for entry in entries if "threshold_ci95" in entry]
    return 1.05 * max(*forces, *curves[OWN], *curves[STAND])


def save_pictures(frontier: Frontier) -> list[Path]:
    """Write frontier.png and frontier.svg into the frontier's directory.

    Forward is up, psi counter-clockwise, left stance: right pushes go towards the swing side. Where the robot
    stands, the dashed lines are what it caught without a step. Of replicas bands are intervals, crosses first
    failures and dots islands; marks farther out than the map are left out.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 7.5), layout="constrained")
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    settings = frontier.settings
    angles = np.linspace(0.0, 360.0, 361)
    with closing(make_env(settings.env_id)) as env:
        curves = limit_curves(env, angles.tolist(), settings.duration, settings.command)
    for label, curve in curves.items():
        axes.plot(np.radians(angles), curve, STYLES[label], linewidth=1, label=label)
    if all(limit.phases is not None for limit in frontier.limits.values()):
        psi = closed([math.radians(psi) for psi in frontier.limits])
        force = closed([limit.phases or 0.0 for limit in frontier.limits.values()])
        axes.plot(psi, force, color="0.5", linewidth=1, label=PHASES)
    for policy in frontier.rows:
        entries = frontier.to_dict(policy)["directions"]
        psi = closed([math.radians(entry["psi_deg"]) for entry in entries])
        force = closed([entry[settings.search.headline] for entry in entries])
        (line,) = axes.plot(psi, force, marker="o", markersize=3, label=policy)
        draw_marks(axes, entries, line.get_color())
        if settings.command.stand:
            force, label = closed([entry["stand_N"] for entry in entries]), f"{policy} without a step"
            axes.plot(psi, force, "o--", color=line.get_color(), markersize=3, label=label)
    moment = "at rest on both feet" if settings.command.stand else "start of a left stance"
    if settings.search.control and not settings.command.stand:
        moment = "any phase of a left stance"
    axes.set_title(
        f"{settings.env_id}: {settings.search.meaning} [N]\n"
        f"{settings.body}, {settings.duration:g} s, {moment}; forward is up"
    )
    axes.set_ylim(0.0, furthest_of(frontier, curves))
    figure.legend(loc="outside lower center", fontsize="small", ncols=2)
    own = named_apart(frontier.directory, frontier.rows, question(frontier))
    return write_pictures(figure, frontier.directory, f"frontier{own}")


def write_frontier_page(frontier: Frontier, command: Command) -> Path:
    """Write report.html beside the rows of a frontier; returns its path.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    labels = page.short_labels(frontier.rows)
    rows, controls = (
        {labels[name]: one for name, one in each.items()} for each in (frontier.rows, frontier.controls)
    )
    found = replace(frontier, rows=rows, controls=controls)
    seeds = f"of the replicas {found.settings.replica_seed}, the same for every force, direction and policy"
    if not found.settings.search.control:
        seeds = "nothing random but the sensors' noise, which has one seed"
    content = {
        "title": "Largest push by direction",
        "settings": found.settings,
        "verdict": verdict(found),
        "figures": _figures(found),
        "replicas": found.settings.replicas if found.settings.search.control else 0,
        "forces": frontier_table(found, direction_text, falls=False),
        "impulses": replicas_table(found, direction_text),
        "falls": falls_table(found, command),
        "manifest": page.manifest(command, [page.rows_hash(found.directory)], seeds),
    }
    return page.write_page(found.directory, "frontier.html", content, command)


def mean_share(found: Frontier, policy: str) -> float:
    """Force that counts as a share of F* of the own box, mean over the directions."""
    shares = [entry[found.settings.search.share] for entry in found.to_dict(policy)["directions"]]
    known = [share for share in shares if share is not None]
    return sum(known) / len(known) if known else math.nan


def mean_share_in_place(found: Frontier, policy: str) -> float:
    """Largest force that a standing robot catches without a step, of F*_stand, mean over the directions."""
    entries = found.to_dict(policy)["directions"]
    return sum(entry["stand_N"] / entry["own_stand_limit_N"] for entry in entries) / len(entries)


def verdict(found: Frontier) -> str:
    """Who withstands most in the mean, where it is ahead of the next, and what is caught without a step."""
    best, *others = sorted(found.rows, key=lambda name: -mean_share(found, name))
    text = f"{best} withstands {100.0 * mean_share(found, best):.0f} % of F* in the mean"
    in_place = ""
    if found.settings.command.stand:
        shares = [f"{name} {100.0 * mean_share_in_place(found, name):.0f} %" for name in (best, *others)]
        in_place = f" Of F*_stand, caught without a step: {', '.join(shares)}."
    if not others:
        return f"{text} of {len(found.limits)} directions.{in_place}"
    force = found.settings.search.headline
    pairs = zip(*(found.to_dict(name)["directions"] for name in (best, others[0])), strict=True)
    leads = [a[force] - b[force] for a, b in pairs]
    return (
        f"{text}, {others[0]} {100.0 * mean_share(found, others[0]):.0f} %: the first takes the harder push "
        f"in {sum(lead > 0 for lead in leads)} of {len(leads)} directions, the second in "
        f"{sum(lead < 0 for lead in leads)}.{in_place}"
    )


def direction_text(psi_deg: float) -> str:
    """An angle, and the nearest of eight directions in words."""
    return f"{psi_deg:g}\N{DEGREE SIGN}, {DIRECTIONS[sector_of(psi_deg)]}"


def falls_table(found: Frontier, command: Command) -> Table:
    """The first failure of each policy in each direction that has one, with the command that replays it."""
    lines = []
    for label, rows in found.rows.items():
        for row in rows:
            if row["falls"]:
                force, psi = row["falls"][0]["force_N"], row["psi_deg"]
                why = f"{force:.0f} N ({reason_words(row['falls'][0]['failure_reason'])})"
                replay = command.replay_push(psi, force, row["policy"], row["falls"][0].get("replica"))
                lines.append((label, direction_text(psi), why, fall_cell(row["falls"]), replay))
    columns = ("policy", "direction", "weakest push that fells it", "first limit; longest met", "replay")
    return Table("What fells it", columns, lines)


def _figures(found: Frontier) -> list[tuple[str, str]]:
    """Label and map of each policy, all to one scale."""
    settings = found.settings
    angles = np.arange(0.0, 360.0 + CURVE_STEP / 2.0, CURVE_STEP)
    with closing(make_env(settings.env_id)) as env:
        curves = limit_curves(env, angles.tolist(), settings.duration, settings.command)
    furthest = furthest_of(found, curves)
    return [
        (label, _figure(label, found.to_dict(label)["directions"], settings.search, angles, curves, furthest))
        for label in found.rows
    ]


def _figure(
    label: str,
    rows: Rows,
    search: Search,
    angles: np.ndarray,
    curves: Mapping[str, Sequence[float]],
    furthest: float,
) -> str:
    """Forces of one policy around the robot, between the limits; forward is up."""
    from matplotlib.ticker import MaxNLocator

    with page.panel(3.6, polar=True) as (figure, axes):
        axes.set_theta_zero_location("N")
        drawn = (OWN, page.INK, "-"), (PAPER, page.GREY, (0, (4, 2))), (STAND, page.ORANGE, "-.")
        for name, color, line in drawn:
            look = {"color": color, "linewidth": 1.1, "linestyle": line}
            axes.plot(np.radians(angles), curves[name], label=name, **look)
        psi = [math.radians(row["psi_deg"]) for row in rows]
        for key, name, line in ((search.headline, label, "-"), ("stand_N", f"{label} without a step", ":")):
            if key in rows[0]:
                force = [row[key] for row in rows]
                axes.plot(
                    closed(psi), closed(force), color=page.BLUE, marker="o", markersize=3.5, linewidth=1.4,
                    linestyle=line, label=name,
                )  # fmt: skip
        draw_marks(axes, rows, page.BLUE)
        axes.set_thetagrids(range(0, 360, 45), ("forward", "", "left", "", "backward", "", "right", ""))
        axes.set_ylim(0.0, furthest)
        axes.set_yticks([tick for tick in MaxNLocator(4).tick_values(0.0, furthest) if 0.0 < tick < furthest])
        axes.set_rlabel_position(22.5)
        axes.grid(color="#cccccc", linewidth=0.5)
        figure.legend(loc="outside lower center", frameon=False, fontsize=8.0)
        words = f"{label}: {search.meaning} [N], by direction, and F*"
        return page.to_svg(figure, words)
