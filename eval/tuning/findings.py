"""How a preset was found: what its file says for the reader, and what the command prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from ..output.statistics import PairedCounts
from .scorer import RECOVERED
from .trials import START, Row, best_of


def comparison(start: Row, best: Row) -> dict[str, Any]:
    """Scores of start and best on the same scenarios, and how their recoveries differ."""
    recovered = [np.array(row["values"]) == RECOVERED for row in (best, start)]
    counts = PairedCounts.of(*recovered)
    return {
        "start": {"score": start["score"], "recovered": int(recovered[1].sum())},
        "best": {"score": best["score"], "recovered": int(recovered[0].sum())},
        "scenarios": counts.pairs,
        "only_best": counts.only_a,
        "only_start": counts.only_b,
        "mcnemar_p": counts.p_value,
        "rate_difference": counts.rate_difference,
        "ci95": list(counts.interval),
    }


def findings(
    config: Mapping[str, Any], population: int, rows: Sequence[Row], held_out: Mapping[int, Row]
) -> dict[str, Any]:
    """The section `found` of a preset file.

    Args:
        config: configuration of the study.
        population: trials in a generation.
        rows: of all trials.
        held_out: rows of start and best on the suite held out, by number of the trial.
    """
    best = best_of(rows)
    return {
        "by": f"CMA-ES (cmaes {version('cmaes')}), {population} trials a generation, successive halving",
        "trials": len(rows) - 1,
        "stopped_early": sum(row["stopped"] for row in rows),
        "episodes": sum(row["scenarios"] for row in [*rows, *held_out.values()]),
        "trial": best["trial"],
        "tuning": comparison(rows[START], best),
        "held_out": comparison(held_out[START], held_out[best["trial"]]),
        **{name: config[name] for name in ("tune", "suites", "code", "space")},
    }
