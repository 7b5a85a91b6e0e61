"""Recovery against the impulse of a push: a fitted curve for each body, and where it reaches 50 and 95 %."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....envs.scenario.scenario import Scenario
from ...output.logistic import LogisticFit, fit_logistic
from ...output.statistics import wilson_interval
from ...score.kinds import KINDS
from ..figure import BLUE, GREY, INK, ORANGE, new_panel, page_style, to_svg

Row = Mapping[str, Any]
Array = NDArray[np.float64]
SHARES = (0.5, 0.95)  # of pushes recovered from, at J50 and J95
BINS = 6  # of equally many pushes
COLUMNS = ("policy", "pushed body", "pushes", "J50 [N s]", "J95 [N s]")
LOOKS: tuple[dict[str, Any], ...] = (  # of the bodies in turn
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
    recovered: NDArray[np.bool_]  # (n,)
    fit: LogisticFit | None  # none where there is no finite one

    def threshold(self, share: float) -> str:
        """Impulse up to which at least this share recovers, with its interval, in words [N s].

        Nothing is told beyond the pushes that were given.
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


def curve_cells(curves: Sequence[Curve]) -> list[tuple[str, ...]]:
    """One row of cells for each curve, in COLUMNS."""
    return [
        (curve.policy, curve.body, str(curve.impulse.size), *(curve.threshold(share) for share in SHARES))
        for curve in curves
    ]


def curve_figure(curves: Sequence[Curve], furthest: float) -> str:
    """The curves of one policy, their bands, and the shares of BINS groups of pushes with their intervals.

    Args:
        curves: of one policy, one a body.
        furthest: largest impulse on the axis [N s].
    """
    policy = curves[0].policy
    with page_style():
        figure, axes = new_panel(2.35)
        for curve, look in zip(curves, LOOKS, strict=False):
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
    axes.errorbar(
        centres,
        shares,
        (below, above),
        linestyle="none",
        markersize=4.0,
        elinewidth=0.8,
        label=curve.body,
        **mark,
    )
    if curve.fit is not None:
        at = np.linspace(curve.impulse.min(), curve.impulse.max(), 60)
        axes.fill_between(at, *curve.fit.band(at), color=look["color"], alpha=0.15, linewidth=0.0)
        axes.plot(
            at, curve.fit.probability(at), color=look["color"], linestyle=look["linestyle"], linewidth=1.4
        )


def binned(impulse: Array, recovered: NDArray[np.bool_]) -> tuple[Array, Array, Array, Array]:
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
