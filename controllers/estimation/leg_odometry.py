"""What standing soles tell the estimate of the base: a loaded sole rests; compiled, every physics step.

The velocity of a sole follows from the base's and the joints' rates; where it stands it is zero, and what is
left is the error of the base's velocity. A sole that carries no load, or whose velocity lies further from
zero than noise explains (it slides, rolls or has just hit the floor), is left out: the base then moves as the
inertial sensor says. A sole that stands keeps its place, which ties the base's place to the floor.
"""

from __future__ import annotations

import math

from ..compiled.kernels import njit
from ..compiled.quaternion import conjugate, normalised, of_rotation, product, rotated
from ..compiled.vector_3 import Vector, add, subtract, vector_at, vector_in
from ..whole_body.kinematics import PELVIS, Physics, base_angular_velocity, sole_motion
from .base_estimate import LIFT_VV, VV, BaseEstimate, update_level, update_lift

STANDS = 0.06  # deviation of the velocity of a standing sole [m/s]
ROLL = 0.1  # from the sole's centre to the edge that it may roll over [m]
TURNING = 0.4  # deviation that a sole's velocity is weighed with, over the rate at which the sole turns [m]
LOADED = 60.0  # a sole with less load may move [N]
GATE = 3.0  # deviations that a standing sole's velocity may lie from zero
DOUBT = 0.02  # variance that velocity gains while a loaded sole is left out [m^2/s^3]
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
            estimate.level[k, VV] += DOUBT * dt
            estimate.lift[k, LIFT_VV] += DOUBT * dt
            estimate.stood[k, leg] = max(estimate.stood[k, leg] - ANCHOR_LOSS * dt, 0.0)
    if not stands:
        estimate.spread[k] = (math.sqrt(estimate.spread[k]) + dt * math.sqrt(estimate.level[k, VV])) ** 2
    for i in range(3):
        phys.qvel[k, i] = estimate.velocity[k, i]


@njit(cache=True, forceinline=True)
def _noise(omega: Vector, lever: float) -> float:
    """Variance of the velocity of a standing sole that turns at omega, with a deviation over it [m^2/s^2]."""
    return STANDS**2 + lever**2 * (omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)


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
