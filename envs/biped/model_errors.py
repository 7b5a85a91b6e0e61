"""Model errors of n bipeds: models of their own, late torques, noisy joints, noisy observations.

What is true of body, joints and floor is in the robot's own model (`altered_model`): mass, payload, trunk
CoM, friction, slope, losses of the joints, collisions. A slope tilts gravity, the floor stays level in the
world's axes. What gait machine, whole-body control and observation read of the robot's kinematics, mass
matrix and bias comes from the nominal model at the measured joint state (`compute_nominal`); loads and forces
of the contacts, and the pose of the pelvis over the floor, are measured as they are.
"""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
from numba.np.numpy_support import carray

from ...controllers.array_table import Floats2, Floats3, Ints1, Ints2
from ...controllers.errors import InvalidValueError, PushRecoveryError, shown
from ...controllers.jit import njit
from ...controllers.joint_control import own_joint
from ...controllers.math3 import stack_floats
from ...controllers.model.observation import COM_VELOCITY, PUSH_ESTIMATE
from ...controllers.model.robot import GRAVITY
from ...controllers.validation import require_number
from ...controllers.whole_body.kinematics import NU, NV, WAIST_DOF, Array, Physics
from ..robots.compiled_robot import CompiledRobot
from ..robots.indices import MISSING
from ..scenario.model_errors import (
    CONTROL_STEP,
    EXACT_MODEL,
    PLAIN_PHYSICS,
    ModelErrors,
    PhysicsOptions,
)
from ..scenario.noise import (
    JOINT_CHANNEL,
    MOTION_NOISES,
    VELOCITY_NOISE,
    add_motion_noise,
    counter_seed,
    motion_noise,
    normal_pair,
)
from ..scenario.scenario import Scenario
from ..scenario.terrain import Pattern, Terrain
from ..simulation import Handles, advance_measured, compute_nominal, show_measured, show_unmeasured, simulated
from .actuators import CONTINUOUS, EACH, INERTIA, TOGETHER, limit_torques
from .floor import has_tiles

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

COLLIDES = 1  # bit of contype and conaffinity


def add_collisions(spec: mujoco.MjSpec, robot: CompiledRobot) -> None:
    """Let all shapes of a spec collide; of the bodies of the feet only the soles, not what dresses them.

    The robot's own model has contacts of the soles, and of feet and shanks with one another, as explicit
    pairs, which stay as they are. Shapes of a body and of its parent in the tree never meet, as MuJoCo has
    it, and neither do those that touch while the robot stands: shapes that collide are rounder than the
    robot, and are in each other about its joints. So are a foot and its own shank at the ends of the ankle's
    ranges, which alone keep them apart, whether the ankle's two axes have a link between them or not.
    """
    soles = robot.plan.sole_boxes
    feet = {spec.geom(name).parent.name for name in soles}
    pair = spec.pairs[0]
    for geom in spec.geoms:
        if geom.parent.name in feet and geom.name not in soles:
            continue
        geom.contype = geom.conaffinity = COLLIDES
        geom.solref = pair.solref  # as hard as the soles
    ankles = (tuple(robot.model.body(part).name for part in leg[1:]) for leg in robot.indices.links)
    for first, second in sorted({*ankles, *touching(robot, robot.compiled(spec))}):
        spec.add_exclude(bodyname1=first, bodyname2=second)


def touching(robot: CompiledRobot, model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Names of bodies whose shapes touch in the robot's reference posture, the world's left out."""
    data = mujoco.MjData(model)
    data.qpos[:] = robot.in_reference_posture().qpos
    mujoco.mj_forward(model, data)
    bodies = model.geom_bodyid[data.contact.geom]
    pairs = {tuple(sorted(pair)) for pair in bodies.tolist() if min(pair) > 0}
    return [(model.body(first).name, model.body(second).name) for first, second in sorted(pairs)]


OUTSIDE = {  # errors that are in no model; terrain goes a way of its own
    "delay": 0.0, "dcm_noise": 0.0, "joint_noise": 0.0, "motor_power": None, "bus_power": None,
    "continuous_torque": None, "slope_forward": 0.0, "slope_left": 0.0, "floor_step": 0.0, "terrain": None,
    "floor_known": False,
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
    inside, terrains = replace(errors, **OUTSIDE), tuple(part.modelled() for part in errors.terrains)
    if inside == EXACT_MODEL and physics == PLAIN_PHYSICS and not terrains:
        return None
    return _altered(robot, inside, physics, terrains, errors.tilt)


@lru_cache(maxsize=8)
def _altered(
    robot: CompiledRobot,
    errors: ModelErrors,
    physics: PhysicsOptions,
    terrains: tuple[Terrain, ...],
    tilt: tuple[float, float],
) -> mujoco.MjModel:
    shapes = tuple(part for part in terrains if part.shapes)
    model = simulated(_shaped(robot, shapes, errors.collisions))
    _alter_body(model, robot, errors)
    joints = [dof for dof in robot.indices.dof[6:] if dof >= 0]
    model.dof_frictionloss[joints] += errors.joint_friction
    model.dof_damping[joints] += errors.joint_damping
    model.dof_armature[joints] += errors.armature
    if errors.friction is not None:
        model.pair_friction[model.geom_bodyid[model.pair_geom1] == 0, :2] = errors.friction  # of the floor
        if errors.collisions:
            model.geom_friction[:, 0] = errors.friction
    downhill = np.array([-np.tan(tilt[0]), -np.tan(tilt[1]), -1.0])
    if any(tilt):
        model.opt.gravity[:] = GRAVITY / np.linalg.norm(downhill) * downhill
    _set_options(model, physics)
    return model


@lru_cache(maxsize=4)
def _shaped(robot: CompiledRobot, terrains: tuple[Terrain, ...], collisions: bool) -> mujoco.MjModel:
    """The robot over terrains, with collisions, or both; never modified.

    Raises:
        InvalidValueError: a terrain of one's own can't be added, or has no height where the robot begins.
    """
    if not terrains and not collisions:
        return robot.model
    solid = robot.description.solid if collisions else None
    spec = (solid or robot.description.spec)()
    try:
        for terrain in terrains:
            terrain.shape(spec, robot.plan.sole_boxes)
            height = terrain.height(0.0, 0.0, Pattern())
            require_number(f"{type(terrain).__name__}.height [m] at the start", height)
    except PushRecoveryError:
        raise
    except Exception as error:  # the class of a terrain decides for itself what it raises
        names = ", ".join(type(terrain).__name__ for terrain in terrains)
        raise InvalidValueError(f"terrain {names} can't be added to the model: {shown(error)}") from error
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


LONGEST_DELAY = 25  # physics steps
RATE_NOISE = 50.0  # deviation of a joint's rate over that of its angle [1/s]
DCM_NOISE, JOINT_NOISE = 0, 1  # columns of `RobotErrors.noise` [m], [rad]
STEPS, WHOLE = 0, 1  # columns of `RobotErrors.fine`
# Errors with which the robot's kinematics, mass matrix and bias are what control takes them for; so they are
# on any terrain but one that tilts gravity
SAME_AS_NOMINAL = {
    "friction", "floor_step", "slope_forward", "slope_left", "terrain", "joint_friction", "joint_damping",
    "collisions", "floor_known", "motor_power", "bus_power", "continuous_torque", "delay", "dcm_noise",
}  # fmt: skip

_EXACT, _PUSH = COM_VELOCITY.stop, PUSH_ESTIMATE.start  # from here to there no noise of the CoM is seen


class RobotErrors(NamedTuple):
    """Errors of n robots as the compiled loop reads them."""

    physical: Ints1  # (n,) 1 where a physics step is more than a plain one
    mismatched: Ints1  # (n,) 1 where kinematics or mass matrix differ from the nominal robot's
    delay: Ints1  # (n,) of the torques [physics steps]
    noise: Floats2  # (n, 2) deviation of the DCM [m] and of the joints [rad]
    seed: Ints1  # (n,)
    period: Ints1  # (n,) planning periods since reset
    step: Ints1  # (n,) physics steps since reset, counted where `physical`
    torques: Floats3  # (n, LONGEST_DELAY + 1, 14) computed last, a ring [N m]
    motors: Floats3  # (n, 3, 14) of the drives, see `actuators.LARGEST`
    power: Floats2  # (n, 3) most that a motor gives, and all of them [W]; share of its torque that lasts
    warmth: Floats2  # (n, 14) of the windings
    fine: Ints2  # (n, 2) physics steps in one of control; 1 where each is a whole mj_step, as RK4 needs


def no_errors(n: int) -> RobotErrors:
    """Arrays of n robots without errors."""
    return RobotErrors(
        physical=np.zeros(n, np.int64), mismatched=np.zeros(n, np.int64), delay=np.zeros(n, np.int64),
        noise=np.zeros((n, 2)), seed=np.zeros(n, np.int64), period=np.zeros(n, np.int64),
        step=np.zeros(n, np.int64), torques=np.zeros((n, LONGEST_DELAY + 1, NU)),
        motors=np.zeros((n, 3, NU)), power=np.zeros((n, 3)), warmth=np.zeros((n, NU)),
        fine=np.zeros((n, 2), np.int64),
    )  # fmt: skip


def check_biped_errors(errors: ModelErrors) -> None:
    """Raise InvalidValueError for a delay that is no whole number of physics steps."""
    if abs(errors.delay / CONTROL_STEP - round(errors.delay / CONTROL_STEP)) > 1e-6:
        raise InvalidValueError(
            f"ModelErrors.delay [s] must be a multiple of {CONTROL_STEP:g} (the biped's control step) up to "
            f"{LONGEST_DELAY * CONTROL_STEP:g}, got {errors.delay:g}"
        )


def assign_errors(
    table: RobotErrors, k: int, scenario: Scenario, robot: CompiledRobot
) -> mujoco.MjModel | None:
    """Give robot k the errors of a scenario, at its beginning; returns a model where it needs another.

    Raises:
        InvalidValueError: the robot can't have them; nothing has changed then.
    """
    errors, physics = scenario.errors, scenario.physics
    exact = errors == EXACT_MODEL and physics == PLAIN_PHYSICS
    check_biped_errors(errors)
    model = None if exact else altered_model(robot, errors, physics)
    for field in table:
        field[k] = 0
    table.power[k], table.fine[k, STEPS] = (math.inf, math.inf, 1.0), 1
    table.motors[k, :INERTIA], table.motors[k, INERTIA] = robot.motors, joint_inertias(robot, robot.model)
    if exact:
        return None
    table.mismatched[k] = (
        not set(errors.names) <= SAME_AS_NOMINAL or errors.joint_noise > 0.0 or any(errors.tilt)
    )
    table.delay[k] = round(errors.delay / CONTROL_STEP)
    limits = {EACH: errors.motor_power, TOGETHER: errors.bus_power, CONTINUOUS: errors.continuous_torque}
    for column, limit in limits.items():
        if limit is not None:
            table.power[k, column] = limit
    if model is not None:
        table.motors[k, INERTIA] = joint_inertias(robot, model) + errors.armature
    table.fine[k] = physics.steps, physics.integrator == "rk4"
    finely = physics.steps > 1 or table.fine[k, WHOLE] != 0
    limited = any(limit is not None for limit in limits.values())
    table.physical[k] = table.mismatched[k] or table.delay[k] > 0 or finely or limited
    table.noise[k] = errors.dcm_noise, errors.joint_noise
    table.seed[k] = counter_seed(scenario.noise_seed)
    return copy.copy(model) if model is not None and has_tiles(model) else model  # its tiles move


def joint_inertias(robot: CompiledRobot, model: mujoco.MjModel) -> Array:
    """Inertia of every joint of control, all others held, in the reference posture, (14,) [kg m^2].

    Of the model's own armature, not what is added to it; 0 for a joint that the robot does not have.
    """
    return np.array([0.0 if dof == MISSING else model.dof_M0[dof] for dof in robot.indices.dof[-NU:]])


@njit(cache=True)
def delay_torque(errors: RobotErrors, k: int, torque: Array) -> None:
    """Exchange the torques (14,) just computed for those of `delay` physics steps ago.

    Until those of the first step arrive, the robot acts as if it had asked for them all along.
    """
    ring, now = errors.torques[k], errors.step[k] % errors.torques.shape[1]
    then = (errors.step[k] - errors.delay[k]) % errors.torques.shape[1]
    for i in range(torque.shape[0]):
        if errors.step[k] == 0:
            ring[:, i] = torque[i]
        ring[now, i] = torque[i]
        torque[i] = ring[then, i]


@njit(cache=True)
def measure_joints(phys: Physics, errors: RobotErrors, k: int, first_side: int) -> None:
    """Add noise to angles and rates of all 14 joints.

    Legs are counted from the stance leg of step 0, and mirrored with it.
    """
    deviation = errors.noise[k, JOINT_NOISE]
    for count in range(NU):
        own = own_joint(count, first_side)
        sign = phys.mirror[own] if first_side == 1 else 1.0
        angle, rate = normal_pair(errors.seed[k], errors.step[k], JOINT_CHANNEL + count)
        dof = WAIST_DOF + own
        phys.qpos[k, dof + 1] += sign * deviation * angle
        phys.qvel[k, dof] += sign * RATE_NOISE * deviation * rate


@njit(cache=True)
def move(phys: Physics, errors: RobotErrors, k: int, handles: Handles, force: Array, dt: float) -> None:
    """One control step of the physics of a robot with errors: late torques, what the drives give of them.

    The torques asked for are held; the drives answer in every physics step to the speed that they then have.

    Args:
        phys: where the robot truly is, and the torques asked for, which are written over.
        errors: of all robots.
        k: the robot.
        handles: of the simulations.
        force: (20,) its row of the forces of contacts, which becomes their mean over the physics steps.
        dt: step of control [s].
    """
    if errors.delay[k] > 0:
        delay_torque(errors, k, phys.ctrl[k, :NU])
    errors.step[k] += 1
    if errors.noise[k, JOINT_NOISE] > 0.0:
        show_measured(handles, k)  # a drive turns as fast as it does, not as is measured
    asked, total = carray(stack_floats(14), (NU,)), carray(stack_floats(20), (NV,))
    asked[:], total[:] = phys.ctrl[k, :NU], 0.0
    steps, whole = errors.fine[k, STEPS], errors.fine[k, WHOLE] != 0
    for _ in range(steps):
        phys.ctrl[k, :NU] = asked
        limit_torques(phys, k, errors.motors, errors.power, errors.warmth, phys.ctrl[k], dt / steps)
        advance_measured(handles, k, whole)
        for i in range(NV):
            total[i] += force[i]
    for i in range(NV):
        force[i] = total[i] / steps


@njit(cache=True)
def advance_with_errors(
    phys: Physics, errors: RobotErrors, k: int, first_side: int, handles: Handles, force: Array, dt: float
) -> None:
    """One control step of a robot with errors: its own physics, then what is believed of it."""
    move(phys, errors, k, handles, force, dt)
    if errors.mismatched[k] == 0:
        show_unmeasured(handles, k)
        return
    if errors.noise[k, JOINT_NOISE] > 0.0:
        measure_joints(phys, errors, k, first_side)
    compute_nominal(handles, k)


@njit(cache=True)
def write_seen(
    errors: RobotErrors, k: int, steps: int, span: float, omega: float, truth: Array, seen: Array
) -> None:
    """Write the observation (36,) that the policy sees of robot k from the one without noise (36,).

    `span` is the time that the push estimate covers [s]: it is the change of the velocity, so it is seen off
    by (n_v - n_v of the period before) / (omega^2 span). A robot that rests is seen as it was.
    """
    deviation = errors.noise[k, DCM_NOISE]
    rests = span == 0.0 and errors.period[k] > 0
    for i in range(truth.shape[0]):
        if deviation == 0.0 or not rests or _EXACT <= i < _PUSH:
            seen[i] = truth[i]
    if deviation == 0.0 or rests:
        return
    noise, before = np.empty(MOTION_NOISES), np.empty(MOTION_NOISES)
    motion_noise(errors.seed[k], errors.period[k], deviation, omega, steps, noise)
    add_motion_noise(noise, omega, seen)
    if span > 0.0:
        motion_noise(errors.seed[k], errors.period[k] - 1, deviation, omega, steps, before)
        for axis in range(2):
            j = VELOCITY_NOISE + axis
            seen[_PUSH + axis] += (noise[j] - before[j]) / (omega * omega * span)
