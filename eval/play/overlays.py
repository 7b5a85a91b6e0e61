"""What is drawn on the floor under a robot: points, regions and polygons in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from ...controllers.model.capturability import recoverable_offset
from ...controllers.model.frame import canonical_frame, point_in_world
from ...controllers.model.gait_box import STEP
from ...controllers.model.observation import (
    ELAPSED,
    TRUNK_ANGLE,
    TRUNK_RATE,
    WORLD_CMP,
    WORLD_COP,
    WORLD_DCM,
)
from ...controllers.whole_body.kinematics import FOOT_BODY, Array, sole_position
from ...envs.biped.env import BipedEpisodes
from ...envs.episode.told import LOADED

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Overlays:
    """Places on the floor, world axes [m]; polygons go round counter-clockwise or clockwise, not closed."""

    dcm: Array  # (2,)
    cop: Array  # (2,)
    cmp: Array  # (2,)
    foothold: Array  # (4, 2) the sole that the swing foot will set down
    step_box: Array  # (4, 2) where the centre of that sole may be
    capture_region: Array  # (4, 2) where the DCM may be so that the planner's limits still allow recovery
    support: Array  # (k, 2) hull of the soles that carry load; k is 0 in the air


def overlays_of(episodes: BipedEpisodes) -> Overlays:
    """The overlays of robot 0."""
    core, limits = episodes.core, episodes.limits
    world, truth = core.world[0], core.truth[0]
    offset = recoverable_offset(
        episodes.robot, limits, float(truth[ELAPSED]), truth[TRUNK_ANGLE], truth[TRUNK_RATE]
    )
    low = np.array([limits.length_min, limits.width_min])
    high = np.array([limits.length_max, limits.width_max])
    planned, half = core.gait.plan[0, STEP : STEP + 2], np.array(core.body.half_sole)
    return Overlays(
        dcm=world[WORLD_DCM : WORLD_DCM + 2].copy(),
        cop=world[WORLD_COP : WORLD_COP + 2].copy(),
        cmp=world[WORLD_CMP : WORLD_CMP + 2].copy(),
        foothold=_rectangle(episodes, planned - half, planned + half),
        step_box=_rectangle(episodes, low, high),
        capture_region=_rectangle(episodes, offset.low, offset.high),
        support=support_polygon(episodes),
    )


def _rectangle(episodes: BipedEpisodes, low: Array, high: Array) -> Array:
    """Corners in the world, (4, 2), of a box in the canonical frame."""
    gait = episodes.core.gait
    stance = int(gait.stance[0])
    sole = sole_position(episodes.core.true_state(0), 0, stance)
    frame = canonical_frame(float(gait.heading[0]), stance)
    middle, half = (low + high) / 2, (high - low) / 2
    corners = middle + CORNERS * half
    return np.array([point_in_world(frame, sole[0], sole[1], float(x), float(y)) for x, y in corners])


def support_polygon(episodes: BipedEpisodes) -> Array:
    """Hull (k, 2) of the corners of the soles that carry load, as they lie."""
    core, points = episodes.core, []
    state, half = core.true_state(0), np.array(core.body.half_sole)
    for leg, loaded in enumerate(episodes.told()[0][LOADED] > 0.0):
        if loaded:
            axes = state.xmat[0, FOOT_BODY[leg]].reshape(3, 3)[:2, :2]
            points.append(np.array(sole_position(state, 0, leg)[:2]) + (CORNERS * half) @ axes.T)
    if not points:
        return np.empty((0, 2))
    corners = np.concatenate(points)
    return corners[ConvexHull(corners).vertices]
