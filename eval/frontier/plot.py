"""Polar picture of a frontier: force by direction, against the closed-form limits."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...controllers.files import write_atomically
from ..rollout.environments import make_env
from .closed_form import OWN, PAPER, POINT_FOOT, limit_curves

if TYPE_CHECKING:
    from .scan import Frontier


STYLES = {OWN: "k-", PAPER: "k--", POINT_FOOT: "k:"}


def save_pictures(frontier: Frontier) -> list[Path]:
    """Write frontier.png and frontier.svg into the frontier's directory.

    Forward is up, psi counter-clockwise, left stance: right pushes go towards the swing side.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
    settings = frontier.settings
    angles = np.linspace(0.0, 360.0, 361)
    env = make_env(settings.env_id)
    curves = limit_curves(env, angles.tolist(), settings.duration, settings.command)
    env.close()
    for label, curve in curves.items():
        axes.plot(np.radians(angles), curve, STYLES[label], linewidth=1, label=label)
    for policy, rows in frontier.rows.items():
        psi = [math.radians(row["psi_deg"]) for row in rows]
        force = [row["survived_N"] for row in rows]
        axes.plot([*psi, psi[0]], [*force, force[0]], marker="o", markersize=3, label=policy)
    axes.set_title(
        f"{settings.env_id}: largest force before the first failure [N]\n"
        f"{settings.body}, {settings.duration:g} s, start of a left stance; forward is up"
    )
    figure.legend(loc="outside lower center", fontsize="small", ncols=3)
    paths = []
    for suffix in ("png", "svg"):
        buffer = io.BytesIO()
        figure.savefig(buffer, format=suffix, dpi=130, metadata={"Date": None} if suffix == "svg" else None)
        path = frontier.directory / f"frontier.{suffix}"
        write_atomically(path, buffer.getvalue())
        paths.append(path)
    return paths
