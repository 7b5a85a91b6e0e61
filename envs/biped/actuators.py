"""Drives and battery: the torques that come of those asked for, at the speed, warmth and power of the moment.

A drive follows its torque-speed line at the speed that its joint has when the torque acts, however late that
is. A joint that is driven beyond its speed without load, by the rest of the body or by a blow, is braked: the
line goes on below zero, as the voltage that the motor induces is above the battery's. In a step dt

    tau = -s (|w| - w_0) / (1 + s dt / I),    at most the largest torque,

s the slope of the line and I the joint's inertia, the others held; the denominator is that of an implicit
step, without which so steep a brake (s dt / I is 2 to 10) would overshoot.

The winding warms with the square of the torque, T d(warmth)/dt = (tau / tau_c)^2 - warmth, so that 1 is what
it comes to under its continuous torque tau_c. From DERATED on less than the largest torque is allowed, at 1
tau_c.
"""

from __future__ import annotations

import math

from ...controllers.array_table import Floats2, Floats3
from ...controllers.jit import njit
from ...controllers.whole_body.kinematics import NU, NV, Array, Physics
from ...controllers.whole_body.limits import FULL_TORQUE_SHARE, driving_share


@njit(cache=True)
def limit_power(phys: Physics, k: int, torque: Array, each: float, together: float) -> None:
    """Lower the driving ones of torques (14,) until no motor gives more than `each` [W], all than `together`.

    The power of a motor is its torque times its joint's rate, P_i = tau_i w_i; braking takes and returns
    none. Where sum max(P_i, 0) is above the battery's power, all driving torques are scaled alike.
    """
    total = 0.0
    for i in range(NU):
        power = torque[i] * phys.qvel[k, NV - NU + i]
        if power > each:
            torque[i] *= each / power
            power = each
        total += max(power, 0.0)
    if total <= together:
        return
    for i in range(NU):
        if torque[i] * phys.qvel[k, NV - NU + i] > 0.0:
            torque[i] *= together / total


LARGEST, FREE_SPEED, INERTIA = 0, 1, 2  # rows of a robot's `motors` [N m], [rad/s], [kg m^2] (0: no joint)
EACH, TOGETHER, CONTINUOUS = 0, 1, 2  # columns of `power` [W], [W], and of the largest torque, that lasts
HEATING = 40.0  # time constant of a winding [s], our choice: long beside a recovery, short beside a walk
DERATED = 0.9  # warmth from which a drive gives less


@njit(cache=True)
def allowed_share(warmth: float, continuous: float) -> float:
    """Share of its largest torque that a drive allows its motor."""
    hot = min(max((warmth - DERATED) / (1.0 - DERATED), 0.0), 1.0)
    return 1.0 - (1.0 - continuous) * hot


@njit(cache=True)
def over_speed_brake(over: float, top: float, free_speed: float, inertia: float, dt: float) -> float:
    """Torque with which a motor brakes that turns faster by `over` [rad/s] than without load [N m]."""
    slope = top / ((1.0 - FULL_TORQUE_SHARE) * free_speed)
    return min(slope * over / (1.0 + slope * dt / inertia), top)


@njit(cache=True, forceinline=True)
def braked_torque(
    torque: float, speed: float, largest: float, free_speed: float, inertia: float, dt: float
) -> float:
    """Torque of a motor, or its brake where its joint is faster than without load [N m]."""
    over = abs(speed) - free_speed
    if over <= 0.0 or inertia == 0.0:
        return torque
    brake = over_speed_brake(over, largest, free_speed, inertia, dt)
    return min(torque, -brake) if speed > 0.0 else max(torque, brake)


@njit(cache=True, forceinline=True)
def brake_joints(phys: Physics, k: int, motors: Floats3, dt: float) -> None:
    """Brake the joints of robot k that are faster than without load.

    Torques that act at once are held to the rest of the line by control.
    """
    for i in range(NU):
        phys.ctrl[k, i] = braked_torque(
            phys.ctrl[k, i], phys.qvel[k, NV - NU + i], motors[k, LARGEST, i], motors[k, FREE_SPEED, i],
            motors[k, INERTIA, i], dt,
        )  # fmt: skip


@njit(cache=True)
def given_torque(asked: float, speed: float, motor: Array, share: float, dt: float) -> float:
    """Torque of one drive [N m].

    Args:
        asked: torque [N m].
        speed: of its joint [rad/s].
        motor: (3,) largest torque, speed without load, inertia.
        share: of the largest torque, which it allows.
        dt: for which the torque is held [s].
    """
    top, free_speed = share * motor[LARGEST], motor[FREE_SPEED]
    towards = math.copysign(1.0, speed)
    torque = towards * asked  # in the direction of motion
    torque = max(min(torque, top * driving_share(abs(speed), free_speed)), -top)
    return braked_torque(towards * torque, speed, motor[LARGEST], free_speed, motor[INERTIA], dt)


@njit(cache=True)
def warm(warmth: Array, torque: Array, largest: Array, continuous: float, dt: float) -> None:
    """Let windings (n,) warm under torques (n,) for dt, of which `continuous` times the largest lasts."""
    for i in range(warmth.shape[0]):
        load = torque[i] / (continuous * largest[i])
        warmth[i] += dt / HEATING * (load * load - warmth[i])


@njit(cache=True)
def limit_torques(
    phys: Physics, k: int, motors: Floats3, power: Floats2, warmth: Floats2, torque: Array, dt: float
) -> None:
    """Replace torques asked of robot k (14,) by those that its drives give for dt, and warm its windings.

    Args:
        phys: of all robots, with the true rates of their joints.
        k: the robot.
        motors: (n, 3, 14), see LARGEST.
        power: (n, 3), see EACH.
        warmth: (n, 14) of the windings.
        torque: (14,) [N m].
        dt: [s].
    """
    continuous = power[k, CONTINUOUS]
    for i in range(NU):
        share = allowed_share(warmth[k, i], continuous)
        torque[i] = given_torque(torque[i], phys.qvel[k, NV - NU + i], motors[k, :, i], share, dt)
    limit_power(phys, k, torque, power[k, EACH], power[k, TOGETHER])
    if continuous < 1.0:
        warm(warmth[k], torque, motors[k, LARGEST], continuous, dt)
