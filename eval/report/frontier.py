"""The page of `frontier`: the hardest push that each policy withstands, by direction, beside F* and F*_stand.

Frontiers here have the labels of policies as their names; rows keep the names that commands take.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..output.tables import Table
from ..record.words import DIRECTIONS, sector_of
from ..rollout.environments import make_env
from ..rollout.outcome import reason_words
from ..score.frontier import OWN, PAPER, STAND, Frontier, fall_cell, frontier_table, limit_curves
from . import page
from .page import Command

CURVE_STEP = 3.0  # between the points of a limit's curve [deg]
Rows = Sequence[Mapping[str, Any]]


def write_frontier_page(frontier: Frontier, command: Command) -> Path:
    """Write report.html beside the rows of a frontier; returns its path.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    labels = page.short_labels(frontier.rows)
    found = replace(frontier, rows={labels[name]: rows for name, rows in frontier.rows.items()})
    seeds = "nothing random but the sensors' noise, which has one seed"
    content = {
        "title": "Largest push by direction",
        "settings": found.settings,
        "verdict": verdict(found),
        "figures": _figures(found),
        "forces": frontier_table(found, direction_text, falls=False),
        "falls": falls_table(found, command),
        "manifest": page.manifest(command, [page.rows_hash(found.directory)], seeds),
    }
    return page.write_page(found.directory, "frontier.html", content)


def mean_share(found: Frontier, policy: str) -> float:
    """Force before the first failure as a share of F* of the own box, mean over the directions."""
    shares = [entry["own_fraction"] for entry in found.to_dict(policy)["directions"]]
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
    rows = zip(found.rows[best], found.rows[others[0]], strict=True)
    leads = [a["survived_N"] - b["survived_N"] for a, b in rows]
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
                replay = command.replay_push(psi, force, row["policy"])
                lines.append((label, direction_text(psi), why, fall_cell(row["falls"]), replay))
    columns = ("policy", "direction", "weakest push that fells it", "first limit; longest met", "replay")
    return Table("What fells it", columns, lines)


def _figures(found: Frontier) -> list[tuple[str, str]]:
    """Label and map of each policy, all to one scale."""
    settings = found.settings
    angles = np.arange(0.0, 360.0 + CURVE_STEP / 2.0, CURVE_STEP)
    with closing(make_env(settings.env_id)) as env:
        curves = limit_curves(env, angles.tolist(), settings.duration, settings.command)
    forces = [row["survived_N"] for rows in found.rows.values() for row in rows]
    furthest = 1.05 * max(*forces, *curves[OWN], *curves[STAND])
    return [(label, _figure(label, rows, angles, curves, furthest)) for label, rows in found.rows.items()]


def _figure(
    label: str, rows: Rows, angles: np.ndarray, curves: Mapping[str, Sequence[float]], furthest: float
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
        for key, name, line in (("survived_N", label, "-"), ("stand_N", f"{label} without a step", ":")):
            if key in rows[0]:
                force = [row[key] for row in rows]
                axes.plot(
                    [*psi, psi[0]], [*force, force[0]], color=page.BLUE, marker="o", markersize=3.5,
                    linewidth=1.4, linestyle=line, label=name,
                )  # fmt: skip
        axes.set_thetagrids(range(0, 360, 45), ("forward", "", "left", "", "backward", "", "right", ""))
        axes.set_ylim(0.0, furthest)
        axes.set_yticks([tick for tick in MaxNLocator(4).tick_values(0.0, furthest) if 0.0 < tick < furthest])
        axes.set_rlabel_position(22.5)
        axes.grid(color="#cccccc", linewidth=0.5)
        figure.legend(loc="outside lower center", frameon=False, fontsize=8.0)
        words = f"{label}: largest force before the first failure [N], by direction, and F*"
        return page.to_svg(figure, words)
