"""Strapdown navigation: where the inertial sensor says that the base has gone; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..compiled.kernels import njit
from ..compiled.quaternion import normalised, of_rotation, product, rotated
from ..compiled.vector_3 import Vector, add, scaled, subtract, vector_in
from ..model.robot import GRAVITY
from .base_estimate import BaseEstimate, predict_level, predict_lift

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
