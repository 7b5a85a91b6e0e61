"""CoP and CMP of a robot that no controller asks for a wrench: from the forces that the floor gives it."""

from __future__ import annotations

from ...controllers.compiled.kernels import njit
from ...controllers.compiled.vector_3 import to_world, vector_at, vector_of
from ...controllers.model.observation import WORLD_CMP, WORLD_COP
from ...controllers.whole_body.gait_machine import FLOOR, Gait
from ...controllers.whole_body.kinematics import PELVIS, Array, Physics

LEAST = 1.0  # vertical force [N] below which the robot counts as in flight


@njit(cache=True)
def write_floor_points(judged: Physics, gait: Gait, k: int, force: Array, world: Array) -> None:
    """Write CoP and CMP of robot k in the world, (6,) [m]; in flight they stay as they are.

    With F and M the force and the moment of all contacts about the base's origin o, the moment about a point
    of the floor, dz from o, is vertical at

        o + ((dz F_x - M_y) / F_z, (dz F_y + M_x) / F_z, dz),

    and the CMP is where the line along F through the CoM meets the floor.

    Args:
        judged: true state of all robots.
        gait: of which the height of the floor.
        k: the robot.
        force: (20,) generalised forces of the contacts; of the base F in the world and M in its own axes.
        world: written.
    """
    if force[2] < LEAST:
        return
    origin, com = vector_at(judged.xpos, k, PELVIS), vector_at(judged.com, k, 0)
    moment = to_world(judged.xmat, k, PELVIS, vector_of(force, 3))
    drop, fall = gait.height[k, FLOOR] - origin[2], gait.height[k, FLOOR] - com[2]
    world[WORLD_COP] = origin[0] + (drop * force[0] - moment[1]) / force[2]
    world[WORLD_COP + 1] = origin[1] + (drop * force[1] + moment[0]) / force[2]
    world[WORLD_CMP] = com[0] + fall * force[0] / force[2]
    world[WORLD_CMP + 1] = com[1] + fall * force[1] / force[2]
