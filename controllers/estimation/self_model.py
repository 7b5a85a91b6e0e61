"""What a biped learns of itself and its floor while it walks: weight, a steady force on it, friction.

All comes from what joint encoders, inertial sensor and force sensors in the feet tell, and from the forces
that whole-body control itself expects. With the impulse J of the floor and the velocity v of the CoM over a
planning period,

    mass = sum J_z / sum (g dt + v_z - v_z,before)              sums that forget with MEMORY,

over the model's mass, is the factor of its mass matrix and its bias, which is exact where every body is off
by the same share. And where whole-body control expected the impulse J_w of the floor,

    drift = (m (v - v_before) - J_w) / (m omega^2 dt)   [m]

is where a CMP would have to lie, seen from the foot, to push like all that was not foreseen: a slope, a CoM
that is elsewhere, torques that come late. Its mean over two steps, weighted with exp(-omega t) as the DCM at
their ends weighs it, is taken off the point that the pendulum stands on: xi + drift moves on a slope as xi
does on the level, so the planner is shown CoM and DCM moved by it.

The push estimate is the change of a velocity: 1 cm of noise in the DCM makes 0.3 m of it. How far it jumps
from one period to the next, in the median, tells its noise; a push that does not rise above it is not shown.

How much friction whole-body control may count on, slides and holding soles tell (`grip`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled.array_table import Floats1, Floats2, Floats3
from ..compiled.kernels import njit
from ..compiled.vector_3 import subtract, vector_of
from ..model.frame import canonical, heading_frame, side_sign
from ..model.observation import COM, DCM, PUSH_ESTIMATE
from ..model.robot import GRAVITY
from ..whole_body.gait_machine import Gait, GaitSettings
from ..whole_body.kinematics import NU, Array, Physics, sole_position
from ..whole_body.mass_matrix import com_velocity
from .grip import MOST, SIZE, feel_grip
from .joint_losses import BEFORE
from .joint_losses import SIZE as JOINT_SIZE
from .observe import Contacts, external_force

MEMORY = 0.5  # of the mass [s]
MASS_RANGE = (0.5, 2.0)  # of the factor
MASS_KNOWN = 0.01  # a mass this near to the model's is left at the model's
PUSH_MEANS = (0.05, 0.5)  # time constants of two running means of the external force [s]
PUSHED = 0.04  # a step in which they differ by more teaches nothing [m]
DRIFT_GAIN = 0.5  # share of the difference that is taken over at each touchdown
DRIFT_CHANGE = 0.04  # largest difference [m]
DRIFT_MAX = 0.1  # [m]
DRIFT_KNOWN = 0.002  # a smaller one is left out [m]
NOISE_RATE = 0.01  # change of the push estimate's noise in a period [m]
NOISE_KNOWN = 0.03  # less counts as none [m]
NOISE_SHARE = 2.0  # of the noise that a push must rise above

STANDING = 0.03  # a sole that has stood for less may still slide from its landing [s]

# Columns of `SelfModel.step`; of a pair (x, y) the first one
DRIFT = 0  # pair, sum of the drift
WEIGHT = 2  # sum of its weights
LAST = 3  # pair, mean drift of the last step
NUMBER = 5  # of the step
QUIET = 6  # how many steps in a row were without a push
PUSH = 7  # two pairs, running means of the external force
STEP_SIZE = 11
# Columns of `SelfModel.felt`
FELT = 0  # pair, push estimate of the last period, heading frame [m]
JUMP = 2  # median of its jumps [m]

_DCM, _COM, _PUSH = DCM.start, COM.start, PUSH_ESTIMATE.start


class SelfModel(NamedTuple):
    """What n robots have learned."""

    mass: Floats1  # (n,) over the model's
    weighed: Floats2  # (n, 2) vertical impulse of the floor, and that of the model's mass [N s]
    asked: Floats2  # (n, 2) impulse expected of the floor since the last observation, world axes [N s]
    drift: Floats2  # (n, 2) in the heading frame [m]
    step: Floats2  # (n, STEP_SIZE) of the step that goes on and the last one
    felt: Floats2  # (n, 3) what the push estimate was, and how it jumps
    grip: Floats1  # (n,) friction that whole-body control may count on
    stood: Floats2  # (n, grip.SIZE) where the stance sole stood, and how it slides
    joints: Floats3  # (n, 14, joint_losses.SIZE) friction and rotor of each joint
    before: Floats2  # (n, joint_losses.BEFORE) the swing leg at the beginning of the physics step


def empty_self_model(n: int) -> SelfModel:
    """Arrays of n robots."""
    return SelfModel(
        np.ones(n),
        np.zeros((n, 2)),
        np.zeros((n, 2)),
        np.zeros((n, 2)),
        np.zeros((n, STEP_SIZE)),
        np.zeros((n, 3)),
        np.ones(n),
        np.zeros((n, SIZE)),
        np.zeros((n, NU, JOINT_SIZE)),
        np.zeros((n, BEFORE)),
    )


def forget(known: SelfModel, k: int, s: GaitSettings, friction: float) -> None:
    """Let robot k begin anew with its model, which counts for MEMORY seconds of weighing."""
    known.mass[k] = 1.0
    known.weighed[k] = s.mass * GRAVITY * MEMORY
    known.asked[k] = known.drift[k] = 0.0
    known.step[k] = known.felt[k] = 0.0
    known.step[k, QUIET] = 1.0  # the first step counts
    known.grip[k] = friction
    known.stood[k] = 0.0
    known.joints[k] = known.before[k] = 0.0
    known.stood[k, MOST] = friction


@njit(cache=True, forceinline=True)
def scale_mass(known: SelfModel, k: int, phys: Physics) -> None:
    """Give mass matrix and bias of robot k, just computed from its model, the mass that it has found."""
    factor = known.mass[k]
    if factor != 1.0:
        for i in range(phys.mass_matrix.shape[1]):
            phys.mass_matrix[k, i] *= factor
        for i in range(phys.bias.shape[1]):
            phys.bias[k, i] *= factor


@njit(cache=True, forceinline=True)
def count_asked(known: SelfModel, k: int, gait: Gait, dt: float) -> None:
    """Add the force that whole-body control expects of the floor in the physics step to come."""
    known.asked[k, 0] += dt * gait.wrench[k, 0]
    known.asked[k, 1] += dt * gait.wrench[k, 1]


@njit(cache=True)
def weigh(known: SelfModel, k: int, s: GaitSettings, impulse: float, climb: float, span: float) -> None:
    """Take a period's vertical impulse [N s] and change of the CoM's velocity [m/s] into the mass."""
    keep = math.exp(-span / MEMORY)
    known.weighed[k, 0] = keep * known.weighed[k, 0] + impulse
    known.weighed[k, 1] = keep * known.weighed[k, 1] + s.mass * (GRAVITY * span + climb)
    factor = min(max(known.weighed[k, 0] / max(known.weighed[k, 1], 1e-9), MASS_RANGE[0]), MASS_RANGE[1])
    known.mass[k] = 1.0 if abs(factor - 1.0) < MASS_KNOWN else factor


@njit(cache=True)
def end_step(known: SelfModel, k: int) -> None:
    """Take the mean over the step that is over, and the one before, into the drift."""
    step, drift = known.step[k], known.drift[k]
    if step[QUIET] > 0.0:
        for axis in range(2):
            mean = step[DRIFT + axis] / max(step[WEIGHT], 1e-9)
            if step[QUIET] > 1.0:
                change = 0.5 * (mean + step[LAST + axis]) - drift[axis]
                drift[axis] += DRIFT_GAIN * min(max(change, -DRIFT_CHANGE), DRIFT_CHANGE)
                drift[axis] = min(max(drift[axis], -DRIFT_MAX), DRIFT_MAX)
            step[LAST + axis] = mean
    step[QUIET] += 1.0
    step[DRIFT] = step[DRIFT + 1] = step[WEIGHT] = 0.0


@njit(cache=True)
def learn_grip(known: SelfModel, k: int, phys: Physics, gait: Gait, contacts: Contacts) -> None:
    """Take in what the floor has held of robot k, whose stance sole may slide from its landing at first."""
    (x, y, _), impulse = sole_position(phys, k, gait.stance[k]), contacts.impulse[k]
    share = math.hypot(impulse[0], impulse[1]) / impulse[2] if impulse[2] > 0.0 else -1.0
    landed, step, span = gait.elapsed[k] > STANDING, gait.steps[k], contacts.time[k]
    known.grip[k] = feel_grip(known.stood[k], known.grip[k], x, y, step, landed, share, span)


@njit(cache=True)
def learn(known: SelfModel, k: int, phys: Physics, gait: Gait, contacts: Contacts, s: GaitSettings) -> None:
    """Take in the period since the last observation of robot k; to be called before it is observed."""
    span = contacts.time[k]
    if span <= 0.0:
        return
    learn_grip(known, k, phys, gait, contacts)
    velocity = com_velocity(phys, k)
    x, y, z = subtract(velocity, vector_of(contacts.velocity[k], 0))
    step, mass = known.step[k], s.mass * known.mass[k]
    if step[NUMBER] != gait.steps[k]:
        end_step(known, k)
        step[NUMBER] = gait.steps[k]
    ahead = heading_frame(gait.heading[k])
    push_x, push_y = external_force(contacts, k, mass, s, velocity)
    push_x, push_y = canonical(ahead, push_x, push_y)
    for i in range(2):
        share = 1.0 - math.exp(-span / PUSH_MEANS[i])
        step[PUSH + 2 * i] += share * (push_x - step[PUSH + 2 * i])
        step[PUSH + 2 * i + 1] += share * (push_y - step[PUSH + 2 * i + 1])
    if math.hypot(step[PUSH] - step[PUSH + 2], step[PUSH + 1] - step[PUSH + 3]) > PUSHED:
        step[QUIET] = -1.0
    scale = 1.0 / (mass * s.omega**2 * span)
    x, y = scale * (mass * x - known.asked[k, 0]), scale * (mass * y - known.asked[k, 1])
    weight = span * math.exp(-s.omega * gait.elapsed[k])
    x, y = canonical(ahead, x, y)
    step[DRIFT] += weight * x
    step[DRIFT + 1] += weight * y
    step[WEIGHT] += weight
    known.asked[k] = 0.0
    weigh(known, k, s, contacts.impulse[k, 2], z, span)


@njit(cache=True)
def show_drift(known: SelfModel, k: int, sign: float, seen: Array) -> None:
    """Move DCM and CoM of an observation (36,) by the drift, and take that off its push estimate."""
    if math.hypot(known.drift[k, 0], known.drift[k, 1]) < DRIFT_KNOWN:
        return
    for axis in range(2):
        drift = known.drift[k, axis] * (sign if axis == 1 else 1.0)
        seen[_DCM + axis] += drift
        seen[_COM + axis] += drift
        seen[_PUSH + axis] -= drift


@njit(cache=True)
def show_push(known: SelfModel, k: int, sign: float, span: float, seen: Array) -> None:
    """Leave a push estimate that does not rise above its noise out of an observation (36,)."""
    felt, x, y = known.felt[k], seen[_PUSH], sign * seen[_PUSH + 1]
    if span > 0.0:
        jump = math.hypot(x - felt[FELT], y - felt[FELT + 1])
        felt[JUMP] = max(felt[JUMP] + (NOISE_RATE if jump > felt[JUMP] else -NOISE_RATE), 0.0)
        felt[FELT], felt[FELT + 1] = x, y
    if felt[JUMP] > NOISE_KNOWN and math.hypot(x, y) < NOISE_SHARE * felt[JUMP]:
        seen[_PUSH] = seen[_PUSH + 1] = 0.0


@njit(cache=True)
def show_known(known: SelfModel, k: int, gait: Gait, span: float, seen: Array) -> None:
    """Make the observation (36,) of robot k, as sensors give it over `span` [s], the one to plan on."""
    sign = side_sign(gait.stance[k])
    show_drift(known, k, sign, seen)
    show_push(known, k, sign, span, seen)
