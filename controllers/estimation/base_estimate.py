"""Where the base is and how it moves, from inertial unit, legs and the grip of the stance foot.

The friction that a robot believes in: less after a slide, more where the floor has held; compiled.

A sole slides where it has moved faster than SLIDES in SLIDING periods in a row, and further than noise
explains. With p the sole's place, seen at the end of each planning period with white noise of the deviation
sigma along each axis,

    |p - p_start| > SLIDES t + DOUBT sqrt(2) sigma    it slides, unless it rested in the last SLIDING periods,
    |p - p_start| < SLIDES t                          it rests: the next period is the first,

which is Page's test of a change of the mean (Biometrika 1954): the sum of the periods' displacements is one
difference of two places, so noise does not add up over it. A second difference of three places has the
variance 6 sigma^2 along each axis whatever the sole's steady speed, which tells sigma; a sole that shakes for
a while in a fall adds little to it. Up to NO_NOISE it counts as none, and each period's displacement tells
by itself.

While a sole slides, the horizontal share of the floor's force is the friction. What was believed in noise is
tried again: while the sole rests although that share is as large as the belief, there is more friction, and
the belief rises at a steady rate, up to that of the beginning.

Where n robots believe their bases to be, how these move, and how sure they are of it.

The errors of the estimate are kept apart where they hardly touch each other. With the world's z axis upward,
theta the error of the tilt about a horizontal axis, beta that of the gyro's bias about it, v that of the
velocity across it and f_z the vertical specific force,

    theta' = -beta,    v' = f_z theta        for each of the two horizontal axes,
    v_z'   = -b                              for the vertical one, b the error of the accelerometer's bias.

Both horizontal axes obey the same law, see the same noise and are measured together, so they share one
covariance of 3 x 3. A bias of the accelerometer in the horizontal plane cannot be told from tilt while the
robot stands upright: it is taken for tilt, 1 mg for 0.06 degrees. This is the contact-aided filter of Bloesch
et al. (RSS 2012) and Hartley et al. (IJRR 2020), with the couplings left out that are small as long as the
pelvis stays near upright; heading and place cannot be observed in any of them, and drift.

Strapdown navigation: where the inertial sensor says that the base has gone; compiled.

What standing soles tell the estimate of the base: a loaded sole rests; compiled, every physics step.

The velocity of a sole follows from the base's and the joints' rates; where it stands it is zero, and what is
left is the error of the base's velocity. A sole that carries no load, or whose velocity lies further from
zero than noise explains (it slides, rolls or has just hit the floor), is left out: the base then moves as the
inertial sensor says. A sole that stands keeps its place, which ties the base's place to the floor.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..array_table import Floats1, Floats2, Floats3
from ..jit import njit
from ..math3 import (
    Vector,
    add,
    conjugate,
    normalised,
    of_rotation,
    product,
    rotated,
    scaled,
    subtract,
    vector_at,
    vector_in,
)
from ..model.robot import GRAVITY
from ..whole_body.kinematics import PELVIS, Physics, base_angular_velocity, sole_motion

Array = NDArray[np.float64]

SLIDES = 0.3  # speed from which a sole slides [m/s]
SLIDING = 3  # periods of sliding that tell the friction: one alone may be a blow
SLIDE_DOUBT = 6.0  # deviations of noise that a slide must rise above
GRIP_MIN = 0.4  # the least friction that is believed
NOISE_PERIODS = 50.0  # over which the noise is averaged
NOISE_KNOWN = 10.0  # periods after which it is known
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
MOST = 13  # friction believed in at the beginning
SIZE = 14


@njit(cache=True, forceinline=True)
def _keep_place(stood: Array, first: int, x: float, y: float) -> None:
    stood[first], stood[first + 1] = x, y


@njit(cache=True, forceinline=True)
def _count_noise(stood: Array, x: float, y: float) -> None:
    """Take how the displacement (x, y) of a period differs from that of the one before it."""
    squared = ((x - stood[MOVED]) ** 2 + (y - stood[MOVED + 1]) ** 2) / 12.0
    if stood[NOISES] >= NOISE_KNOWN:
        squared = min(squared, NOISE_JUMP * stood[NOISE] + NOISE_LEAST)
    stood[NOISES] = min(stood[NOISES] + 1.0, NOISE_PERIODS)
    stood[NOISE] += (squared - stood[NOISE]) / stood[NOISES]


@njit(cache=True, forceinline=True)
def _restart(stood: Array, x: float, y: float) -> None:
    """A slide may begin here."""
    _keep_place(stood, START, x, y)
    stood[TIME] = stood[PERIODS] = stood[SHARE] = 0.0


@njit(cache=True)
def feel_grip(
    stood: Array, grip: float, x: float, y: float, step: int, landed: bool, share: float, span: float
) -> float:
    """Friction believed in after a period in which a stance sole has stood, or slid.

    Args:
        stood: row (SIZE,) of the robot, written.
        grip: friction believed in until now.
        x: place of the stance sole [m].
        y: place of the stance sole [m].
        step: its number.
        landed: whether the sole no longer slides from its landing.
        share: of the floor's force that is horizontal over the vertical one; negative: there is no force.
        span: of the period [s].
    """
    stands = landed and stood[ITS_STEP] == step
    moved_x, moved_y = x - stood[PLACE], y - stood[PLACE + 1]
    stood[ITS_STEP] = step
    _keep_place(stood, PLACE, x, y)
    if not stands or share < 0.0:
        stood[STANDS_FOR] = 0.0
        _restart(stood, x, y)
        return grip
    if stood[STANDS_FOR] > 0.0:
        _count_noise(stood, moved_x, moved_y)
    stood[STANDS_FOR] += 1.0
    _keep_place(stood, MOVED, moved_x, moved_y)
    stood[TIME] += span
    noisy, doubt = stood[NOISE] > NO_NOISE, SLIDE_DOUBT * math.sqrt(2.0 * stood[NOISE])
    far = math.hypot(x - stood[START], y - stood[START + 1]) - SLIDES * stood[TIME]
    least = SLIDES * span - (doubt if noisy else 0.0)
    if math.hypot(moved_x, moved_y) <= least or (noisy and far <= 0.0):
        _restart(stood, x, y)
        return min(grip + RISE * span, stood[MOST]) if noisy and share >= TRIED * grip else grip
    stood[PERIODS] += 1.0
    stood[SHARE] = max(stood[SHARE], share)
    sure = not noisy or (far > doubt and stood[NOISES] >= NOISE_KNOWN)
    return min(grip, max(stood[SHARE], GRIP_MIN)) if sure and stood[PERIODS] >= SLIDING else grip


# Standard deviations at the beginning: of a robot that has stood or walked for a while
TILT_AT_FIRST = 3e-3  # [rad]
GYRO_BIAS_AT_FIRST = 1e-3  # [rad/s]
VELOCITY_AT_FIRST = 0.02  # [m/s]
LIFT_BIAS_AT_FIRST = 0.03  # [m/s^2]
TILT_OF_BIAS = 3e-3  # of the accelerometer's horizontal bias over gravity, which no filter sees [rad]

# Columns of `BaseEstimate.level`: T tilt, B gyro bias, V velocity
TT, TB, TV, BB, BV, VV = range(6)
LEVEL_SIZE = 6
# Columns of `BaseEstimate.lift`: V velocity, B accelerometer bias
LIFT_VV, LIFT_VB, LIFT_BB = range(3)
LIFT_SIZE = 3


class BaseEstimate(NamedTuple):
    """Estimate of the bases of n robots; world axes unless said otherwise."""

    place: Floats2  # (n, 3) [m]
    attitude: Floats2  # (n, 4) unit quaternion, w first
    velocity: Floats2  # (n, 3) [m/s]
    gyro_bias: Floats2  # (n, 3) in the axes of the base [rad/s]
    lift_bias: Floats1  # (n,) of the vertical acceleration [m/s^2]
    level: Floats2  # (n, LEVEL_SIZE) covariance of tilt, gyro bias and velocity, of either horizontal axis
    lift: Floats2  # (n, LIFT_SIZE) covariance of vertical velocity and accelerometer bias
    turn: Floats1  # (n,) variance of the gyro bias about the vertical [rad^2/s^2]
    spread: Floats1  # (n,) variance of the place along a horizontal axis [m^2]
    anchor: Floats3  # (n, 2, 3) where each sole stands [m]
    stood: Floats2  # (n, 2) for how long it has stood, 0: it does not [s]


def empty_base_estimate(n: int) -> BaseEstimate:
    """Arrays of n robots, whose estimate has not begun."""
    return BaseEstimate(
        place=np.zeros((n, 3)), attitude=np.zeros((n, 4)), velocity=np.zeros((n, 3)),
        gyro_bias=np.zeros((n, 3)), lift_bias=np.zeros(n), level=np.zeros((n, LEVEL_SIZE)),
        lift=np.zeros((n, LIFT_SIZE)), turn=np.zeros(n), spread=np.zeros(n), anchor=np.zeros((n, 2, 3)),
        stood=np.zeros((n, 2)),
    )  # fmt: skip


def begin_estimate(estimate: BaseEstimate, k: int, place: Array, attitude: Array, velocity: Array) -> None:
    """Let robot k begin at a place (3,), an attitude (4,) and a velocity (3,), as uncertain as they are."""
    for field in estimate:
        field[k] = 0.0
    estimate.place[k], estimate.attitude[k], estimate.velocity[k] = place, attitude, velocity
    estimate.level[k, [TT, BB, VV]] = TILT_AT_FIRST**2, GYRO_BIAS_AT_FIRST**2, VELOCITY_AT_FIRST**2
    estimate.lift[k, [LIFT_VV, LIFT_BB]] = VELOCITY_AT_FIRST**2, LIFT_BIAS_AT_FIRST**2
    estimate.turn[k] = GYRO_BIAS_AT_FIRST**2


class Deviations(NamedTuple):
    """Standard deviations that n estimates state of themselves, (n,) each."""

    tilt: Array  # about a horizontal axis [rad]
    velocity: Array  # along a horizontal axis [m/s]
    climb: Array  # vertical velocity [m/s]
    gyro_bias: Array  # about a horizontal axis [rad/s]
    place: Array  # along a horizontal axis [m]


def deviations(estimate: BaseEstimate) -> Deviations:
    """How sure the robots are."""
    level, lift = np.sqrt(estimate.level[:, [TT, VV, BB]]), np.sqrt(estimate.lift[:, LIFT_VV])
    return Deviations(
        np.hypot(level[:, 0], TILT_OF_BIAS), level[:, 1], lift, level[:, 2], np.sqrt(estimate.spread)
    )


@njit(cache=True, forceinline=True)
def predict_level(level: Array, s: float, dt: float, tilt: float, bias: float, velocity: float) -> None:
    """P <- F P F' + Q with F = [[1, -dt, 0], [0, 1, 0], [s, 0, 1]] of one robot, (6,).

    Args:
        level: covariance, written.
        s: vertical specific force times dt [m/s].
        dt: [s].
        tilt: variance that the tilt gains [rad^2]; `bias` [rad^2/s^2] and `velocity` [m^2/s^2] likewise.
        bias: of the gyro.
        velocity: of the base.
    """
    t, b, v = level[TT] - dt * level[TB], level[TB] - dt * level[BB], level[TV] - dt * level[BV]
    level[VV] += s * (s * level[TT] + 2.0 * level[TV]) + velocity
    level[TV], level[BV] = s * t + v, s * level[TB] + level[BV]
    level[TT], level[TB] = t - dt * b + tilt, b
    level[BB] += bias


@njit(cache=True, forceinline=True)
def update_level(level: Array, noise: float) -> tuple[float, float, float]:
    """Gains of tilt, gyro bias and velocity for a velocity measured with a variance; P <- P - K S K'."""
    tv, bv, vv = level[TV], level[BV], level[VV]
    inverse = 1.0 / (vv + noise)
    level[TT] -= tv * tv * inverse
    level[TB] -= tv * bv * inverse
    level[BB] -= bv * bv * inverse
    left = noise * inverse
    level[TV], level[BV], level[VV] = left * tv, left * bv, left * vv
    return tv * inverse, bv * inverse, vv * inverse


@njit(cache=True, forceinline=True)
def predict_lift(lift: Array, dt: float, velocity: float, bias: float) -> None:
    """P <- F P F' + Q with F = [[1, -dt], [0, 1]] of one robot, (3,)."""
    cross = lift[LIFT_VB] - dt * lift[LIFT_BB]
    lift[LIFT_VV] += velocity - dt * (lift[LIFT_VB] + cross)
    lift[LIFT_VB] = cross
    lift[LIFT_BB] += bias


@njit(cache=True, forceinline=True)
def update_lift(lift: Array, noise: float) -> tuple[float, float]:
    """Gains of vertical velocity and bias for a velocity measured with a variance; P <- P - K S K'."""
    vv, vb = lift[LIFT_VV], lift[LIFT_VB]
    inverse = 1.0 / (vv + noise)
    lift[LIFT_BB] -= vb * vb * inverse
    left = noise * inverse
    lift[LIFT_VV], lift[LIFT_VB] = left * vv, left * vb
    return vv * inverse, vb * inverse


RATE_NOISE = 4e-3  # of the gyro, of one sample, with what its scale adds [rad/s]
FORCE_NOISE = 0.1  # of the accelerometer, of one sample; vibration of the frame is in it [m/s^2]
SCALE = 0.01  # error over the change of velocity: scale, axes, and the couplings left out
RATE_WALK = 1e-4  # of the gyro's bias [rad/s / sqrt(s)]
FORCE_WALK = 1e-3  # of the accelerometer's bias [m/s^2 / sqrt(s)]
FORCE_RANGE = 150.0  # from here on the accelerometer may have met its range [m/s^2]
BEYOND_RANGE = 0.5  # deviation of the change of velocity then [m/s]


class Inertial(NamedTuple):
    """What an inertial sensor at the base's origin tells of a physics step, in the axes of the base."""

    rate: Vector  # mean angular velocity [rad/s]
    change: Vector  # integral of the specific force, in the axes at the end of the step [m/s]


@njit(cache=True, forceinline=True)
def navigate(estimate: BaseEstimate, k: int, inertial: Inertial, dt: float) -> Vector:
    """Move the estimate of robot k on by a physics step; returns its angular velocity, base axes [rad/s].

    q <- q exp(dt (rate - bias)),  v <- v + R(q) change - (g + lift bias) dt z,  p <- p + v dt
    """
    rate = subtract(inertial.rate, vector_in(estimate.gyro_bias, k, 0))
    old = estimate.attitude[k]
    q = normalised(product((old[0], old[1], old[2], old[3]), of_rotation(scaled(rate, dt))))
    for i in range(4):
        old[i] = q[i]
    change = rotated(q, inertial.change)
    fall = 0.0, 0.0, -dt * (GRAVITY + estimate.lift_bias[k])
    velocity = add(add(vector_in(estimate.velocity, k, 0), change), fall)
    for i in range(3):
        estimate.velocity[k, i] = velocity[i]
        estimate.place[k, i] += dt * velocity[i]
    size = math.sqrt(change[0] ** 2 + change[1] ** 2 + change[2] ** 2)
    gained = (FORCE_NOISE * dt) ** 2 + (SCALE * (size - dt * GRAVITY)) ** 2
    if size > FORCE_RANGE * dt:
        gained += BEYOND_RANGE**2
    predict_level(estimate.level[k], change[2], dt, (RATE_NOISE * dt) ** 2, RATE_WALK**2 * dt, gained)
    predict_lift(estimate.lift[k], dt, gained, FORCE_WALK**2 * dt)
    estimate.turn[k] += RATE_WALK**2 * dt
    return rate


STANDING_DEVIATION = 0.06  # deviation of the velocity of a standing sole [m/s]
ROLL = 0.1  # from the sole's centre to the edge that it may roll over [m]
TURNING = 0.4  # deviation that a sole's velocity is weighed with, over the rate at which the sole turns [m]
LOADED = 60.0  # a sole with less load may move [N]
GATE = 3.0  # deviations that a standing sole's velocity may lie from zero
UNLOADED_VARIANCE = 0.02  # variance that velocity gains while a loaded sole is left out [m^2/s^3]
SOLE_TURNS = 0.1  # deviation of the turning rate of a standing sole [rad/s]
TWISTING = 4.0  # deviation that a sole's turning rate is weighed with, over that rate: it twists for a while
ANCHOR_GAIN = 0.1  # share of the distance to a sole's place that the base moves in a step
ANCHOR_NOISE = 0.003  # deviation of the place of a new foothold [m]
ANCHOR_LOSS = 5.0  # a sole that is left out loses its time of standing this much faster than it gains it


@njit(cache=True, forceinline=True)
def listen_to_soles(estimate: BaseEstimate, k: int, phys: Physics, dt: float) -> None:
    """Correct the estimate of robot k by its standing soles, and its velocity in `phys` with it.

    The kinematics in `phys` must be those of the estimate's attitude. What the tilt gains shows in the next
    step's; neither kinematics nor M nor bias depend on the linear velocity.
    """
    omega, stands = base_angular_velocity(phys, k), False
    moved = vector_in(estimate.velocity, k, 0)
    first = 0 if phys.load[k, 0] >= phys.load[k, 1] else 1  # the one that carries more, as in a mirror
    for leg in (first, 1 - first):
        if phys.load[k, leg] < LOADED:
            estimate.stood[k, leg] = 0.0
            continue
        sole = sole_motion(phys, k, leg, omega)
        now = vector_in(estimate.velocity, k, 0)
        rest = add(sole.velocity, subtract(now, moved))  # what the other sole has corrected is known
        if _rests(estimate, k, rest, _noise(sole.omega, ROLL)):
            _correct(estimate, k, rest, sole.omega, _noise(sole.omega, TURNING))
            _hold_place(estimate, k, leg, subtract(sole.position, vector_at(phys.xpos, k, PELVIS)), dt)
            stands = True
        else:
            estimate.level[k, VV] += UNLOADED_VARIANCE * dt
            estimate.lift[k, LIFT_VV] += UNLOADED_VARIANCE * dt
            estimate.stood[k, leg] = max(estimate.stood[k, leg] - ANCHOR_LOSS * dt, 0.0)
    if not stands:
        estimate.spread[k] = (math.sqrt(estimate.spread[k]) + dt * math.sqrt(estimate.level[k, VV])) ** 2
    for i in range(3):
        phys.qvel[k, i] = estimate.velocity[k, i]


@njit(cache=True, forceinline=True)
def _noise(omega: Vector, lever: float) -> float:
    """Variance of the velocity of a standing sole that turns at omega, with a deviation over it [m^2/s^2]."""
    return STANDING_DEVIATION**2 + lever**2 * (omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)


@njit(cache=True, forceinline=True)
def _rests(estimate: BaseEstimate, k: int, rest: Vector, noise: float) -> bool:
    """Whether noise, a variance, explains the velocity of a loaded sole."""
    level, lift = estimate.level[k, VV] + noise, estimate.lift[k, LIFT_VV] + noise
    aside = max(rest[0] ** 2, rest[1] ** 2) / level
    return max(aside, rest[2] ** 2 / lift) < GATE**2


@njit(cache=True, forceinline=True)
def _correct(estimate: BaseEstimate, k: int, rest: Vector, omega: Vector, noise: float) -> None:
    """Take the velocity of a standing sole for the error of the estimate.

    About the horizontal axes: theta_y, beta_y go with v_x, and -theta_x, -beta_x with v_y.
    """
    tilt, bias, velocity = update_level(estimate.level[k], noise)
    climb, lift = update_lift(estimate.lift[k], noise)
    turns = omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2
    turn = estimate.turn[k] / (estimate.turn[k] + SOLE_TURNS**2 + TWISTING**2 * turns)
    estimate.turn[k] *= 1.0 - turn
    estimate.velocity[k, 0] -= velocity * rest[0]
    estimate.velocity[k, 1] -= velocity * rest[1]
    estimate.velocity[k, 2] -= climb * rest[2]
    estimate.lift_bias[k] -= lift * rest[2]
    old = estimate.attitude[k]
    q = old[0], old[1], old[2], old[3]
    shift = rotated(conjugate(q), (bias * rest[1], -bias * rest[0], turn * omega[2]))
    q = normalised(product(of_rotation((tilt * rest[1], -tilt * rest[0], 0.0)), q))
    for i in range(4):
        old[i] = q[i]
    for i in range(3):
        estimate.gyro_bias[k, i] += shift[i]


@njit(cache=True, forceinline=True)
def _hold_place(estimate: BaseEstimate, k: int, leg: int, sole: Vector, dt: float) -> None:
    """Keep a standing sole, seen from the base in world axes [m], at its place."""
    anchor, place = estimate.anchor[k, leg], estimate.place[k]
    if estimate.stood[k, leg] == 0.0:
        for i in range(3):
            anchor[i] = place[i] + sole[i]
        estimate.spread[k] += ANCHOR_NOISE**2
    else:
        for i in range(3):
            place[i] += ANCHOR_GAIN * (anchor[i] - place[i] - sole[i])
    estimate.stood[k, leg] += dt
