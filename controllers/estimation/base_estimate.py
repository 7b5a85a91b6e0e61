"""Where n robots believe their bases to be, how these move, and how sure they are of it.

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
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.array_table import Floats1, Floats2, Floats3
from ..compiled.kernels import njit

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
