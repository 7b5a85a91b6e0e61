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


LEVEL = 0.005  # a foothold's corners differ by no more in height [m]
BESIDE_EDGE = 0.05  # and keep so far from where they would, so that the foot clears the edge [m]
SHIFTS = (0.0, *(sign * 0.01 * step for step in range(1, 16) for sign in (1.0, -1.0)))  # of a foothold [m]


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

    def foothold(self, x: float, y: float, yaw: float) -> tuple[float, float]:
        """How far ahead of (x, y) a sole lies level, the nearest such place, and the height there [m].

        Along its own axis, at most by the longest of SHIFTS; where there is no such place it stays.
        """
        for shift in SHIFTS:
            low, high = self.under(x + shift * math.cos(yaw), y + shift * math.sin(yaw), yaw, BESIDE_EDGE)
            if high - low <= LEVEL:
                return shift, high
        return 0.0, self.under(x, y, yaw)[1]
