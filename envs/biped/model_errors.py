"""Model errors of n bipeds: models of their own, late torques, noisy joints, noisy observations.

What is true of body, joints and floor is in the robot's own model (`plant.altered_model`). What gait machine,
whole-body control and observation read of the robot's kinematics, mass matrix and bias comes from the nominal
model at the measured joint state (`believe`); loads and forces of the contacts, and the pose of the pelvis
over the floor, are measured as they are.
"""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import mujoco
import numpy as np

from ...controllers.compiled.array_table import Floats2, Floats3, Ints1, Ints2
from ...controllers.compiled.kernels import njit
from ...controllers.errors import InvalidValueError
from ...controllers.estimation.leg_odometry import listen_to_soles
from ...controllers.model.observation import COM_VELOCITY, PUSH_ESTIMATE
from ...controllers.whole_body.kinematics import LEG_DOF, NU, WAIST_DOF, Array, Physics
from ..physics.stepping import (
    Handles,
    advance_finely,
    advance_measured,
    believe,
    show_unmeasured,
)
from ..scenario.model_errors import EXACT_MODEL, ModelErrors
from ..scenario.noise import counter_seed, normal_pair
from ..scenario.observation_noise import (
    JOINT_CHANNEL,
    MOTION_NOISES,
    VELOCITY_NOISE,
    add_motion_noise,
    motion_noise,
)
from ..scenario.physics_options import CONTROL_STEP, PLAIN_PHYSICS
from ..scenario.scenario import Scenario
from ..sensing.onboard import OnboardArrays, sense
from .plant.altered_model import altered_model
from .plant.power import limit_power
from .robots.compiled_robot import CompiledRobot

LONGEST_DELAY = 25  # physics steps
RATE_NOISE = 50.0  # deviation of a joint's rate over that of its angle [1/s]
DCM_NOISE, JOINT_NOISE = 0, 1  # columns of `RobotErrors.noise` [m], [rad]
EACH, TOGETHER = 0, 1  # columns of `RobotErrors.power` [W]
STEPS, WHOLE = 0, 1  # columns of `RobotErrors.fine`
BELIEVED = {  # errors with which the robot's kinematics, mass matrix and bias are what control takes them for
    "friction", "floor_step", "joint_friction", "joint_damping", "collisions", "motor_power", "bus_power",
    "delay", "dcm_noise",
}  # fmt: skip

_EXACT, _PUSH = COM_VELOCITY.stop, PUSH_ESTIMATE.start  # from here to there no noise of the CoM is seen


class RobotErrors(NamedTuple):
    """What the compiled loop needs of the errors of n robots."""

    physical: Ints1  # (n,) 1 where a physics step is more than a plain one
    believes: Ints1  # (n,) 1 where what control takes for the robot is not what the physics has
    delay: Ints1  # (n,) of the torques [physics steps]
    noise: Floats2  # (n, 2) deviation of the DCM [m] and of the joints [rad]
    seed: Ints1  # (n,)
    period: Ints1  # (n,) planning periods since reset
    step: Ints1  # (n,) physics steps since reset, counted where `physical`
    torques: Floats3  # (n, LONGEST_DELAY + 1, 14) computed last, a ring [N m]
    power: Floats2  # (n, 2) most that a motor gives, and all of them [W]
    fine: Ints2  # (n, 2) physics steps in one of control; 1 where each is a whole mj_step, as RK4 needs


def no_errors(n: int) -> RobotErrors:
    """Arrays of n robots without errors."""
    return RobotErrors(
        physical=np.zeros(n, np.int64), believes=np.zeros(n, np.int64), delay=np.zeros(n, np.int64),
        noise=np.zeros((n, 2)), seed=np.zeros(n, np.int64), period=np.zeros(n, np.int64),
        step=np.zeros(n, np.int64), torques=np.zeros((n, LONGEST_DELAY + 1, NU)),
        power=np.zeros((n, 2)), fine=np.zeros((n, 2), np.int64),
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
    """Give robot k the errors of a scenario, at its beginning; returns a model where it needs another."""
    errors, physics = scenario.errors, scenario.physics
    for field in table:
        field[k] = 0
    table.power[k] = math.inf
    if errors == EXACT_MODEL and physics == PLAIN_PHYSICS:
        return None
    check_biped_errors(errors)
    model = altered_model(robot, errors, physics)
    table.believes[k] = not set(errors.names) <= BELIEVED or errors.joint_noise > 0.0
    table.delay[k] = round(errors.delay / CONTROL_STEP)
    limits = (math.inf if limit is None else limit for limit in (errors.motor_power, errors.bus_power))
    table.power[k] = tuple(limits)
    table.fine[k] = physics.steps, physics.integrator == "rk4"
    own_way = physics.steps > 1 or table.fine[k, WHOLE] != 0 or np.isfinite(table.power[k]).any()
    table.physical[k] = table.believes[k] or table.delay[k] > 0 or own_way
    table.noise[k] = errors.dcm_noise, errors.joint_noise
    table.seed[k] = counter_seed(scenario.noise_seed)
    return copy.copy(model) if errors.floor_step > 0.0 else model  # its tiles move


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
def measure_joint(phys: Physics, errors: RobotErrors, k: int, dof: int, channel: int, sign: float) -> None:
    """Add noise to the angle of a joint and to its rate."""
    angle, rate = normal_pair(errors.seed[k], errors.step[k], channel)
    phys.qpos[k, dof + 1] += sign * errors.noise[k, JOINT_NOISE] * angle
    phys.qvel[k, dof] += sign * RATE_NOISE * errors.noise[k, JOINT_NOISE] * rate


@njit(cache=True)
def measure_joints(phys: Physics, errors: RobotErrors, k: int, first_side: int) -> None:
    """Add noise to all 14 joints; legs are counted from the stance leg of step 0, and mirrored with it."""
    for j in range(2):
        sign = phys.mirror[j] if first_side == 1 else 1.0
        measure_joint(phys, errors, k, WAIST_DOF + j, JOINT_CHANNEL + j, sign)
    for leg in range(2):
        channel = JOINT_CHANNEL + 2 + (6 if leg != first_side else 0)
        for j in range(6):
            sign = phys.mirror[2 + j] if first_side == 1 else 1.0
            measure_joint(phys, errors, k, LEG_DOF[leg] + j, channel + j, sign)


@njit(cache=True)
def move(phys: Physics, errors: RobotErrors, k: int, handles: Handles, force: Array) -> None:
    """One control step of the physics of a robot with errors: late torques, what the drives can give.

    Args:
        phys: where the robot truly is, and the torques asked for, which are written over.
        errors: of all robots.
        k: the robot.
        handles: of the simulations.
        force: (20,) its row of the forces of contacts, see `advance_finely`.
    """
    if errors.delay[k] > 0:
        delay_torque(errors, k, phys.ctrl[k])
    if min(errors.power[k, EACH], errors.power[k, TOGETHER]) < math.inf:
        limit_power(phys, k, phys.ctrl[k], errors.power[k, EACH], errors.power[k, TOGETHER])
    errors.step[k] += 1
    if errors.fine[k, STEPS] > 1 or errors.fine[k, WHOLE] != 0:
        advance_finely(handles, k, errors.fine[k, STEPS], errors.fine[k, WHOLE] != 0, force)
    else:
        advance_measured(handles, k)


@njit(cache=True)
def advance_with_errors(
    phys: Physics, errors: RobotErrors, k: int, first_side: int, handles: Handles, force: Array
) -> None:
    """One control step of a robot with errors: its own physics, then what is believed of it."""
    move(phys, errors, k, handles, force)
    if errors.believes[k] == 0:
        show_unmeasured(handles, k)
        return
    if errors.noise[k, JOINT_NOISE] > 0.0:
        measure_joints(phys, errors, k, first_side)
    believe(handles, k)


@njit(cache=True)
def advance_onboard(
    phys: Physics, errors: RobotErrors, k: int, handles: Handles, arrays: OnboardArrays, dt: float
) -> None:
    """One control step of a robot that knows of itself what its own sensors tell."""
    move(arrays.judged, errors, k, arrays.handles, arrays.judged_contacts.force[k])
    show_unmeasured(arrays.handles, k)
    sense(phys, arrays, k, errors.step[k], dt)
    if errors.noise[k, JOINT_NOISE] > 0.0:
        measure_joints(phys, errors, k, arrays.sensors.side[k])
    believe(handles, k)
    listen_to_soles(arrays.estimate, k, phys, dt)


@njit(cache=True)
def show(
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
