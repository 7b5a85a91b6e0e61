"""Gait state machine of n bipeds: touchdown, swing foot, CoM task, pushes; compiled, every physics step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..controllers.swing_foot import swing_update
from .biped_kinematics import (
    ANKLE_HEIGHT,
    LEG_JOINT,
    PELVIS,
    TRUNK,
    Array,
    Ints,
    Physics,
    com_velocity,
    cross_into,
    sole_position,
)
from .push import mean_force, resolve_starts
from .push_batch import Pushes
from .whole_body import Gains, Task, whole_body_torque
from .wrench_bounds import Bounds

FAILURES = ("", "com_height", "pelvis_tilt", "not_finite")
LOWEST = 0.6  # of the CoM's height
STEEPEST = 0.5  # cosine of the pelvis' lean
PUSHED_BODY = (PELVIS, TRUNK)  # in the order of push.BODIES


class Gait(NamedTuple):
    """State of the gait machine of n robots."""

    stance: Ints  # (n,) 0 left, 1 right
    steps: Ints  # (n,) completed steps
    elapsed: Array  # (n,) since the step began [s]
    time: Array  # (n,) since reset [s]
    heading: Array  # (n,) [rad]
    swing: Array  # (n, 9) reference of the swing sole: position, velocity, acceleration
    height: Array  # (n,) reference of the CoM's height [m]
    plan: Array  # (n, 7) gait variables, held for a planning period
    failure: Ints  # (n,) index into FAILURES
    wrench: Array  # (n, 6) that the last torque asks of the stance sole


class GaitSettings(NamedTuple):
    """Constants of the gait machine."""

    omega: float  # [1/s]
    com_height: float  # [m]
    cmp_gain: float  # j / (m g) [m s^2]
    mass: float  # [kg]
    apex: float = 0.0575  # height of the swing sole in mid-step [m]
    landing_delay: float = 0.005  # the swing sole aims at the floor this long after T [s]
    commit: float = 0.055  # place and time of the step are final from T - this [s]
    early: float = 0.003  # contact counts as touchdown from T - this [s]
    early_load: float = 20.0  # with this load [N]
    forced_load: float = 150.0  # or with this load, late in the step
    forced_phase: float = 0.6  # fraction of T from which forced_load counts
    descent: float = 0.3  # of the swing foot when late [m/s]
    reach: float = 0.673  # longest leg, hip to ankle [m]
    height_drop: float = 0.162  # how far the CoM is lowered for a long step [m]
    height_time: float = 0.05  # time constant of the height reference [s]


@njit(cache=True)
def side_sign(stance: int) -> float:
    """Sign in world y of the canonical y, which points from the stance foot to the swing side."""
    return -1.0 if stance == 0 else 1.0


@njit(cache=True)
def accept(gait: Gait, k: int, s: GaitSettings, asked: Array, action: Array, previous: Array) -> None:
    """Take over the asked gait (7,) of one robot, and its action (7,) as the previous one.

    A swing foot about to land is committed: place and time of the step stay, whoever asks for others.
    """
    first = 3 if gait.plan[k, 2] - gait.elapsed[k] < s.commit else 0
    for i in range(first, asked.shape[0]):
        gait.plan[k, i] = asked[i]
        previous[i] = action[i]


@njit(cache=True)
def touch_down(phys: Physics, gait: Gait, k: int) -> None:
    """Exchange the feet; what is held of the plan is mirrored into the new frame, its CoP centred."""
    old = gait.stance[k]
    gait.stance[k] = 1 - old
    gait.steps[k] += 1
    gait.elapsed[k] = 0.0
    gait.swing[k, :3] = sole_position(phys, k, old)
    gait.swing[k, 3:] = 0.0
    gait.plan[k, 3:5] = 0.0
    gait.plan[k, 6] = -gait.plan[k, 6]


@njit(cache=True)
def has_landed(load: float, elapsed: float, duration: float, s: GaitSettings) -> bool:
    """Touchdown of the swing foot: loaded near T, or loaded heavily late in the step."""
    if elapsed >= duration - s.early:
        return load > s.early_load
    return elapsed > s.forced_phase * duration and load > s.forced_load


@njit(cache=True)
def reach_height(
    phys: Physics, k: int, stance: int, sole: Array, target: Array, travel: Array, s: GaitSettings
) -> float:
    """CoM height [m] at which both legs reach their soles at touchdown; moves the target within reach.

    A leg of length r whose hip is d beside its ankle lets the hip be sqrt(r^2 - d^2) above it.
    """
    height = s.com_height
    for leg in range(2):
        hip = phys.xanchor[k, LEG_JOINT[leg]]
        above = hip[2] - phys.com[k, 0, 2] - ANKLE_HEIGHT  # of the hip over the CoM, less the ankle's
        lowest = s.com_height - s.height_drop + above
        farthest = np.sqrt(max(s.reach**2 - lowest**2, 0.0))
        for moment in range(2):
            if leg == stance:
                dx = sole[0] - hip[0] - moment * travel[0]
                dy = sole[1] - hip[1] - moment * travel[1]
            elif moment == 1:
                dx = target[0] - hip[0] - travel[0]
                dy = target[1] - hip[1] - travel[1]
            else:
                continue
            d = np.hypot(dx, dy)
            if d > farthest:
                if leg != stance:
                    target[0] -= dx * (1.0 - farthest / d)
                    target[1] -= dy * (1.0 - farthest / d)
                d = farthest
            height = min(height, np.sqrt(s.reach**2 - d**2) - above)
    return max(height, s.com_height - s.height_drop)


@njit(cache=True)
def walk(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, gains: Gains, bounds: Bounds, index: Ints, dt: float,
    torque: Array,
) -> None:  # fmt: skip
    """Swing foot, CoM acceleration of the pendulum and whole-body torque of one robot."""
    stance, plan = gait.stance[k], gait.plan[k]
    sign = side_sign(stance)
    cos, sin = np.cos(gait.heading[k]), np.sin(gait.heading[k])
    sole = sole_position(phys, k, stance)
    com, velocity = phys.com[k, 0], com_velocity(phys, k, index)
    # acceleration = omega^2 (com - cmp), eq. 4
    dx, dy = com[0] - sole[0], com[1] - sole[1]
    lever_x = cos * dx + sin * dy - plan[3] - s.cmp_gain * plan[5]
    lever_y = -sin * dx + cos * dy - sign * (plan[4] + s.cmp_gain * plan[6])
    lever = np.array([cos * lever_x - sin * lever_y, sin * lever_x + cos * lever_y])
    target, travel = np.empty(2), np.empty(2)
    width = sign * plan[1]
    target[0] = sole[0] + cos * plan[0] - sin * width
    target[1] = sole[1] + sin * plan[0] + cos * width
    # travel of the CoM until touchdown, were the CMP to stay
    remaining = max(plan[2] - gait.elapsed[k], 0.0)
    rise, run = np.cosh(s.omega * remaining) - 1.0, np.sinh(s.omega * remaining) / s.omega
    for i in range(2):
        travel[i] = lever[i] * rise + velocity[i] * run
    height = reach_height(phys, k, stance, sole, target, travel, s)
    gait.height[k] += (height - gait.height[k]) * min(dt / s.height_time, 1.0)
    swing_update(
        gait.swing[k], target[0], target[1], gait.elapsed[k], plan[2] + s.landing_delay, dt, s.apex, s.descent
    )
    waist = np.array([plan[5], -sign * plan[6]])
    task = Task(stance, s.omega**2 * lever, gait.height[k], gait.heading[k], gait.swing[k], waist)
    gait.wrench[k] = whole_body_torque(phys, k, task, velocity[2], gains, bounds, index, torque)


@njit(cache=True)
def apply_pushes(
    phys: Physics, gait: Gait, k: int, pushes: Pushes, dt: float, force: Array, torque: Array
) -> None:
    """Write the mean push over the coming physics step into the external forces of one robot."""
    now = gait.time[k]
    resolve_starts(
        pushes.start[k], pushes.step[k], pushes.fraction[k], gait.steps[k], now - gait.elapsed[k],
        gait.plan[k, 2], now, now + dt,
    )  # fmt: skip
    for body in PUSHED_BODY:
        phys.xfrc[k, body] = 0.0
    arm = np.empty(3)
    for i in range(pushes.start.shape[1]):
        if mean_force(pushes.force[k], pushes.duration[k], pushes.start[k], i, now, now + dt, force):
            body = PUSHED_BODY[pushes.body[k, i]]
            R = phys.xmat[k, body]
            for a in range(3):
                arm[a] = 0.0
                for b in range(3):
                    arm[a] += R[3 * a + b] * pushes.offset[k, i, b]
            cross_into(arm, force, torque)
            for a in range(3):
                phys.xfrc[k, body, a] += force[a]
                phys.xfrc[k, body, 3 + a] += torque[a]
                pushes.delivered[k, i, a] += force[a] * dt


@njit(cache=True)
def control(
    phys: Physics, gait: Gait, k: int, pushes: Pushes, s: GaitSettings, gains: Gains, bounds: Bounds,
    index: Ints, dt: float,
) -> None:  # fmt: skip
    """One physics step's torques and pushes of one robot: writes phys.ctrl and phys.xfrc."""
    force, moment = np.empty(3), np.empty(3)
    if has_landed(phys.load[k, 1 - gait.stance[k]], gait.elapsed[k], gait.plan[k, 2], s):
        touch_down(phys, gait, k)
    walk(phys, gait, k, s, gains, bounds, index, dt, phys.ctrl[k])
    apply_pushes(phys, gait, k, pushes, dt, force, moment)
    gait.elapsed[k] += dt
    gait.time[k] += dt


@njit(cache=True)
def check_failure(phys: Physics, gait: Gait, k: int, s: GaitSettings) -> None:
    """Mark a robot that has fallen: CoM too low, or pelvis leaning by more than 60 degrees."""
    if gait.failure[k] != 0:
        return
    height = phys.com[k, 0, 2] - sole_position(phys, k, gait.stance[k])[2]
    if not np.isfinite(height):
        gait.failure[k] = 3
    elif height < LOWEST * s.com_height:
        gait.failure[k] = 1
    elif phys.xmat[k, PELVIS, 8] < STEEPEST:
        gait.failure[k] = 2
