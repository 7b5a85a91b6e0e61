"""`info` of robots on one core: a dict of one robot, and Gymnasium's vector form of n.

The vector form has arrays by key, and beside each a mask under `_key`, True where the dict of the robot holds
a value other than None. Both are made from the same rows (`told`).
"""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scenario.push import SIDES, Push
from ..scenario.scenario import Scenario
from .episodes import GaitEpisodes
from .period_end import (
    CMP,
    COP,
    DCM,
    FAILURE,
    LOADED,
    MARGIN,
    PHASE,
    PUSH,
    PUSH_START,
    RECOVERED_AT,
    SIDE,
    TIME,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Info = dict[str, Any]
LEFT, RIGHT = SIDES

# Columns of what stays of a push: force, impulse [3 each], direction, duration, impulse_per_kg
_FORCE, _IMPULSE, _DIRECTION, _DURATION, _PER_KG, _COLUMNS = slice(0, 3), slice(3, 6), 6, 7, 8, 9


def put(info: Info, key: str, values: Any, mask: Mask) -> None:
    """Add a key and its mask."""
    info[key], info[f"_{key}"] = values, mask


def overwrite(info: Info, other: Info, rows: Mask) -> None:
    """Put the rows (n,) of an info of the same keys in the place of those in `info`."""
    for key, values in other.items():
        if isinstance(values, dict):
            overwrite(info[key], values, rows)
        else:
            info[key][rows] = values[rows]


def push_info(push: Push, mass: float) -> Info:
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


class PushTable:
    """The pushes of n robots as `info` tells of them."""

    def __init__(self, n: int):
        self._numbers, self._bodies = np.zeros((n, 1, _COLUMNS)), np.full((n, 1), None, dtype=object)
        self._told: list[list[Info]] = [[] for _ in range(n)]  # the same, push by push

    def assign(self, k: int, scenario: Scenario, mass: float) -> None:
        """Robot k has the pushes of a scenario."""
        count = len(scenario.pushes)
        if count > self._numbers.shape[1]:
            self._grow(count)
        self._told[k] = []
        for i, push in enumerate(scenario.pushes):
            told = push_info(push, mass)
            rest = told["direction"], told["duration"], told["impulse_per_kg"]
            self._numbers[k, i], self._bodies[k, i] = (*told["force"], *told["impulse"], *rest), told["body"]
            self._told[k].append(told)

    def _grow(self, count: int) -> None:
        n, old = self._bodies.shape
        numbers, bodies = np.zeros((n, count, _COLUMNS)), np.full((n, count), None, dtype=object)
        numbers[:, :old], bodies[:, :old] = self._numbers, self._bodies
        self._numbers, self._bodies = numbers, bodies

    def of_robot(self, k: int, row: list[float]) -> Info | None:
        """The push of robot k that its row of `told` names; None without pushes."""
        push = int(row[PUSH])
        return None if push < 0 else {**self._told[k][push], "start": number_or_none(row[PUSH_START])}

    def of_robots(self, told: Array, rows: Mask) -> tuple[Info, Mask]:
        """The pushes that `told` (n, COLUMNS) names, and which of the robots `rows` (n,) have one."""
        index, start = np.maximum(told[:, PUSH], 0).astype(np.int64), told[:, PUSH_START]
        robots, has, info = np.arange(len(told)), rows & (told[:, PUSH] >= 0), {}
        numbers = self._numbers[robots, index]
        put(info, "force", numbers[:, _FORCE], has.copy())
        put(info, "direction", numbers[:, _DIRECTION], has.copy())
        put(info, "start", start, has & ~np.isnan(start))
        put(info, "duration", numbers[:, _DURATION], has.copy())
        put(info, "body", self._bodies[robots, index], has.copy())
        put(info, "impulse", numbers[:, _IMPULSE], has.copy())
        put(info, "impulse_per_kg", numbers[:, _PER_KG], has.copy())
        return info, has


def number_or_none(value: float) -> float | None:
    """None in the place of NaN."""
    return None if math.isnan(value) else value


class InfoReader:
    """Reads the info of the robots of one set of episodes."""

    def __init__(self, episodes: GaitEpisodes):
        self._episodes = episodes
        self._ids = np.full(episodes.n, None, dtype=object)
        self._pushes = PushTable(episodes.n)
        self._reasons = np.array([reason or None for reason in episodes.failures], dtype=object)
        self._sides = np.array(SIDES, dtype=object)

    def begin(self, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario."""
        self._ids[k] = scenario.id
        self._pushes.assign(k, scenario, self._episodes.robot.mass)

    def of_robot(self, k: int, terms: Array) -> Info:
        """Info of robot k, with its reward terms; the arrays are the caller's."""
        row = self._episodes.told()[k]
        values = row.tolist()
        left, right = values[LOADED]
        planner = self._episodes.told_of_planner().items()
        return {
            "scenario_id": self._ids[k],
            "time": values[TIME],
            "push": self._pushes.of_robot(k, values),
            "capture_margin": values[MARGIN],
            "phase": values[PHASE],
            "stance_side": SIDES[int(values[SIDE])],
            "failure_reason": self._reasons[int(values[FAILURE])],
            "recovered_at": number_or_none(values[RECOVERED_AT]),
            "reward_terms": dict(zip(self._episodes.reward_terms, terms.tolist(), strict=True)),
            "dcm": row[DCM],
            "cop": row[COP],
            "cmp": row[CMP],
            "contacts": {LEFT: left > 0.0, RIGHT: right > 0.0},
            **{key: copy.copy(rows[k]) for key, (rows, known) in planner if known[k]},
        }

    def of_robots(self, rows: Mask, terms: Array) -> Info:
        """Info of the robots `rows` (n,), with the reward terms (n, terms); the arrays are the caller's."""
        told, info = self._episodes.told(), {}
        push, pushed = self._pushes.of_robots(told, rows)
        failure, recovered_at = told[:, FAILURE].astype(np.int64), told[:, RECOVERED_AT]
        put(info, "scenario_id", self._ids.copy(), rows.copy())
        put(info, "time", told[:, TIME], rows.copy())
        put(info, "push", push, pushed)
        put(info, "capture_margin", told[:, MARGIN], rows.copy())
        put(info, "phase", told[:, PHASE], rows.copy())
        put(info, "stance_side", self._sides[told[:, SIDE].astype(np.int64)], rows.copy())
        put(info, "failure_reason", self._reasons[failure], rows & (failure != 0))
        put(info, "recovered_at", recovered_at, rows & ~np.isnan(recovered_at))
        put(info, "reward_terms", _columns(self._episodes.reward_terms, terms, rows), rows.copy())
        put(info, "dcm", told[:, DCM], rows.copy())
        put(info, "cop", told[:, COP], rows.copy())
        put(info, "cmp", told[:, CMP], rows.copy())
        put(info, "contacts", _columns(SIDES, told[:, LOADED] > 0.0, rows), rows.copy())
        for key, (values, known) in self._episodes.told_of_planner().items():
            put(info, key, values.copy(), rows & known)
        return info


def _columns(names: tuple[str, ...], values: NDArray[Any], rows: Mask) -> Info:
    info: Info = {}
    for name, column in zip(names, values.T, strict=True):
        put(info, name, column.copy(), rows.copy())
    return info
