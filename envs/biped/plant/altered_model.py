"""Models of robots that are not as control believes: body, losses, floor, and how the physics is computed.

Mass, payload, trunk CoM, friction, slope, losses of the joints and collisions are in the robot's own model; a
slope tilts gravity, the floor stays level in the world's axes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import mujoco
import numpy as np

from ....controllers.model.robot import GRAVITY
from ...physics.stepping import simulated
from ...scenario.model_errors import BOUNDS, EXACT_MODEL, ModelErrors
from ...scenario.physics_options import PLAIN_PHYSICS, PhysicsOptions
from ..robots.compiled_robot import CompiledRobot
from .collisions import add_collisions
from .floor import add_tiles

OUTSIDE = {
    "delay": 0.0, "dcm_noise": 0.0, "joint_noise": 0.0, "motor_power": None, "bus_power": None,
    "continuous_torque": None,
}  # fmt: skip
ENUMS = {
    "integrator": ("mjtIntegrator", "mjINT_"),
    "solver": ("mjtSolver", "mjSOL_"),
    "cone": ("mjtCone", "mjCONE_"),
}


def altered_model(
    robot: CompiledRobot, errors: ModelErrors, physics: PhysicsOptions = PLAIN_PHYSICS
) -> mujoco.MjModel | None:
    """The robot with such errors, never modified; None where its own model has none of them."""
    inside = replace(errors, **OUTSIDE)
    if inside == EXACT_MODEL and physics == PLAIN_PHYSICS:
        return None
    if inside.floor_step > 0.0:
        inside = replace(inside, floor_step=BOUNDS["floor_step"][2])  # one model for tiles of all heights
    return _altered(robot, inside, physics)


@lru_cache(maxsize=8)
def _altered(robot: CompiledRobot, errors: ModelErrors, physics: PhysicsOptions) -> mujoco.MjModel:
    model = simulated(_shaped(robot, errors.floor_step > 0.0, errors.collisions))
    _alter_body(model, robot, errors)
    joints = [dof for dof in robot.indices.dof[6:] if dof >= 0]
    model.dof_frictionloss[joints] += errors.joint_friction
    model.dof_damping[joints] += errors.joint_damping
    model.dof_armature[joints] += errors.armature
    if errors.friction is not None:
        model.pair_friction[model.geom_bodyid[model.pair_geom1] == 0, :2] = errors.friction  # floor and tiles
        if errors.collisions:
            model.geom_friction[:, 0] = errors.friction
    downhill = np.array([-np.tan(errors.slope_forward), -np.tan(errors.slope_left), -1.0])
    if errors.slope_forward or errors.slope_left:
        model.opt.gravity[:] = GRAVITY / np.linalg.norm(downhill) * downhill
    _set_options(model, physics)
    return model


@lru_cache(maxsize=4)
def _shaped(robot: CompiledRobot, uneven: bool, collisions: bool) -> mujoco.MjModel:
    """The robot over tiles, with collisions, or both; never modified."""
    if not uneven and not collisions:
        return robot.model
    solid = robot.description.solid if collisions else None
    spec = (solid or robot.description.spec)()
    if uneven:
        add_tiles(spec, robot.plan)
    if collisions:
        add_collisions(spec, robot)
    return robot.compiled(spec)


def _alter_body(model: mujoco.MjModel, robot: CompiledRobot, errors: ModelErrors) -> None:
    """Scale all masses, load the trunk, and move its CoM."""
    offset = np.array(errors.trunk_com)
    for values in (model.body_mass, model.body_inertia, model.dof_armature):
        values *= 1.0 + errors.mass
    model.body_mass[robot.indices.trunk] += errors.payload
    model.body_ipos[robot.indices.trunk] += offset
    if errors.mass or errors.payload or offset.any():
        mujoco.mj_setConst(model, mujoco.MjData(model))  # what the compiler derives from masses


def _set_options(model: mujoco.MjModel, physics: PhysicsOptions) -> None:
    """Set what is given; the first entry of solref is a time constant for the soles' pairs and for geoms."""
    model.opt.timestep = physics.time_step
    for name, (enum, prefix) in ENUMS.items():
        if (value := getattr(physics, name)) is not None:
            setattr(model.opt, name, getattr(getattr(mujoco, enum), prefix + value.upper()).value)
    if physics.impratio is not None:
        model.opt.impratio = physics.impratio
    if physics.contact_time is not None:
        model.pair_solref[:, 0] = physics.contact_time
        model.geom_solref[:, 0] = physics.contact_time
