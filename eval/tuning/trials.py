"""Trials: one point of the space each, run on the suite's scenarios, on disk when it is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ..output.rows import RowFile
from ..score.suites import Suite
from .candidate import preset_of
from .racing import estimate, race
from .scorer import Scorer
from .settings import TuningSettings
from .space import Space

CANDIDATE = "candidate.json"  # the preset that is being run
START = 0  # number of the trial that is the start itself
KEY = ("suite", "trial")
FIELDS = ("score", "stopped", "scenarios", "settings", "point", "values")
Row = dict[str, Any]


def best_of(rows: Sequence[Row]) -> Row:
    """The row of the highest score among those that met every scenario; of equal ones the first."""
    return max((row for row in rows if not row["stopped"]), key=lambda row: row["score"])


class Trials:
    """Runs points, or takes their rows out of the directory.

    Args:
        settings: of the study.
        space: whose points are run.
        store: rows of the directory.
        scorer: runs scenarios.
        directory: where the preset that is being run lies.
    """

    def __init__(
        self, settings: TuningSettings, space: Space, store: RowFile, scorer: Scorer, directory: Path
    ):
        self._settings, self._space, self._store = settings, space, store
        self._scorer, self._path = scorer, directory / CANDIDATE

    def run(self, number: int, point: NDArray[np.float64], suite: Suite, best: Row | None) -> Row:
        """The row of a point; stopped early where it is clearly worse than the best one so far.

        Raises:
            InvalidValueError: the directory has a trial of this number at another point.
        """
        key = (suite.name, number)
        if key in self._store.rows:
            row = self._store.rows[key]
            if not np.allclose(row["point"], point, rtol=1e-9, atol=1e-9):
                raise InvalidValueError(
                    f"{str(self._store.path)!r} has trial {number} at another point than this search asks "
                    "for: choose another --out, or --overwrite to start over"
                )
            return row
        settings = self._space.settings(point)
        preset_of(self._settings, settings).save(self._path)
        values = race(
            lambda first, end: self._scorer.values(self._path, suite.scenarios[first:end]),
            len(suite.scenarios),
            best["values"] if best else (),
        )
        row = {
            "suite": suite.name, "trial": number, "score": estimate(values, best["values"] if best else ()),
            "stopped": len(values) < len(suite.scenarios), "scenarios": len(values), "settings": settings,
            "point": point.tolist(), "values": values,
        }  # fmt: skip
        self._store.append(row)
        return row

    def close(self) -> None:
        """Remove the preset that was being run."""
        self._path.unlink(missing_ok=True)
