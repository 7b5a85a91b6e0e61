"""`info` of robots on one core: a dict of one robot, and Gymnasium's vector form of n.

The vector form has arrays by key, and beside each a mask under `_key`, True where the dict of the robot holds
a value other than None. Both are made from the same rows, `GaitEpisodes.info_rows`.
"""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scenario.push import SIDES, Push
from ..scenario.scenario import Scenario
from . import period_end
from .episodes import GaitEpisodes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Info = dict[str, Any]
LEFT, RIGHT = SIDES


def put(info: Info, key: str, values: Any, mask: Mask) -> None:
    """Add a key and its mask; both are the caller's from then on."""
    info[key], info[f"_{key}"] = values, mask.copy()


def overwrite(info: Info, other: Info, rows: Mask) -> None:
    """Put the rows (n,) of another info in the place of those in `info`; a key that this lacks it gets."""
    for key, values in other.items():
        if isinstance(values, dict):
            overwrite(info.setdefault(key, {}), values, rows)
        else:
            info.setdefault(key, np.zeros_like(values))[rows] = values[rows]


def _push_info(push: Push, mass: float) -> Info:
    """A push for `info`; its start [s] is None while its gait event has not come."""
    return {
        "force": push.force,
        "direction": push.direction,
        "start": None,
        "duration": push.duration,
        "body": push.body,
        "impulse": push.impulse,
        "impulse_per_kg": push.impulse_magnitude / mass,
    }


# Columns of the numbers of a push
_COLUMN = {"force": slice(0, 3), "direction": 3, "duration": 4, "impulse": slice(5, 8), "impulse_per_kg": 8}


def number_or_none(value: float) -> float | None:
    """None in the place of NaN."""
    return None if math.isnan(value) else value


class InfoReader:
    """Reads the info of the robots of one set of episodes."""

    def __init__(self, episodes: GaitEpisodes):
        self._episodes = episodes
        self._ids = np.full(episodes.n, None, dtype=object)
        self._pushes: list[list[Info]] = [[] for _ in range(episodes.n)]  # of each robot, as `_push_info`
        self._numbers = np.zeros((episodes.n, 1, 9))  # the same, (n, P, 9)
        self._bodies = np.full((episodes.n, 1), None, dtype=object)
        self._reasons = np.array([reason or None for reason in episodes.failures], dtype=object)
        self._sides = np.array(SIDES, dtype=object)

    def begin(self, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario."""
        self._ids[k] = scenario.id
        self._pushes[k] = [_push_info(push, self._episodes.robot.mass) for push in scenario.forces]
        if (more := len(scenario.forces) - self._bodies.shape[1]) > 0:
            self._numbers = np.pad(self._numbers, ((0, 0), (0, more), (0, 0)))
            self._bodies = np.pad(self._bodies, ((0, 0), (0, more)), constant_values=np.array(None))
        for i, push in enumerate(self._pushes[k]):
            self._bodies[k, i] = push["body"]
            for key, column in _COLUMN.items():
                self._numbers[k, i, column] = push[key]

    def of_robot(self, k: int, terms: Array) -> Info:
        """Info of robot k, with its reward terms; the arrays are the caller's."""
        row = self._episodes.info_rows()[k]
        values = row.tolist()
        push, (left, right) = int(values[period_end.PUSH]), values[period_end.LOADED]
        start = number_or_none(values[period_end.PUSH_START])
        more = self._episodes.more_info().items()
        return {
            "scenario_id": self._ids[k],
            "time": values[period_end.TIME],
            "push": None if push < 0 else {**self._pushes[k][push], "start": start},
            "capture_margin": values[period_end.MARGIN],
            "phase": values[period_end.PHASE],
            "stance_side": SIDES[int(values[period_end.SIDE])],
            "failure_reason": self._reasons[int(values[period_end.FAILURE])],
            "recovered_at": number_or_none(values[period_end.RECOVERED_AT]),
            "reward_terms": dict(zip(self._episodes.reward_terms, terms.tolist(), strict=True)),
            "dcm": row[period_end.DCM],
            "cop": row[period_end.COP],
            "cmp": row[period_end.CMP],
            "contacts": {LEFT: left > 0.0, RIGHT: right > 0.0},
            **{key: copy.copy(rows[k]) for key, (rows, known) in more if known[k]},
        }

    def of_robots(self, rows: Mask, terms: Array) -> Info:
        """Info of the robots `rows` (n,), with the reward terms (n, terms); the arrays are the caller's."""
        numbers, info = self._episodes.info_rows(), {}
        failure = numbers[:, period_end.FAILURE].astype(np.int64)
        recovered_at = numbers[:, period_end.RECOVERED_AT]
        put(info, "scenario_id", self._ids.copy(), rows)
        put(info, "time", numbers[:, period_end.TIME], rows)
        put(info, "push", *self._push(numbers, rows))
        put(info, "capture_margin", numbers[:, period_end.MARGIN], rows)
        put(info, "phase", numbers[:, period_end.PHASE], rows)
        put(info, "stance_side", self._sides[numbers[:, period_end.SIDE].astype(np.int64)], rows)
        put(info, "failure_reason", self._reasons[failure], rows & (failure != 0))
        put(info, "recovered_at", recovered_at, rows & ~np.isnan(recovered_at))
        put(info, "reward_terms", _columns(self._episodes.reward_terms, terms, rows), rows)
        put(info, "dcm", numbers[:, period_end.DCM], rows)
        put(info, "cop", numbers[:, period_end.COP], rows)
        put(info, "cmp", numbers[:, period_end.CMP], rows)
        put(info, "contacts", _columns(SIDES, numbers[:, period_end.LOADED] > 0.0, rows), rows)
        for key, (values, known) in self._episodes.more_info().items():
            put(info, key, values.copy(), rows & known)
        return info

    def _push(self, numbers: Array, rows: Mask) -> tuple[Info, Mask]:
        """The push of every robot that its row names, and which of the robots `rows` (n,) have one."""
        robots, index = np.arange(len(rows)), np.maximum(numbers[:, period_end.PUSH], 0).astype(np.int64)
        pushes, has, info = self._numbers[robots, index], rows & (numbers[:, period_end.PUSH] >= 0), {}
        for key, column in _COLUMN.items():
            put(info, key, pushes[:, column], has)
        put(info, "body", self._bodies[robots, index], has)
        start = numbers[:, period_end.PUSH_START]
        put(info, "start", start, has & ~np.isnan(start))
        return info, has


def _columns(names: tuple[str, ...], values: NDArray[Any], rows: Mask) -> Info:
    info: Info = {}
    for name, column in zip(names, values.T, strict=True):
        put(info, name, column.copy(), rows)
    return info
