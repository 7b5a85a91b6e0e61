"""The floor of n robots: tiles that follow their feet (`terrain.Tiles`), footholds on a floor they know."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import mujoco
import numpy as np

from ...controllers.array_table import NO_STATE, Floats1, Ints1, Ints2, floats_at
from ...controllers.jit import njit
from ...controllers.whole_body.kinematics import Array
from ..scenario.noise import counter_seed, grid_origin, uniform
from ..scenario.scenario import Scenario
from ..scenario.terrain import DEPTH, TILE, TILES_PER_FOOT, Pattern, Terrain, Tiles

BOXES = 2 * TILES_PER_FOOT
FIRST_TILE = "tile_0"


class Floor(NamedTuple):
    """The tiles of n robots."""

    step: Floats1  # (n,) they are up to this high [m]; 0: there are none
    seed: Ints1  # (n,)
    side: Floats1  # (n,) 1, or -1 where y is mirrored
    places: Annotated[Ints2, NO_STATE]  # (n, 3) addresses of the boxes' places, of the feet's; or 0


def level_floors(n: int) -> Floor:
    """Floors of n robots without tiles."""
    return Floor(np.zeros(n), np.zeros(n, np.int64), np.ones(n), np.zeros((n, 3), np.int64))


def has_tiles(model: mujoco.MjModel) -> bool:
    """Whether a robot stands on tiles."""
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, FIRST_TILE) >= 0


def assign_floor(
    floors: Floor,
    k: int,
    scenario: Scenario,
    soles: Sequence[str],
    model: mujoco.MjModel,
    data: mujoco.MjData,
) -> None:
    """Give robot k the tiles of a scenario; the boxes of its own model, where it has any, follow its feet."""
    floors.step[k] = sum(part.step for part in scenario.errors.terrains if isinstance(part, Tiles))
    floors.seed[k] = counter_seed(scenario.noise_seed)
    floors.side[k] = 1.0 if scenario.stance_side == "left" else -1.0
    floors.places[k] = 0
    if has_tiles(model):
        feet = [data.geom_xpos[model.geom(foot).id].ctypes.data for foot in soles]
        floors.places[k] = [tile_places(model).ctypes.data, *feet]


def pattern_of(floors: Floor, k: int) -> Pattern:
    """What random floors of robot k depend on."""
    return Pattern(floors.seed.item(k), floors.side.item(k))


def lay_floor(floors: Floor, k: int, model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> None:
    """Put the boxes of robot k under its feet in a posture (nq,); nothing where it has none."""
    if floors.places[k, 0] != 0:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        place_tiles(floors, k)


def tile_places(model: mujoco.MjModel) -> Array:
    """Centres of the boxes of a robot's own model, a view (BOXES, 3), or (0, 3) without tiles [m]."""
    if not has_tiles(model):
        return model.geom_pos[:0]
    first = model.geom(FIRST_TILE).id
    return model.geom_pos[first : first + BOXES]


@njit(cache=True)
def place_tiles(floors: Floor, k: int) -> None:
    """Move each foot's boxes of robot k to the tiles under it."""
    x0, y0 = grid_origin(floors.seed[k])
    boxes, side = floats_at(floors.places[k, 0], 3 * BOXES), floors.side[k]
    for leg in range(2):
        foot = floats_at(floors.places[k, 1 + leg], 3)
        i, j = round(foot[0] / TILE - x0), round(side * foot[1] / TILE - y0)
        for near in range(TILES_PER_FOOT):
            a, b = i - near // 2, j - near % 2
            at = 3 * (TILES_PER_FOOT * leg + near)
            boxes[at] = TILE * (a + 0.5 + x0)
            boxes[at + 1] = side * TILE * (b + 0.5 + y0)
            boxes[at + 2] = floors.step[k] * uniform(floors.seed[k], a, b) - DEPTH


UNEVEN = 0.03  # a sole stands on corners that differ by no more in height [m]
BESIDE_EDGE = 0.015, 0.35  # a foot clears an edge from so far on [m], and farther by this share of its height
FARTHEST = 0.05  # of what is looked at beside a sole [m]
SHIFTS = (0.0, *(sign * 0.01 * step for step in range(1, 16) for sign in (1.0, -1.0)))  # of a foothold [m]
AHEAD = 4  # footholds that are looked at


@dataclass(frozen=True)
class KnownFloor:
    """The floor of one robot as control knows it, and its footholds."""

    parts: tuple[Terrain, ...]  # it is as high as the highest of them
    pattern: Pattern
    half_sole: tuple[float, float]  # [m]

    def under(self, x: float, y: float, yaw: float = 0.0, beyond: float = 0.0) -> tuple[float, float]:
        """Lowest and highest of the floor at the corners of a sole there, each `beyond` farther out [m]."""
        cos, sin = math.cos(yaw), math.sin(yaw)
        length, width = (half + beyond for half in self.half_sole)
        corners = [(a * length, b * width) for a in (1.0, -1.0) for b in (1.0, -1.0)]
        heights = [
            max(
                part.height(x + cos * a - sin * b, y + sin * a + cos * b, self.pattern) for part in self.parts
            )
            for a, b in corners
        ]
        return min(heights), max(heights)

    def clear(self, x: float, y: float, yaw: float) -> bool:
        """Whether a sole stands there, far enough from any edge to come and go without touching it."""
        low, high = self.under(x, y, yaw, FARTHEST)
        if high - low > UNEVEN:
            least, share = BESIDE_EDGE
            low, high = self.under(x, y, yaw, min(least + share * (high - low), FARTHEST))
        return high - low <= UNEVEN

    def foothold(self, x: float, y: float, yaw: float, stride: float) -> tuple[float, float]:
        """How far ahead of (x, y) the sole shall land, and the height of the floor there [m].

        Of this foothold and the next ones, `stride` apart, the first that is not clear is moved to the
        nearest place that is, and those up to it by equal shares, so that no step is changed by much.

        Args:
            x: of the foothold asked for [m].
            y: likewise [m].
            yaw: of the sole, along which it may be moved [rad].
            stride: [m].
        """
        cos, sin = math.cos(yaw), math.sin(yaw)

        def is_clear(ahead: float) -> bool:
            return self.clear(x + ahead * cos, y + ahead * sin, yaw)

        shift = 0.0
        for i in range(AHEAD):
            needed = next((way for way in SHIFTS if is_clear(i * stride + way)), 0.0)
            if needed != 0.0:
                shift = needed / (i + 1)
                break
        if not is_clear(shift) and is_clear(0.0):
            shift = 0.0
        return shift, self.under(x + shift * cos, y + shift * sin, yaw)[1]
