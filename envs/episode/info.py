"""`info` of n robots in Gymnasium's vector form: arrays by key, and beside each a mask under `_key`.

A mask is True where the single environment's info holds a value other than None.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.observation import ELAPSED
from ..scenario.push import SIDES
from ..scenario.scenario import Scenario
from .episodes import GaitEpisodes
from .reward import REWARD_TERMS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Info = dict[str, Any]

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


class PushTable:
    """The pushes of n robots as `info` tells of them."""

    def __init__(self, n: int):
        self._numbers, self._bodies = np.zeros((n, 1, _COLUMNS)), np.full((n, 1), None, dtype=object)
        self._count = np.zeros(n, np.int64)

    def assign(self, k: int, scenario: Scenario, mass: float) -> None:
        """Robot k has the pushes of a scenario."""
        count = len(scenario.pushes)
        if count > self._numbers.shape[1]:
            self._grow(count)
        self._count[k] = count
        for i, push in enumerate(scenario.pushes):
            rest = push.direction, push.duration, push.impulse_magnitude / mass
            self._numbers[k, i] = (*push.force, *push.impulse, *rest)
            self._bodies[k, i] = push.body

    def _grow(self, count: int) -> None:
        n, old = self._bodies.shape
        numbers, bodies = np.zeros((n, count, _COLUMNS)), np.full((n, count), None, dtype=object)
        numbers[:, :old], bodies[:, :old] = self._numbers, self._bodies
        self._numbers, self._bodies = numbers, bodies

    def read(self, starts: Array, time: Array, rows: Mask) -> tuple[Info, Mask]:
        """The latest push that has begun, otherwise the first one, and which robots have one.

        Args:
            starts: (n, P) [s], inf while the gait event has not come.
            time: (n,) [s].
            rows: (n,) robots to tell of.
        """
        capacity = self._numbers.shape[1]
        starts = starts[:, :capacity]
        real = np.arange(starts.shape[1]) < self._count[:, None]
        index = np.where(real & (starts < time[:, None]), starts, -np.inf).argmax(axis=1)
        robots = np.arange(len(time))
        numbers, start = self._numbers[robots, index], starts[robots, index]
        has = rows & (self._count > 0)
        come, info = np.isfinite(start), {}
        put(info, "force", numbers[:, _FORCE], has.copy())
        put(info, "direction", numbers[:, _DIRECTION], has.copy())
        put(info, "start", np.where(come, start, np.nan), has & come)
        put(info, "duration", numbers[:, _DURATION], has.copy())
        put(info, "body", self._bodies[robots, index], has.copy())
        put(info, "impulse", numbers[:, _IMPULSE], has.copy())
        put(info, "impulse_per_kg", numbers[:, _PER_KG], has.copy())
        return info, has


class VectorInfo:
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

    def read(self, rows: Mask, terms: Array) -> Info:
        """Info of the robots `rows` (n,), with the reward terms (n, 7); the arrays are the caller's."""
        episodes, core, info = self._episodes, self._episodes.core, {}
        motion, world, failure = episodes.motion(), episodes.world(), episodes.failure()
        push, pushed = self._pushes.read(core.pushes.start, motion.time, rows)
        recovered_at = episodes.monitor.state.recovered_at.copy()
        put(info, "scenario_id", self._ids.copy(), rows.copy())
        put(info, "time", motion.time.copy(), rows.copy())
        put(info, "push", push, pushed)
        put(info, "capture_margin", core.margin.copy(), rows.copy())
        put(info, "phase", np.minimum(core.observation[:, ELAPSED] / episodes.planned, 1.0), rows.copy())
        put(info, "stance_side", self._sides[motion.side], rows.copy())
        put(info, "failure_reason", self._reasons[failure], rows & (failure != 0))
        put(info, "recovered_at", recovered_at, rows & ~np.isnan(recovered_at))
        put(info, "reward_terms", _columns(REWARD_TERMS, terms, rows), rows.copy())
        put(info, "dcm", world.dcm, rows.copy())
        put(info, "cop", world.cop, rows.copy())
        put(info, "cmp", world.cmp, rows.copy())
        put(info, "contacts", _columns(SIDES, world.loaded, rows), rows.copy())
        return info


def _columns(names: tuple[str, ...], values: NDArray[Any], rows: Mask) -> Info:
    info: Info = {}
    for name, column in zip(names, values.T, strict=True):
        put(info, name, column.copy(), rows.copy())
    return info
