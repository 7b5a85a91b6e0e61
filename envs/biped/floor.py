"""The floor of n robots: tiles that follow their feet (`terrain.Tiles`), footholds on a floor they know.

On a known floor a sole shall stand clear of edges, so its place ahead lies in one of a few intervals. Stage 1
(`controllers/stage_1.py`) is solved again on each, about the step that the policy asked for, u_a, T_a and the
DCM offset b_a that follows from them,

    min   alpha_2 (tau - tau_a)^2 + alpha_3 |b - b_j|^2,    u_x in interval j,

and of their solutions the cheapest is taken. The place u_a has no weight, since it was asked for without a
look at the floor, and an error of b counts only as far as the CoP cannot make up for it: moved by
e / (exp(omega r) - 1) for the r seconds that are left, it moves the DCM at touchdown by -e.
A step takes as long as the DCM needs to get there, rather than landing where the DCM is not.

Between two intervals lies more than a stride. So the robot waits before an edge, until it is behind its
command by a share of the d meters between them, and sends its DCM ahead in the step before it goes over:
where that step stays, b_j = (d + b_a) exp(-omega T_l), from which the DCM gets there in a long step of T_l,
by itself. Elsewhere b_j = b_a.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import mujoco
import numpy as np

from ...controllers import stage_1
from ...controllers.array_table import NO_STATE, Floats1, Floats2, Ints1, Ints2, floats_at
from ...controllers.jit import njit
from ...controllers.model.gait_box import COP, DURATION, STEP, GaitLimits
from ...controllers.model.observation import DCM, ELAPSED
from ...controllers.settings import PlannerConfig
from ...controllers.whole_body.kinematics import Array
from ..scenario.noise import counter_seed, grid_origin, uniform
from ..scenario.scenario import Scenario
from ..scenario.terrain import DEPTH, TILE, TILES_PER_FOOT, Pattern, Terrain, Tiles

BOXES = 2 * TILES_PER_FOOT
FIRST_TILE = "tile_0"

# Columns of `Floor.way`, the step of a robot over a floor that it knows
SIDE = 0  # 1 + its stance leg; 0 before the first one
BEGAN = 1  # when it came to stand on it [s]
PLACE = 2  # pair, where that is, in the world [m]
BEHIND = 4  # how far the robot is behind its command [m]
SENDS = 5  # whether the DCM is sent ahead in this step: 1, or 0; -1 until that is decided
TAKEN = 6  # number of the interval that the foothold is in; -1 before the first choice
COUNT = 7  # of intervals; 0 where all is clear, or nothing
INTERVALS = 8  # pairs, least and greatest place ahead of the sole [m]
MOST = 4  # intervals
WAY_SIZE = INTERVALS + 2 * MOST


class Floor(NamedTuple):
    """The tiles of n robots."""

    step: Floats1  # (n,) they are up to this high [m]; 0: there are none
    seed: Ints1  # (n,)
    side: Floats1  # (n,) 1, or -1 where y is mirrored
    way: Floats2  # (n, WAY_SIZE) of robots that know their floor
    places: Annotated[Ints2, NO_STATE]  # (n, 3) addresses of the boxes' places, of the feet's; or 0


def level_floors(n: int) -> Floor:
    """Floors of n robots without tiles."""
    way, places = np.zeros((n, WAY_SIZE)), np.zeros((n, 3), np.int64)
    return Floor(np.zeros(n), np.zeros(n, np.int64), np.ones(n), way, places)


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
    floors.places[k] = floors.way[k] = 0
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
GRID = 0.01  # between two places that are looked at [m]
AT_HAND = 0.1  # an interval no farther than this is the one that the robot stands in [m]
INSIDE = 0.01  # how far into the next interval a long step shall land [m]
GOES_AT = 0.4  # share of the way to the next interval by which a robot is behind before it goes over
LONG = 0.75  # a long step takes so much of the time between the nominal and the longest one
FARTHEST_BEHIND = 0.4  # [m]
SOONEST = 0.01  # a committed step that is due ends no sooner than this [s]
CHANGE = 0.05  # another interval than the one taken has to be better by as much as this error of b [m]


@dataclass(frozen=True)
class KnownFloor:
    """The floor of one robot as control knows it."""

    parts: tuple[Terrain, ...]  # it is as high as the highest of them
    pattern: Pattern
    half_sole: tuple[float, float]  # [m]

    def under(self, x: float, y: float, yaw: float = 0.0, beyond: float = 0.0) -> tuple[float, float]:
        """Lowest and highest of the floor at the corners of a sole there, each `beyond` farther out [m]."""
        cos, sin = math.cos(yaw), math.sin(yaw)
        length, width = (half + beyond for half in self.half_sole)
        corners = [(a * length, b * width) for a in (1.0, -1.0) for b in (1.0, -1.0)]
        shaped = [part for part in self.parts if part.shapes]
        heights = [
            max(
                (part.height(x + cos * a - sin * b, y + sin * a + cos * b, self.pattern) for part in shaped),
                default=0.0,
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

    def intervals(self, x: float, y: float, yaw: float, low: float, high: float) -> list[tuple[float, float]]:
        """Where between `low` and `high` ahead of (x, y) a sole stands clear [m]; nothing where all is."""
        cos, sin = math.cos(yaw), math.sin(yaw)
        ahead = [low + GRID * i for i in range(round((high - low) / GRID) + 1)]
        clear = [self.clear(x + way * cos, y + way * sin, yaw) for way in ahead]
        if all(clear):
            return []
        turns = np.flatnonzero(np.diff([False, *clear, False])).tolist()
        pairs = zip(turns[::2], turns[1::2], strict=True)
        return [(ahead[first], ahead[beyond - 1]) for first, beyond in pairs][-MOST:]


class Stance(NamedTuple):
    """What a step over a known floor begins from."""

    leg: int
    time: float  # [s]
    x: float  # of the sole, in the world [m]
    y: float
    yaw: float  # of the sole [rad]
    aside: float  # from its sole to the line that the other one is to land on, to the left [m]
    speed: float  # commanded, forward [m/s]


class FootholdPlanner:
    """Moves the steps that a policy asks for to clear footholds."""

    def __init__(self, omega: float, limits: GaitLimits, config: PlannerConfig):
        self._omega, self._limits, self._config = omega, limits, config
        self._nominal = 0.5 * (limits.duration_min + limits.duration_max)  # [s]
        self._long = self._nominal + LONG * (limits.duration_max - self._nominal)  # [s]

    def begin_step(self, floor: KnownFloor, way: Array, stance: Stance) -> None:
        """Look for intervals once a foot has come to stand; `way` (WAY_SIZE,) is written."""
        if way[SIDE] == 1.0 + stance.leg:
            return
        cos, sin = math.cos(stance.yaw), math.sin(stance.yaw)
        x, y = stance.x - sin * stance.aside, stance.y + cos * stance.aside
        found = floor.intervals(x, y, stance.yaw, self._limits.length_min, self._limits.length_max)
        behind = 0.0
        if found and way[COUNT] > 0.0:
            gone = (stance.x - way[PLACE]) * cos + (stance.y - way[PLACE + 1]) * sin
            behind = way[BEHIND] + stance.speed * (stance.time - way[BEGAN]) - gone
        way[:INTERVALS] = (
            1.0 + stance.leg, stance.time, stance.x, stance.y,
            min(max(behind, -FARTHEST_BEHIND), FARTHEST_BEHIND), -1.0, -1.0, len(found),
        )  # fmt: skip
        way[INTERVALS : INTERVALS + 2 * len(found)] = np.ravel(found)

    def move_step(self, way: Array, speed: float, obs: Array, asked: Array) -> None:
        """Write place and time of the best clear step, and its CoP, into `asked` (7,).

        Args:
            way: (WAY_SIZE,) of `begin_step`.
            speed: commanded, forward [m/s].
            obs: (36,).
            asked: gait variables, canonical frame.
        """
        if way[COUNT] == 0.0:
            return
        omega, config, limits = self._omega, self._config, self._limits
        problem, solution = np.empty(stage_1.PROBLEM_SIZE), np.empty(stage_1.SOLUTION_SIZE)
        step, elapsed = asked[STEP : STEP + 2].copy(), float(obs[ELAPSED])
        tau = math.exp(omega * asked[DURATION])
        gain = obs[DCM] * math.exp(omega * (config.touchdown_delay - elapsed))
        offset = gain * tau - step
        least = math.exp(omega * max(limits.duration_min, elapsed + config.duration_margin))
        most = max(math.exp(omega * limits.duration_max), least)
        problem[stage_1.GAIN : stage_1.GAIN + 2] = gain
        problem[stage_1.STEP_NOMINAL : stage_1.STEP_NOMINAL + 2] = step
        problem[stage_1.TAU_NOMINAL], problem[stage_1.TAU_HIGH] = tau, most
        problem[stage_1.STEP_LOW + 1], problem[stage_1.STEP_HIGH + 1] = limits.width_min, limits.width_max
        problem[stage_1.ALPHA_STEP], problem[stage_1.ALPHA_DURATION] = 0.0, config.alpha_duration
        problem[stage_1.ALPHA_OFFSET] = config.alpha_offset
        here, sent = self._sent_ahead(way, speed, float(asked[DURATION]), float(offset[0]))
        best = True, math.inf
        chosen, cop, taken = (*step, tau), float(asked[COP]), -1
        for number in range(int(way[COUNT])):
            low, high = way[INTERVALS + 2 * number : INTERVALS + 2 * number + 2]
            aim = np.array([sent if number == here else offset[0], offset[1]])
            problem[stage_1.OFFSET_NOMINAL : stage_1.OFFSET_NOMINAL + 2] = aim
            problem[stage_1.STEP_LOW], problem[stage_1.STEP_HIGH], problem[stage_1.TAU_LOW] = low, high, least
            late = most < stage_1.solve_in_time(
                obs, problem, solution, omega, 1.0, config.swing_acceleration, config.double_support
            )
            u, found = solution[:2], solution[stage_1.SOLVED_TAU]
            missed = solution[stage_1.SOLVED_OFFSET : stage_1.SOLVED_OFFSET + 2] - aim
            growth = found * math.exp(omega * (config.touchdown_delay - elapsed)) - 1.0
            moved = self._moved_cop(asked, missed[0], growth)
            missed[0] -= (moved - asked[COP]) * growth
            cost = config.alpha_duration * (found - tau) ** 2 + config.alpha_offset * np.sum(missed**2)
            if way[TAKEN] not in {-1.0, number}:
                cost += config.alpha_offset * CHANGE**2
            if (late, cost) < best:
                best, chosen, cop, taken = (late, cost), (*u, found), moved, number
        way[TAKEN] = taken
        asked[STEP], asked[STEP + 1], asked[DURATION] = *chosen[:2], math.log(chosen[2]) / omega
        asked[COP] = cop

    def hold_step(self, way: Array, speed: float, obs: Array, held: Array, asked: Array) -> None:
        """Write the CoP into `asked` (7,) by which the DCM gets to a step that is committed, `held` (7,).

        The policy knows nothing of that step: its own CoP would stop the DCM where its own step was to be.
        """
        if way[COUNT] == 0.0 or way[TAKEN] < 0.0:
            return
        elapsed = float(obs[ELAPSED])
        gain = float(obs[DCM][0]) * math.exp(self._omega * (self._config.touchdown_delay - elapsed))
        offset = gain * math.exp(self._omega * asked[DURATION]) - float(asked[STEP])
        here, sent = self._sent_ahead(way, speed, float(asked[DURATION]), offset)
        tau = math.exp(self._omega * max(held[DURATION], elapsed + SOONEST))
        missed = gain * tau - float(held[STEP]) - (sent if way[TAKEN] == here else offset)
        growth = tau * math.exp(self._omega * (self._config.touchdown_delay - elapsed)) - 1.0
        asked[COP] = self._moved_cop(asked, missed, growth)

    def _moved_cop(self, asked: Array, missed: float, growth: float) -> float:
        """The CoP that moves the DCM at touchdown by -`missed`, within the sole [m]."""
        most = self._limits.cop_x_max
        return min(max(float(asked[COP]) + missed / growth, -most), most)

    def _sent_ahead(self, way: Array, speed: float, duration: float, offset: float) -> tuple[int, float]:
        """Number of the interval that the robot stands in, and the DCM offset [m] of a step that stays there.

        There is none, -1, where it stands in no interval.
        """
        pairs = way[INTERVALS : INTERVALS + 2 * int(way[COUNT])].reshape(-1, 2).tolist()
        here = next((i for i, (low, high) in enumerate(pairs) if low <= AT_HAND and high >= -AT_HAND), -1)
        sign = -1 if speed < 0.0 else 1
        if here < 0 or not 0 <= here + sign < len(pairs):
            return here, offset
        low, high = pairs[here + sign]
        lands = min(max(speed * duration, pairs[here][0]), pairs[here][1])
        goal = min(low + INSIDE, high) if sign > 0 else max(high - INSIDE, low)
        if way[SENDS] < 0.0:
            behind = way[BEHIND] + speed * (duration + self._nominal) - lands
            way[SENDS] = sign * behind > GOES_AT * abs(goal - lands)
        if way[SENDS] == 0.0:
            return here, offset
        sent = (goal - lands + offset) * math.exp(-self._omega * self._long)
        return here, sign * max(sign * sent, sign * offset)
