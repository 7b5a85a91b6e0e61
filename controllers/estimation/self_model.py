"""Self-model of a biped that walks: its weight, a steady force on it, friction of its floor and joints.

All comes from what joint encoders, inertial sensor and force sensors in the feet measure, and from the forces
that whole-body control itself expects. With the impulse J of the floor and the velocity v of the CoM over a
planning period,

    mass = sum J_z / sum (g dt + v_z - v_z,before)              sums that forget with MASS_MEMORY,

over the model's mass, is the factor of its mass matrix and its bias, which is exact where every body is off
by the same share. And where whole-body control expected the impulse J_w of the floor,

    drift = (m (v - v_before) - J_w) / (m omega^2 dt)   [m]

is where a CMP would have to lie, seen from the foot, to push like all that was not foreseen: a slope, a CoM
that is elsewhere, torques that come late. Its mean over two steps, weighted with exp(-omega t) as the DCM at
their ends weighs it, is taken off the point that the pendulum stands on: xi + drift moves on a slope as xi
does on the level, so the planner is shown CoM and DCM moved by it.

The push estimate is the change of a velocity: 1 cm of noise in the DCM makes 0.3 m of it. How far it jumps
from one period to the next, in the median, is its noise; a push that does not rise above it is not shown.

How much friction whole-body control may count on, slides and holding soles say (`feel_grip`).

What the joints of the legs lose, friction and a rotor heavier than the model's, is found while a leg swings:
it is moved by its motors alone. What their torques tau, which the drives report, leave over is

    r = tau - (M qdd + h) = c sign(qd) + I qdd,

in each joint: c its friction [N m], I the inertia [kg m^2] that its rotor has beyond the model's. qdd is a
difference quotient, so r, sign(qd) and qdd pass through the same filter, which leaves the relation between
them as it is. c and I are the least squares over the leg's swings, the last LOSS_MEMORY seconds the most.
Each touchdown takes them into mass matrix and bias; the inverse dynamics do the rest. The waist is left out:
the trunk hardly moves while the robot walks, so that a tilt of the estimate passes for friction, and a trunk
whose friction is taken for more than it is leans further and further.

An, Atkeson and Hollerbach (1985), "Estimation of inertial parameters of rigid body links of manipulators".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.np.numpy_support import carray

from ..array_table import Floats1, Floats2, Floats3
from ..jit import njit
from ..math3 import stack_floats, subtract, vector_of
from ..model.observation import COM, DCM, PUSH_ESTIMATE, canonical, heading_frame, side_sign
from ..model.robot import GRAVITY
from ..whole_body import kinematics
from ..whole_body.gait_machine import Gait, GaitSettings
from ..whole_body.kinematics import BASE, LEG_DOF, NU, NV, Array, Physics
from .observe import Contacts, external_force

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


LOSS_MEMORY = 2.0  # of swinging [s]
FILTER = 100.0  # rate [1/s]
LEAST_SPEED = 0.1  # slower than this, sign(qd) grows linearly [rad/s]
FRICTION_AT_FIRST = 0.02  # weight of c = 0: that of moving for so long [s]
ROTOR_AT_FIRST = 2.0  # weight of I = 0, an integral of qdd^2 [rad^2/s^3]
REST = 0.02  # slower than this, a joint says nothing [rad/s]
BLOW = 10.0  # no joint loses so much: it is at its stop, or something has hit the foot [N m]
FRICTION_KNOWN, FRICTION_MOST = 0.2, 5.0  # less counts as none, more as this [N m]
ROTOR_KNOWN, ROTOR_MOST = 0.005, 0.2  # likewise [kg m^2]

# Columns of a joint's row
LOST, SIGN, ACCELERATION = 0, 1, 2  # filtered since the swing began [N m], [], [rad/s^2]
SIGN_SIGN, SIGN_ACCELERATION, ACCELERATION_SQUARED = 3, 4, 5  # integrals of their products over time
SIGN_LOST, ACCELERATION_LOST = 6, 7
FRICTION, ROTOR = 8, 9  # c [N m] and I [kg m^2]
LOSS_SIZE = 10
# Columns of what is kept of the step's beginning: rows of M of the swing leg's joints, theirs of h, all rates
BIAS = 57
RATES = BIAS + 6
BEFORE = RATES + NV


@njit(cache=True, forceinline=True)
def direction(speed: float) -> float:
    """Sign of a joint's rate [rad/s], continuous."""
    return min(max(speed / LEAST_SPEED, -1.0), 1.0)


@njit(cache=True, forceinline=True)
def known_size(value: float, known: float, most: float) -> float:
    """A loss, where it is large enough to differ from none, and no larger than is believed."""
    return min(value, most) if value >= known else 0.0


@njit(cache=True)
def conclude(joint: Array) -> None:
    """Solve the least squares of a joint's row (LOSS_SIZE,), and begin the filters of its next swing."""
    a, b, c = joint[SIGN_SIGN] + FRICTION_AT_FIRST, joint[SIGN_ACCELERATION], joint[ACCELERATION_SQUARED]
    c += ROTOR_AT_FIRST
    determinant = a * c - b * b
    friction = (c * joint[SIGN_LOST] - b * joint[ACCELERATION_LOST]) / determinant
    rotor = (a * joint[ACCELERATION_LOST] - b * joint[SIGN_LOST]) / determinant
    joint[FRICTION] = known_size(friction, FRICTION_KNOWN, FRICTION_MOST)
    joint[ROTOR] = known_size(rotor, ROTOR_KNOWN, ROTOR_MOST)
    joint[LOST] = joint[SIGN] = joint[ACCELERATION] = 0.0


@njit(cache=True)
def take_in(joint: Array, lost: float, speed: float, acceleration: float, dt: float) -> None:
    """Take torque lost [N m], rate and acceleration of a joint over dt [s] into its row (LOSS_SIZE,)."""
    share, keep = 1.0 - math.exp(-FILTER * dt), math.exp(-dt / LOSS_MEMORY)
    joint[LOST] += share * (lost - joint[LOST])
    joint[SIGN] += share * (direction(speed) - joint[SIGN])
    joint[ACCELERATION] += share * (acceleration - joint[ACCELERATION])
    r, s, a = joint[LOST], joint[SIGN], joint[ACCELERATION]
    if abs(r) > BLOW:
        joint[LOST] = joint[SIGN] = joint[ACCELERATION] = 0.0
        return
    if abs(speed) < REST:  # it may rest against its stop
        return
    joint[SIGN_SIGN] = keep * joint[SIGN_SIGN] + s * s * dt
    joint[SIGN_ACCELERATION] = keep * joint[SIGN_ACCELERATION] + s * a * dt
    joint[ACCELERATION_SQUARED] = keep * joint[ACCELERATION_SQUARED] + a * a * dt
    joint[SIGN_LOST] = keep * joint[SIGN_LOST] + s * r * dt
    joint[ACCELERATION_LOST] = keep * joint[ACCELERATION_LOST] + a * r * dt


@njit(cache=True)
def leg_row(before: Array, i: int, qdd: Array, first: int) -> float:
    """Row i of M qdd of a leg, from the rows of its joints, qdd (20,) and its first degree of freedom."""
    row, total = i * (2 * BASE + 1 + i) // 2, 0.0
    for c in range(BASE):
        total += before[row + c] * qdd[c]
    for c in range(i + 1):
        total += before[row + BASE + c] * qdd[first + c]
    for c in range(i + 1, 6):
        total += before[c * (2 * BASE + 1 + c) // 2 + BASE + i] * qdd[first + c]
    return total


@njit(cache=True)
def feel_swing(joints: Floats3, before: Floats2, phys: Physics, k: int, leg: int, dt: float) -> None:
    """Take in what the joints of a leg in the air have lost in the physics step that has just ended."""
    qdd, first = carray(stack_floats(20), (NV,)), LEG_DOF[leg]
    for i in range(NV):
        qdd[i] = (phys.qvel[k, i] - before[k, RATES + i]) / dt
    for i in range(6):
        j = first + i
        lost = phys.ctrl[k, j - BASE] - leg_row(before[k], i, qdd, first) - before[k, BIAS + i]
        take_in(joints[k, j - BASE], lost, 0.5 * (phys.qvel[k, j] + before[k, RATES + j]), qdd[j], dt)


@njit(cache=True)
def keep_leg(before: Floats2, phys: Physics, k: int, leg: int) -> None:
    """Keep the rows of a leg's joints, and all rates, for the physics step to come."""
    for i in range(BIAS):
        before[k, i] = phys.mass_matrix[k, kinematics.ROW[LEG_DOF[leg]] + i]
    for i in range(6):
        before[k, BIAS + i] = phys.bias[k, LEG_DOF[leg] + i]
    for i in range(NV):
        before[k, RATES + i] = phys.qvel[k, i]


@njit(cache=True, forceinline=True)
def feel_joints(joints: Floats3, before: Floats2, phys: Physics, gait: Gait, k: int, dt: float) -> None:
    """Take in the physics step of robot k that has just ended; a leg that has just landed concludes.

    M and h in `phys` are the model's, torques as the drives gave them. `before` (n, BEFORE) holds what it was
    when the step began, and then what it is now.
    """
    stance = gait.stance[k]
    if 0.0 <= gait.elapsed[k] <= 1.5 * dt:  # has just touched down
        for j in range(LEG_DOF[stance], LEG_DOF[stance] + 6):
            conclude(joints[k, j - BASE])
    elif phys.load[k, 1 - stance] <= 0.0:
        feel_swing(joints, before, phys, k, 1 - stance, dt)
    keep_leg(before, phys, k, 1 - stance)


@njit(cache=True, forceinline=True)
def add_losses(joints: Floats3, phys: Physics, k: int) -> None:
    """Add what the joints of robot k lose to its mass matrix and bias, just computed from its model."""
    for j in range(LEG_DOF[0], NV):
        joint = joints[k, j - BASE]
        phys.mass_matrix[k, kinematics.DIAGONAL[j]] += joint[ROTOR]
        phys.bias[k, j] += joint[FRICTION] * direction(phys.qvel[k, j])


SLIDES = 0.3  # speed from which a sole slides [m/s]
SLIDING = 3  # periods of sliding that give the friction: one alone may be a blow
SLIDE_DOUBT = 6.0  # deviations of noise that a slide must rise above
GRIP_MIN = 0.4  # the least friction that is believed
NOISE_PERIODS = 50.0  # over which the noise is averaged
NOISE_PERIODS_KNOWN = 10.0  # periods after which it is known
NOISE_JUMP = 3.0  # the most that one period counts of what it has been: sliding and shaking are no noise
NOISE_LEAST = 1e-9  # and on top of that: noise that begins is found [m^2]
NO_NOISE = 4e-8  # variance that counts as none [m^2]
TRIED = 0.95  # share of the belief that a floor has to hold, to be believed more of
RISE = 0.5  # of the belief then [1/s]

# Columns of a robot's row; of a pair (x, y) the first one
PLACE = 0  # pair, of the stance sole at the last observation [m]
MOVED = 2  # pair, in the period before it [m]
START = 4  # pair, where a slide may have begun [m]
TIME = 6  # since then [s]
PERIODS = 7  # since then
SHARE = 8  # largest horizontal share of the floor's force since then
STANDS_FOR = 9  # for how many periods this sole has stood
ITS_STEP = 10  # number of the step in which it stood there
NOISE = 11  # variance of the place along each axis [m^2]
NOISES = 12  # how many periods that was found from
GRIP_AT_FIRST = 13  # friction believed in at the beginning
STOOD_SIZE = 14


@njit(cache=True, forceinline=True)
def _count_noise(stood: Array, x: float, y: float) -> None:
    """Take how the displacement (x, y) of a period differs from that of the one before it."""
    squared = ((x - stood[MOVED]) ** 2 + (y - stood[MOVED + 1]) ** 2) / 12.0
    if stood[NOISES] >= NOISE_PERIODS_KNOWN:
        squared = min(squared, NOISE_JUMP * stood[NOISE] + NOISE_LEAST)
    stood[NOISES] = min(stood[NOISES] + 1.0, NOISE_PERIODS)
    stood[NOISE] += (squared - stood[NOISE]) / stood[NOISES]


@njit(cache=True, forceinline=True)
def _restart(stood: Array, x: float, y: float) -> None:
    """A slide may begin here."""
    stood[START], stood[START + 1] = x, y
    stood[TIME] = stood[PERIODS] = stood[SHARE] = 0.0


@njit(cache=True)
def feel_grip(
    stood: Array, grip: float, x: float, y: float, step: int, landed: bool, share: float, span: float
) -> float:
    """Friction believed in after a period in which a stance sole has stood, or slid.

    A sole slides where it has moved faster than SLIDES in SLIDING periods in a row, and further than noise
    explains. With p the sole's place, seen at the end of each planning period with white noise of the
    deviation sigma along each axis,

        |p - p_start| > SLIDES t + DOUBT sqrt(2) sigma    it slides, unless it rested in the last SLIDING,
        |p - p_start| < SLIDES t                          it rests: the next period is the first,

    which is Page's test of a change of the mean (Biometrika 1954): the sum of the periods' displacements is
    one difference of two places, so noise does not add up over it. A second difference of three places has
    the variance 6 sigma^2 along each axis whatever the sole's steady speed, which gives sigma; a sole that
    shakes for a while in a fall adds little to it. Up to NO_NOISE it counts as none, and each period's
    displacement decides by itself.

    While a sole slides, the horizontal share of the floor's force is the friction. What was believed in noise
    is tried again: while the sole rests although that share is as large as the belief, there is more
    friction, and the belief rises at a steady rate, up to that of the beginning.

    `stood` (STOOD_SIZE,) is written. The sole of a numbered `step` is at (x, y) [m] after a `span` [s]; once
    it has `landed`, it no longer slides from its landing. `share` is the floor's horizontal force over its
    vertical one, negative where there is none.
    """
    stands = landed and stood[ITS_STEP] == step
    moved_x, moved_y = x - stood[PLACE], y - stood[PLACE + 1]
    stood[ITS_STEP] = step
    stood[PLACE], stood[PLACE + 1] = x, y
    if not stands or share < 0.0:
        stood[STANDS_FOR] = 0.0
        _restart(stood, x, y)
        return grip
    if stood[STANDS_FOR] > 0.0:
        _count_noise(stood, moved_x, moved_y)
    stood[STANDS_FOR] += 1.0
    stood[MOVED], stood[MOVED + 1] = moved_x, moved_y
    stood[TIME] += span
    noisy, doubt = stood[NOISE] > NO_NOISE, SLIDE_DOUBT * math.sqrt(2.0 * stood[NOISE])
    far = math.hypot(x - stood[START], y - stood[START + 1]) - SLIDES * stood[TIME]
    least = SLIDES * span - (doubt if noisy else 0.0)
    if math.hypot(moved_x, moved_y) <= least or (noisy and far <= 0.0):
        _restart(stood, x, y)
        return min(grip + RISE * span, stood[GRIP_AT_FIRST]) if noisy and share >= TRIED * grip else grip
    stood[PERIODS] += 1.0
    stood[SHARE] = max(stood[SHARE], share)
    sure = not noisy or (far > doubt and stood[NOISES] >= NOISE_PERIODS_KNOWN)
    return min(grip, max(stood[SHARE], GRIP_MIN)) if sure and stood[PERIODS] >= SLIDING else grip


MASS_MEMORY = 0.5  # of the mass [s]
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
    """Weight, steady force, friction and losses that n robots have learned."""

    mass: Floats1  # (n,) over the model's
    weighed: Floats2  # (n, 2) vertical impulse of the floor, and that of the model's mass [N s]
    asked: Floats2  # (n, 2) impulse expected of the floor since the last observation, world axes [N s]
    drift: Floats2  # (n, 2) in the heading frame [m]
    step: Floats2  # (n, STEP_SIZE) of the step that goes on and the last one
    felt: Floats2  # (n, 3) what the push estimate was, and how it jumps
    grip: Floats1  # (n,) friction that whole-body control may count on
    stood: Floats2  # (n, STOOD_SIZE) where the stance sole stood, and how it slides
    joints: Floats3  # (n, 14, LOSS_SIZE) friction and rotor of each joint
    before: Floats2  # (n, BEFORE) the swing leg at the beginning of the physics step


def empty_self_model(n: int) -> SelfModel:
    """Arrays of n robots."""
    return SelfModel(
        mass=np.ones(n), weighed=np.zeros((n, 2)), asked=np.zeros((n, 2)), drift=np.zeros((n, 2)),
        step=np.zeros((n, STEP_SIZE)), felt=np.zeros((n, 3)), grip=np.ones(n),
        stood=np.zeros((n, STOOD_SIZE)), joints=np.zeros((n, NU, LOSS_SIZE)), before=np.zeros((n, BEFORE)),
    )  # fmt: skip


def forget(known: SelfModel, k: int, s: GaitSettings, friction: float) -> None:
    """Let robot k begin anew with its model, which counts for MEMORY seconds of weighing."""
    known.mass[k] = 1.0
    known.weighed[k] = s.mass * GRAVITY * MASS_MEMORY
    for field in (known.asked, known.drift, known.step, known.felt, known.stood, known.joints, known.before):
        field[k] = 0.0
    known.step[k, QUIET] = 1.0  # the first step counts
    known.grip[k] = known.stood[k, GRIP_AT_FIRST] = friction


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
    for axis in range(2):
        known.asked[k, axis] += dt * gait.wrench[k, axis]


@njit(cache=True)
def weigh(known: SelfModel, k: int, s: GaitSettings, impulse: float, climb: float, span: float) -> None:
    """Take a period's vertical impulse [N s] and change of the CoM's velocity [m/s] into the mass."""
    keep = math.exp(-span / MASS_MEMORY)
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
    (x, y, _), impulse = kinematics.sole_position(phys, k, gait.stance[k]), contacts.impulse[k]
    share = math.hypot(impulse[0], impulse[1]) / impulse[2] if impulse[2] > 0.0 else -1.0
    landed = gait.elapsed[k] > STANDING or gait.elapsed[k] < 0.0
    step, span = gait.steps[k], contacts.time[k]
    known.grip[k] = feel_grip(known.stood[k], known.grip[k], x, y, step, landed, share, span)


@njit(cache=True)
def learn(known: SelfModel, k: int, phys: Physics, gait: Gait, contacts: Contacts, s: GaitSettings) -> None:
    """Take in the period since the last observation of robot k; to be called before it is observed."""
    span = contacts.time[k]
    if span <= 0.0:
        return
    learn_grip(known, k, phys, gait, contacts)
    velocity = kinematics.com_velocity(phys, k)
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
    weight = span * math.exp(-s.omega * max(gait.elapsed[k], 0.0))
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
