"""Single pushes by direction and by their share of the closed-form limit, on a map around the robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from ....envs.scenario.push import GaitEvent, Push
from ....envs.scenario.scenario import Scenario
from ...frontier.share import limit_share
from ...record.words import DIRECTIONS, sector_of
from ..figure import BLUE, GREY, INK, new_panel, page_style, to_svg

Row = Mapping[str, Any]
SECTORS = len(DIRECTIONS)
FAINT = "#b4b4b4"
SIDES = ("forward", "stance\nside", "backward", "swing\nside")  # counter-clockwise from the top


@dataclass(frozen=True)
class MappedPush:
    """A single push as the map shows it, mirrored so that the robot stands on its left foot."""

    scenario_id: str
    psi: float  # counter-clockwise from forward, right is the swing side [rad]
    share: float  # of F* at its moment


def mapped_pushes(env: gym.Env, scenarios: Sequence[Scenario]) -> list[MappedPush]:
    """The single pushes of a suite that come at a moment of the gait and have a limit."""
    found = []
    for scenario in scenarios:
        if len(scenario.pushes) != 1:
            continue
        (push,) = scenario.pushes
        share = limit_share(env, push, scenario.command)
        if share is not None:
            found.append(MappedPush(scenario.id, stance_direction(push), share))
    return found


def stance_direction(push: Push) -> float:
    """Direction of a push, mirrored where it comes on a right stance [rad]."""
    right = isinstance(push.start, GaitEvent) and push.start.side == "right"
    return -push.direction if right else push.direction


def direction_figure(policy: str, pushes: Sequence[MappedPush], rows: Mapping[str, Row]) -> str:
    """The map of one policy: every push, and at the rim how many of each sector were recovered from.

    Args:
        policy: its label.
        pushes: of the map.
        rows: of the policy, by scenario.
    """
    furthest = max(1.0, *(push.share for push in pushes))
    with page_style():
        figure, axes = new_panel(3.5, polar=True)
        axes.set_theta_zero_location("N")
        _draw_pushes(axes, pushes, rows)
        around = np.linspace(0.0, 2.0 * math.pi, 181)
        axes.plot(around, np.ones_like(around), color=INK, linewidth=1.0)
        axes.text(
            math.radians(202.5), 1.0, "F*", fontsize=9.0, ha="center", va="center", backgroundcolor="white"
        )
        recovered: list[list[bool]] = [[] for _ in DIRECTIONS]
        for push in pushes:
            recovered[sector_of(math.degrees(push.psi))].append(rows[push.scenario_id]["recovered"])
        for sector, inside in enumerate(recovered):
            angle = sector * 2.0 * math.pi / SECTORS
            text = f"{sum(inside)}/{len(inside)}" + (f"\n{SIDES[sector // 2]}" if sector % 2 == 0 else "")
            axes.text(angle, 1.2 * furthest, text, ha="center", va="center", fontsize=8.0)
        edges = (np.arange(SECTORS) + 0.5) * 2.0 * math.pi / SECTORS
        axes.vlines(edges, 0.0, furthest, color=FAINT, linewidth=0.5)
        axes.set(ylim=(0.0, 1.02 * furthest), xticks=[], yticks=[0.5])
        axes.set_yticklabels([])
        axes.grid(color=FAINT, linewidth=0.7)
        axes.spines["polar"].set_visible(False)
        return to_svg(figure, f"{policy}: single pushes recovered from, by direction and share of the limit")


def _draw_pushes(axes: Any, pushes: Sequence[MappedPush], rows: Mapping[str, Row]) -> None:
    """Dots for pushes recovered from, rings for those survived, crosses for falls."""
    kinds: dict[str, list[MappedPush]] = {"recovered": [], "survived": [], "fell": []}
    for push in pushes:
        row = rows[push.scenario_id]
        kinds["recovered" if row["recovered"] else "survived" if row["survived"] else "fell"].append(push)
    looks: dict[str, dict[str, Any]] = {
        "recovered": {"marker": "o", "s": 9.0, "color": BLUE, "alpha": 0.75, "linewidths": 0.0},
        "survived": {"marker": "o", "s": 14.0, "facecolors": "white", "edgecolors": GREY, "linewidths": 0.9},
        "fell": {"marker": "x", "s": 16.0, "color": INK, "linewidths": 1.0},
    }
    for kind, inside in kinds.items():
        axes.scatter([push.psi for push in inside], [push.share for push in inside], **looks[kind])
