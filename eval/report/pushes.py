"""Recovery by direction, by impulse and over repeated pushes, as figures and tables.

Evaluations here have the labels of policies as their names.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.ticker import MaxNLocator

from ...envs.scenario.push import GaitEvent, Push
from ...envs.scenario.scenario import Scenario
from ..output.statistics import Array, LogisticFit, SurvivalCurve, fit_logistic, kaplan_meier, wilson_interval
from ..output.tables import Table
from ..record.words import DIRECTIONS, sector_of
from ..score import evaluate, limits
from ..score.report import KINDS
from .page import BLUE, GREY, INK, ORANGE, PALE, beside_axis, legend_below, panel, to_svg

Row = Mapping[str, Any]
FAINT = "#b4b4b4"
SIDES = ("forward", "stance\nside", "backward", "swing\nside")  # counter-clockwise from the top
STANDER_SIDES = ("forward", "left", "backward", "right")  # of a robot that stands on both feet


@dataclass(frozen=True)
class MappedPush:
    """A single push as the map shows it, mirrored so that the robot stands on its left foot."""

    scenario_id: str
    psi: float  # counter-clockwise from forward, right is the swing side [rad]
    share: float  # of F* at its moment, or of F*_stand
    stands: bool = False  # the robot, on both feet


def mapped_pushes(env: gym.Env, scenarios: Sequence[Scenario]) -> list[MappedPush]:
    """The single pushes of a suite that come at a moment of the gait, or to a stander, and have a limit."""
    found = []
    for scenario in scenarios:
        if len(scenario.pushes) == 1:
            (push,) = scenario.pushes
            if scenario.command.stand:
                share = limits.standing_share(env, scenario)
                found.append(MappedPush(scenario.id, push.direction, share, True))
                continue
            share = limits.limit_share(env, push, scenario.command)
            if share is not None:
                found.append(MappedPush(scenario.id, stance_direction(push), share))
    return found


def stance_direction(push: Push) -> float:
    """Direction of a push, mirrored where it comes on a right stance [rad]."""
    right = isinstance(push.start, GaitEvent) and push.start.side == "right"
    return -push.direction if right else push.direction


def direction_figure(policy: str, pushes: Sequence[MappedPush], rows: Mapping[str, Row]) -> str:
    """The map of one policy: every push, and at the rim how many of each sector were recovered from."""
    furthest, stand = max(1.0, *(push.share for push in pushes)), all(push.stands for push in pushes)
    sides, limit = (STANDER_SIDES, "F*$_{stand}$") if stand else (SIDES, "F*")
    with panel(3.5, polar=True) as (figure, axes):
        axes.set_theta_zero_location("N")
        _draw_pushes(axes, pushes, rows)
        around = np.linspace(0.0, 2.0 * math.pi, 181)
        axes.plot(around, np.ones_like(around), color=INK, linewidth=1.0)
        axes.text(
            math.radians(202.5), 1.0, limit, fontsize=9.0, ha="center", va="center", backgroundcolor="white"
        )
        recovered: list[list[bool]] = [[] for _ in DIRECTIONS]
        for push in pushes:
            recovered[sector_of(math.degrees(push.psi))].append(rows[push.scenario_id]["recovered"])
        for sector, inside in enumerate(recovered):
            angle = sector * 2.0 * math.pi / len(DIRECTIONS)
            text = f"{sum(inside)}/{len(inside)}" + (f"\n{sides[sector // 2]}" if sector % 2 == 0 else "")
            axes.text(angle, 1.2 * furthest, text, ha="center", va="center", fontsize=8.0)
        edges = (np.arange(len(DIRECTIONS)) + 0.5) * 2.0 * math.pi / len(DIRECTIONS)
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


SHARES = (0.5, 0.95)  # of pushes recovered from, at J50 and J95
BINS = 6  # of equally many pushes
BODY_LOOKS: tuple[dict[str, Any], ...] = (  # of the bodies in turn
    {"color": BLUE, "linestyle": "-", "marker": "o", "markerfacecolor": BLUE},
    {"color": ORANGE, "linestyle": (0, (4, 2)), "marker": "s", "markerfacecolor": "white"},
    {"color": INK, "linestyle": (0, (1, 1)), "marker": "^", "markerfacecolor": INK},
)


@dataclass(frozen=True)
class Curve:
    """The pushes of one policy at one body, and the curve through their outcomes."""

    policy: str
    body: str
    impulse: Array  # of a push, (n,) [N s]
    recovered: np.ndarray  # (n,)
    fit: LogisticFit | None  # none where there is no finite one

    def threshold(self, share: float) -> str:
        """Impulse up to which at least this share recovers, with its interval, in words [N s].

        Beyond the pushes that were given there is no number.
        """
        low, high = float(self.impulse.min()), float(self.impulse.max())
        if self.recovered.all():
            return f"over {high:.0f}"
        if not self.recovered.any():
            return f"under {low:.0f}"
        interval = None if self.fit is None else self.fit.input_interval(share)
        if self.fit is None or interval is None or self.fit.slope >= 0.0:
            return "not told"
        middle, first, last = (_inside(value, low, high) for value in (self.fit.input_at(share), *interval))
        return middle if first == last else f"{middle} ({first} to {last})"


def _inside(value: float, low: float, high: float) -> str:
    """An impulse [N s]; beyond those given only on which side."""
    return f"under {low:.0f}" if value < low else f"over {high:.0f}" if value > high else f"{value:.0f}"


def curves_of(scenarios: Sequence[Scenario], rows: Sequence[Row], policy: str) -> list[Curve]:
    """One curve for each body that is pushed, over the scenarios with a single push."""
    bodies: dict[str, list[int]] = {}
    for index, scenario in enumerate(scenarios):
        if len(scenario.pushes) == 1:
            bodies.setdefault(KINDS["body"](scenario), []).append(index)
    curves = []
    for body in sorted(bodies):
        impulse = np.array([rows[i]["impulse"] for i in bodies[body]])
        recovered = np.array([rows[i]["recovered"] for i in bodies[body]], dtype=bool)
        curves.append(Curve(policy, body, impulse, recovered, fit_logistic(impulse, recovered)))
    return curves


def curves_table(curves: Iterable[Curve]) -> Table:
    """Number of pushes of each curve, and the impulses at which it comes down to SHARES."""
    columns = ("policy", "pushed body", "pushes", "J50 [N s]", "J95 [N s]")
    lines = [
        (one.policy, one.body, str(one.impulse.size), *(one.threshold(share) for share in SHARES))
        for one in curves
    ]
    return Table("Recovery against impulse", columns, lines, words=2)


def curve_figure(curves: Sequence[Curve], furthest: float) -> str:
    """The curves of one policy by body, their bands, and the shares of BINS groups with their intervals.

    The axis goes up to `furthest` [N s].
    """
    policy = curves[0].policy
    with panel(2.35) as (figure, axes):
        for curve, look in zip(curves, BODY_LOOKS, strict=False):
            _draw(axes, curve, look)
        axes.axhline(0.5, color=GREY, linewidth=0.5, linestyle=(0, (1, 2)))
        axes.set(xlim=(0.0, 1.03 * furthest), ylim=(-0.03, 1.03), xlabel="impulse of the push [N s]")
        axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100 %"])
        if len(curves) > 1:
            axes.legend(frameon=False, loc="lower left", fontsize=8.0)
        return to_svg(figure, f"{policy}: share of pushes recovered from, against their impulse")


def _draw(axes: Any, curve: Curve, look: Mapping[str, Any]) -> None:
    """One curve with its band, its groups and their intervals."""
    centres, shares, below, above = binned(curve.impulse, curve.recovered)
    mark = {key: look[key] for key in ("color", "marker", "markerfacecolor")}
    reach = below, above
    axes.errorbar(
        centres, shares, reach, linestyle="none", markersize=4.0, elinewidth=0.8, label=curve.body, **mark
    )
    if curve.fit is not None:
        at = np.linspace(curve.impulse.min(), curve.impulse.max(), 60)
        axes.fill_between(at, *curve.fit.band(at), color=look["color"], alpha=0.15, linewidth=0.0)
        axes.plot(
            at, curve.fit.probability(at), color=look["color"], linestyle=look["linestyle"], linewidth=1.4
        )


def binned(impulse: Array, recovered: np.ndarray) -> tuple[Array, Array, Array, Array]:
    """Groups of equally many pushes: mean impulse, share recovered, and how far Wilson's interval reaches.

    Returns:
        Centres [N s], shares, and the distances below and above them, each (groups,).
    """
    order = np.argsort(impulse, kind="stable")
    groups = [group for group in np.array_split(order, min(BINS, impulse.size)) if group.size]
    share = np.array([recovered[group].mean() for group in groups])
    ends = np.array([wilson_interval(int(recovered[group].sum()), group.size) for group in groups])
    centres = np.array([impulse[group].mean() for group in groups])
    return centres, share, np.maximum(share - ends[:, 0], 0.0), np.maximum(ends[:, 1] - share, 0.0)


MARKS = 4  # moments in the table, at most, at round times
SURVIVAL_LOOKS: tuple[dict[str, Any], ...] = (  # of the three that keep most robots up, and of the last
    {"color": BLUE, "linestyle": "-"},
    {"color": ORANGE, "linestyle": (0, (4, 2))},
    {"color": INK, "linestyle": (0, (1, 1))},
    {"color": GREY, "linestyle": (0, (6, 2, 1, 2))},
)
REST: dict[str, Any] = {"color": PALE, "linestyle": "-", "zorder": 1.5}


@dataclass(frozen=True)
class SurvivalPart:
    """Survival under repeated pushes, as the page shows it."""

    episodes: int
    table: Table
    figure: str


def survival_part(evaluation: evaluate.Evaluation) -> SurvivalPart | None:
    """Curves and a table over the scenarios with several pushes; None where there is none."""
    chosen = [i for i, scenario in enumerate(evaluation.suite.scenarios) if len(scenario.pushes) > 1]
    if not chosen:
        return None
    curves, falls = {}, {}
    for name, rows in evaluation.rows.items():
        mine = [rows[i] for i in chosen]
        fell = [not row["survived"] for row in mine]
        curves[name] = kaplan_meier([row["end_time"] for row in mine], fell)
        falls[name] = sum(fell)
    longest = max(float(curve.times[-1]) for curve in curves.values())
    ticks = MaxNLocator(MARKS, steps=[1, 2, 3, 5, 10]).tick_values(0.0, longest)
    marks = [float(time) for time in ticks if 0.0 < time <= longest]
    rows = [
        (label, str(falls[label]), *(share_at(curve, time) for time in marks))
        for label, curve in curves.items()
    ]
    columns = ["policy", "falls", *(f"standing at {time:g} s" for time in marks)]
    return SurvivalPart(
        len(chosen), Table("Repeated pushes", columns, rows), survival_figure(curves, longest)
    )


def share_at(curve: SurvivalCurve, time: float) -> str:
    """The share that stands at a time and its interval, in words."""
    index = int(np.searchsorted(curve.times, time, side="right")) - 1
    if index < 0:
        return "100.0 %"
    low, high = 100.0 * curve.low[index], 100.0 * curve.high[index]
    return f"{100.0 * curve.survival[index]:.1f} % ({low:.1f} to {high:.1f})"


def survival_figure(curves: Mapping[str, SurvivalCurve], longest: float) -> str:
    """A staircase for each policy, down where one of its robots falls; `longest` episode [s].

    More of them than there are looks can't be told apart: those in the middle are pale.
    """
    ordered = sorted(curves, key=lambda label: -curves[label].survival[-1])
    most = len(SURVIVAL_LOOKS) - 1
    looks = dict(zip([*ordered[:most], *ordered[most:][-1:]], SURVIVAL_LOOKS, strict=False))
    others = [label for label in ordered if label not in looks]
    words = {label: beside_axis(label) for label in looks} | {
        label: f"{len(others)} others" for label in others[:1]
    }
    with panel(2.0) as (figure, axes):
        for label in [*looks, *others]:
            curve = curves[label]
            times, shares = [0.0, *curve.times, longest], [1.0, *curve.survival, curve.survival[-1]]
            axes.plot(
                times, 100.0 * np.array(shares), drawstyle="steps-post", linewidth=1.4,
                label=words.get(label), **looks.get(label, REST),
            )  # fmt: skip
        axes.set(xlim=(0.0, longest), xlabel="time since the walk began [s]", ylabel="standing [%]")
        axes.grid(axis="y", color="#e4e4e4", linewidth=0.6)
        legend_below(figure)
        return to_svg(figure, "Share of robots still standing, over time, under repeated pushes")
