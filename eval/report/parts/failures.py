"""What became of the pushes of each policy, and which limits its falls and its recoveries met."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ....controllers.whole_body.bounds_met import BOUNDS
from ...score.bounds_met import bound_summary
from ...score.evaluate import Evaluation
from ..figure import BLUE, GREY, INK, PALE, beside_axis, new_panel, page_style, to_svg
from ..labels import LIMITS, REASONS

RECOVERED = "recovered"
LOOKS: tuple[dict[str, Any], ...] = (  # recovered, then reasons in turn
    {"facecolor": BLUE},
    {"facecolor": "white", "hatch": "////"},
    {"facecolor": INK},
    {"facecolor": PALE},
    {"facecolor": "white", "hatch": "...."},
    {"facecolor": GREY},
)


def reasons_of(evaluation: Evaluation) -> list[str]:
    """Why episodes did not recover, in the order of REASONS, unknown ones last."""
    met = {reason for name in evaluation.rows for reason in evaluation.score(name).failures}
    return [*(reason for reason in REASONS if reason in met), *sorted(met - REASONS.keys())]


def reason_cells(evaluation: Evaluation, labels: Mapping[str, str]) -> list[tuple[str, ...]]:
    """Of each policy how many pushes it recovered from, and how many were lost for each of `reasons_of`."""
    reasons = reasons_of(evaluation)
    cells = []
    for name in evaluation.rows:
        score = evaluation.score(name)
        cells.append((labels[name], str(score.recovered), *(str(score.failures.get(r, 0)) for r in reasons)))
    return cells


def ending_figure(evaluation: Evaluation, labels: Mapping[str, str]) -> str:
    """One bar for each policy: its pushes by what became of them."""
    reasons, names = reasons_of(evaluation), list(evaluation.rows)
    parts = [(RECOVERED, [evaluation.score(name).recovered for name in names])]
    parts += [(r, [evaluation.score(name).failures.get(r, 0) for name in names]) for r in reasons]
    with page_style():
        figure, axes = new_panel(0.95 + 0.3 * len(names) + 0.16 * len(parts))
        left = [0] * len(names)
        for index, (label, counts) in enumerate(parts):
            look = LOOKS[index % len(LOOKS)]
            axes.barh(
                range(len(names)), counts, left=left, height=0.62, edgecolor=INK, linewidth=0.6,
                label=label, **look,
            )  # fmt: skip
            left = [start + count for start, count in zip(left, counts, strict=True)]
        axes.set_yticks(range(len(names)), [beside_axis(labels[name]) for name in names])
        axes.invert_yaxis()
        axes.set(xlabel="pushes", xlim=(0, len(evaluation.suite.scenarios)))
        figure.legend(loc="outside lower left", frameon=False, fontsize=8.0, ncols=2)
        return to_svg(figure, "Pushes of each policy by what became of them; the numbers stand in the table")


def limit_cells(evaluation: Evaluation, labels: Mapping[str, str]) -> tuple[list[str], list[tuple[str, ...]]]:
    """Headings and rows: of each limit met, what it is, and how long falls and recoveries were at it."""
    summaries = {name: bound_summary(rows) for name, rows in evaluation.rows.items()}
    cells = []
    for limit in BOUNDS:
        if not any(limit in part for summary in summaries.values() for part in summary.values()):
            continue
        shares = [_shares(summary, limit) for summary in summaries.values()]
        cells.append((limit, LIMITS.get(limit, ""), *shares))
    return ["limit", "met while", *(labels[name] for name in summaries)], cells


def _shares(summary: Mapping[str, Mapping[str, Mapping[str, float]]], limit: str) -> str:
    """Mean share of the time at a limit, of falls and of recoveries."""
    times = (summary[part].get(limit, {}).get("time", 0.0) for part in ("falls", "recovered"))
    return " / ".join(f"{100.0 * time:.0f} %" for time in times)


def explained(reasons: Iterable[str]) -> list[tuple[str, str]]:
    """Reasons with what they mean, each once, as far as that is known."""
    return [(reason, REASONS[reason]) for reason in dict.fromkeys(reasons) if reason in REASONS]
