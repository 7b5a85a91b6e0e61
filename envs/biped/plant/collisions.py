"""Legs, arms and trunk that collide with each other and with the floor.

The robot's own model has contacts of the soles, and of feet and shanks with one another, as explicit pairs,
which stay as they are. Here all other shapes of its bodies take part, too. Those of a body and of its parent
in the tree never meet, as MuJoCo has it, and neither do those that touch while the robot stands: shapes that
collide are rounder than the robot, and are in each other about its joints.
"""

from __future__ import annotations

import mujoco

from ..robots.compiled_robot import CompiledRobot

COLLIDES = 1  # bit of contype and conaffinity


def add_collisions(spec: mujoco.MjSpec, robot: CompiledRobot) -> None:
    """Let all shapes of a spec collide; of the bodies of the feet only the soles, not what dresses them."""
    soles = robot.plan.sole_boxes
    feet = {spec.geom(name).parent.name for name in soles}
    pair = spec.pairs[0]
    for geom in spec.geoms:
        if geom.parent.name in feet and geom.name not in soles:
            continue
        geom.contype = geom.conaffinity = COLLIDES
        geom.solref = pair.solref  # as hard as the soles
    for first, second in touching(robot, robot.compiled(spec)):
        spec.add_exclude(bodyname1=first, bodyname2=second)


def touching(robot: CompiledRobot, model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Names of bodies whose shapes touch in the robot's reference posture, the world's left out."""
    data = mujoco.MjData(model)
    data.qpos[:] = robot.in_reference_posture().qpos
    mujoco.mj_forward(model, data)
    bodies = model.geom_bodyid[data.contact.geom]
    pairs = {tuple(sorted(pair)) for pair in bodies.tolist() if min(pair) > 0}
    return [(model.body(first).name, model.body(second).name) for first, second in sorted(pairs)]
