"""Small steps in the floor: square tiles of different heights, which no robot sees.

The heights are a function of (noise seed, tile), so the floor has no end and depends on nothing else. The
model holds four boxes a foot; before every physics step they are moved to the four tiles around the tile
corner nearest to the sole, which hold all of it: half a tile is more than half the sole's diagonal.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import mujoco
import numpy as np

from ...controllers.array_table import COMMON, NO_STATE, Floats1, Ints1, Ints2, floats_at
from ...controllers.jit import njit
from ...controllers.model.robot import BodyPlan
from ...controllers.whole_body.kinematics import Array
from ..robots.compiled_robot import CompiledRobot
from ..scenario.noise import counter_seed, uniform
from ..scenario.scenario import Scenario

TILE = 0.4  # side of a tile [m]
DEPTH = 0.5  # half the height of a box [m]: a sole never comes out of its other side
AROUND = 4  # tiles a foot
FIRST_TILE = "tile_0"


class Floor(NamedTuple):
    """The floors of n robots."""

    step: Floats1  # (n,) tiles are up to this high [m]; 0: the floor is a plane
    seed: Ints1  # (n,)
    side: Floats1  # (n,) 1, or -1 where y is mirrored
    places: Annotated[Ints2, NO_STATE]  # (n, 3) addresses of the boxes' places, of the feet's; or 0
    half_sole: Annotated[Floats1, COMMON]  # (2,) half the length and the width of a sole [m]


def level_floors(n: int, half_sole: tuple[float, float]) -> Floor:
    """Planes for n robots."""
    return Floor(
        np.zeros(n), np.zeros(n, np.int64), np.ones(n), np.zeros((n, 3), np.int64), np.array(half_sole)
    )


def add_tiles(spec: mujoco.MjSpec, plan: BodyPlan) -> None:
    """Put 2 x AROUND boxes in the place of a spec's plane, each in contact with one foot."""
    spec.geom("floor").pos = [0.0, 0.0, -2.0 * DEPTH]
    pair = next(pair for pair in spec.pairs if pair.geomname1 == "floor")
    for tile in range(2 * AROUND):
        box = spec.worldbody.add_geom()
        box.name, box.type = f"tile_{tile}", mujoco.mjtGeom.mjGEOM_BOX
        box.size, box.pos = [0.5 * TILE, 0.5 * TILE, DEPTH], [0.0, 0.0, -DEPTH]
        box.contype = box.conaffinity = 0
        contact = spec.add_pair()
        contact.geomname1, contact.geomname2 = box.name, plan.sole_boxes[tile // AROUND]
        contact.condim, contact.friction, contact.solref = pair.condim, pair.friction, pair.solref


def assign_floor(floors: Floor, k: int, scenario: Scenario) -> None:
    """Give robot k the floor of a scenario; where it has tiles, `connect_floor` comes next."""
    floors.step[k] = scenario.errors.floor_step
    floors.seed[k] = counter_seed(scenario.noise_seed)
    floors.side[k] = 1.0 if scenario.stance_side == "left" else -1.0
    floors.places[k] = 0


def has_tiles(model: mujoco.MjModel) -> bool:
    """Whether it stands on tiles."""
    return model.npair > 2 * AROUND


def connect_floor(
    floors: Floor, k: int, robot: CompiledRobot, model: mujoco.MjModel, data: mujoco.MjData
) -> None:
    """Let the boxes of robot k's own model follow its feet."""
    first = model.geom(FIRST_TILE).id
    feet = [data.geom_xpos[model.geom(foot).id].ctypes.data for foot in robot.plan.sole_boxes]
    floors.places[k] = [model.geom_pos[first:].ctypes.data, *feet]


def lay_floor(floors: Floor, k: int, model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> None:
    """Put the boxes of robot k, which `connect_floor` knows, under its feet in a posture (nq,)."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    place_tiles(floors, k)


def tile_places(model: mujoco.MjModel) -> Array:
    """Centres of the boxes of a robot's own model, a view (2 AROUND, 3), or (0, 3) on a plane [m]."""
    if not has_tiles(model):
        return model.geom_pos[:0]
    first = model.geom(FIRST_TILE).id
    return model.geom_pos[first : first + 2 * AROUND]


@njit(cache=True)
def tile_height(floors: Floor, k: int, i: int, j: int) -> float:
    """Height of tile (i, j) [m], uniform in [0, step)."""
    return floors.step[k] * uniform(floors.seed[k], i, j)


@njit(cache=True)
def grid_origin(floors: Floor, k: int) -> tuple[float, float]:
    """A corner of tiles, in tiles, in [0, 1)."""
    return uniform(floors.seed[k], 1 << 40, 0), uniform(floors.seed[k], 1 << 40, 1)


@njit(cache=True)
def place_tiles(floors: Floor, k: int) -> None:
    """Move each foot's boxes of robot k to the tiles under it."""
    x0, y0 = grid_origin(floors, k)
    boxes, side = floats_at(floors.places[k, 0], 3 * 2 * AROUND), floors.side[k]
    for leg in range(2):
        foot = floats_at(floors.places[k, 1 + leg], 3)
        i, j = round(foot[0] / TILE - x0), round(side * foot[1] / TILE - y0)
        for near in range(AROUND):
            a, b = i - near // 2, j - near % 2
            at = 3 * (AROUND * leg + near)
            boxes[at] = TILE * (a + 0.5 + x0)
            boxes[at + 1] = side * TILE * (b + 0.5 + y0)
            boxes[at + 2] = tile_height(floors, k, a, b) - DEPTH


@njit(cache=True)
def floor_height(floors: Floor, k: int, x: float, y: float) -> float:
    """Height of the highest tile under a sole centred at (x, y), along the world's axes [m]."""
    height = 0.0
    if floors.step[k] > 0.0:
        x0, y0 = grid_origin(floors, k)
        for corner in range(4):
            a = x + floors.half_sole[0] * (1.0 - 2.0 * (corner // 2))
            b = floors.side[k] * y + floors.half_sole[1] * (1.0 - 2.0 * (corner % 2))
            tile = math.floor(a / TILE - x0), math.floor(b / TILE - y0)
            height = max(height, tile_height(floors, k, tile[0], tile[1]))
    return height
