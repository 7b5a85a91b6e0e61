"""Estimate of a robot's base: its place, attitude and motion, from inertial unit, joints and loaded soles.

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

The inertial unit moves the estimate on in every physics step (`navigate`), then loaded soles correct it. The
velocity of a sole follows from the base's and the joints' rates; where it stands it is zero, and what is left
is the error of the base's velocity. A sole that carries no load, or whose velocity lies further from zero
than noise explains (it slides, rolls or has just hit the floor), is left out: the base then moves as the
inertial unit says. A sole that stands keeps its place, which ties the base's place to the floor.

Another way to estimate is another `Estimator`, in a file of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import math3
from ..array_table import Floats1, Floats2, Floats3
from ..jit import njit
from ..math3 import Vector, add, normalised, of_rotation, product, rotated, subtract, vector_in
from ..model.robot import GRAVITY
from ..whole_body.kinematics import PELVIS, Physics, base_angular_velocity, sole_motion

Array = NDArray[np.float64]

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


class Inertial(NamedTuple):
    """Reading of an inertial sensor at the base's origin over a physics step, in the axes of the base."""

    rate: Vector  # mean angular velocity [rad/s]
    change: Vector  # integral of the specific force, in the axes at the end of the step [m/s]


class Estimator(NamedTuple):
    """A way to find place, attitude and motion of the base from a robot's own sensors.

    `scenario.SENSING` names those that scenarios may ask for. The estimate of n robots is a NamedTuple of
    arrays with a row each (`array_table`), which is part of a robot's snapshot. Of the two compiled functions
    the first is called once the inertial unit has been read, and writes place and attitude (`phys.qpos[k,
    :7]`), velocity and angular velocity (`phys.qvel[k, :6]`, in world axes and in those of the base); the
    second once joints, loads and the kinematics that follow from that state are in `phys`, too, and may
    correct the velocity there. What else it learns shows in the next step.
    """

    make: Callable[[int], Any]  # estimate of n robots
    begin: Callable[[Any, int, Array, Array, Array], None]  # estimate, robot, place, attitude, velocity
    predict: Callable[[Any, int, Inertial, Physics, float], None]  # compiled: estimate, k, reading, phys, dt
    correct: Callable[[Any, int, Physics, float], None]  # compiled: estimate, k, phys, dt


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

    `s` is the vertical specific force times dt [m/s]; `tilt` [rad^2], `bias` of the gyro [rad^2/s^2] and
    `velocity` [m^2/s^2] are the variances that these gain.
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


@njit(cache=True, forceinline=True)
def navigate(estimate: BaseEstimate, k: int, inertial: Inertial, dt: float) -> Vector:
    """Move the estimate of robot k on by a physics step; returns its angular velocity, base axes [rad/s].

    q <- q exp(dt (rate - bias)),  v <- v + R(q) change - (g + lift bias) dt z,  p <- p + v dt
    """
    rate = subtract(inertial.rate, vector_in(estimate.gyro_bias, k, 0))
    old = estimate.attitude[k]
    q = normalised(product((old[0], old[1], old[2], old[3]), of_rotation(math3.scaled(rate, dt))))
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


@njit(cache=True, forceinline=True)
def predict(estimate: BaseEstimate, k: int, inertial: Inertial, phys: Physics, dt: float) -> None:
    """`navigate`, and write where the base of robot k is believed to be, and how it moves, into `phys`."""
    rate = navigate(estimate, k, inertial, dt)
    for i in range(3):
        phys.qpos[k, i] = estimate.place[k, i]
        phys.qvel[k, i], phys.qvel[k, 3 + i] = estimate.velocity[k, i], rate[i]
    for i in range(4):
        phys.qpos[k, 3 + i] = estimate.attitude[k, i]


STANDING_DEVIATION = 0.06  # deviation of the velocity of a standing sole [m/s]
ROLL = 0.1  # from the sole's centre to the edge that it may roll over [m]
TURNING = 0.4  # deviation that a sole's velocity is weighed with, over the rate at which the sole turns [m]
LOADED = 60.0  # a sole with less load may move [N], unless it is this share of a light robot's weight
LOADED_SHARE = 0.5
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
    loaded = min(LOADED, LOADED_SHARE * GRAVITY * phys.mass_matrix[k, 0])
    first = 0 if phys.load[k, 0] >= phys.load[k, 1] else 1  # the one that carries more, as in a mirror
    for leg in (first, 1 - first):
        if phys.load[k, leg] < loaded:
            estimate.stood[k, leg] = 0.0
            continue
        sole = sole_motion(phys, k, leg, omega)
        now = vector_in(estimate.velocity, k, 0)
        rest = add(sole.velocity, subtract(now, moved))  # what the other sole has corrected is known
        if _rests(estimate, k, rest, _noise(sole.omega, ROLL)):
            _correct(estimate, k, rest, sole.omega, _noise(sole.omega, TURNING))
            _hold_place(estimate, k, leg, subtract(sole.position, math3.vector_at(phys.xpos, k, PELVIS)), dt)
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
    shift = rotated(math3.conjugate(q), (bias * rest[1], -bias * rest[0], turn * omega[2]))
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


CONTACT_FILTER = Estimator(empty_base_estimate, begin_estimate, predict, listen_to_soles)
