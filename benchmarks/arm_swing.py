"""What one swing of waist or arms is worth against a push: python benchmarks/arm_swing.py.

A swing leads from rest to rest, of the waist to the end of its range, of the shoulders from where they are
held to the end of theirs. Its angular momentum L about the CoM moves the CMP by L' / (m g), and with L = 0 at
both ends the DCM, as far as it was off when the swing began, is moved by

    omega^2 / (m g) * integral of L exp(-omega t) dt = 1 / (m h) * integral of dL/dqd exp(-omega t(q)) dq.

The push that this answers is omega times as large, per mass [N s/kg]. The first number is of a swing that
takes no time, the second of the fastest that the motor's torque and speed allow, without gravity: it speeds
up for half of the way and slows down for the other. Positive is what a push forward, or to the right, asks
for.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from flywheel_inertia import momentum, placed
from numpy.typing import NDArray
from push_recovery.envs.robots.compiled_robot import CompiledRobot, compiled_robot
from push_recovery.envs.robots.description import robot_description

PITCH, ROLL = 1, 0  # components of an angular momentum
LOW, HIGH = 0, 1  # ends of a joint's range
POINTS = 61  # of a swing


class Swing(NamedTuple):
    """Joints that swing at the same time, each to one end of its range."""

    name: str
    axis: int  # of the angular momentum that counts
    joints: tuple[str, ...]
    end: int


def of_waist(pitch: str, roll: str) -> tuple[Swing, ...]:
    """Swings of a waist, by the names of its joints."""
    return Swing("waist, pitch", PITCH, (pitch,), HIGH), Swing("waist, roll", ROLL, (roll,), HIGH)


def of_arms(pitch: str, roll: str, sides: tuple[str, str]) -> tuple[Swing, ...]:
    """Swings of shoulders, by the names of their joints after that of the side, left and right."""
    both = sides[0] + pitch, sides[1] + pitch
    return (
        Swing("both arms, forward and up", PITCH, both, LOW),
        Swing("both arms, back and up", PITCH, both, HIGH),
        Swing("left arm, out and up", ROLL, (sides[0] + roll,), HIGH),
    )


SWINGS = {
    "biped": of_waist("waist_pitch", "waist_roll"),
    "g1": of_waist("waist_pitch_joint", "waist_roll_joint")
    + of_arms("shoulder_pitch_joint", "shoulder_roll_joint", ("left_", "right_")),
    "t1": of_arms("Shoulder_Pitch", "Shoulder_Roll", ("Left_", "Right_")),
    "jvrc1": of_waist("WAIST_P", "WAIST_R") + of_arms("SHOULDER_P", "SHOULDER_R", ("L_", "R_")),
}


def times(way: NDArray[np.float64], acceleration: float, speed: float) -> NDArray[np.float64]:
    """When the fastest swing from rest to rest is at each point of its way, (POINTS,) [rad] -> [s]."""
    half = 0.5 * way[-1]
    fast = min(half, 0.5 * speed**2 / acceleration)  # way until it is as fast as it can
    covered = np.minimum(way, way[-1] - way)
    past = np.maximum(covered - fast, 0.0)
    since = np.sqrt(2.0 * np.minimum(covered, fast) / acceleration)
    since += np.divide(past, speed, out=np.zeros_like(past), where=past > 0.0)
    last = math.sqrt(2.0 * fast / acceleration) + (half - fast) / speed
    return np.where(way <= half, since, 2.0 * last - since)


def worth(robot: CompiledRobot, swing: Swing) -> tuple[float, float, float, float]:
    """How far [rad], worth in no time and at the fastest [N s/kg], how long the fastest takes [s]."""
    model, data = robot.model, placed(robot)
    joints = [model.joint(name) for name in swing.joints]
    dofs = [int(joint.dofadr[0]) for joint in joints]
    starts = [float(data.qpos[joint.qposadr[0]]) for joint in joints]
    ends = [float(joint.range[swing.end]) for joint in joints]
    signs = np.sign(np.subtract(ends, starts))
    momenta, inertias = np.empty(POINTS), np.empty(POINTS)
    for i, share in enumerate(np.linspace(0.0, 1.0, POINTS)):
        for joint, start, end in zip(joints, starts, ends, strict=True):
            data.qpos[joint.qposadr[0]] = start + share * (end - start)
        mujoco.mj_forward(model, data)
        inertias[i] = data.M[model.M_rowadr[dofs[0]] + model.M_rownnz[dofs[0]] - 1]
        momenta[i] = sum(
            s * momentum(robot, data, dof)[swing.axis] for s, dof in zip(signs, dofs, strict=True)
        )
    motor = model.actuator(swing.joints[0])
    acceleration = float(motor.forcerange[1]) / float(inertias.max())
    way = np.linspace(0.0, abs(ends[0] - starts[0]), POINTS)
    speed = float(motor.user[0]) if len(motor.user) and motor.user[0] > 0.0 else 1e3
    at, planned = times(way, acceleration, speed), robot.robot
    scale = planned.omega / (planned.mass * planned.com_height)
    discounted = momenta * np.exp(-planned.omega * at)
    at_once, fastest = (scale * float(np.trapezoid(moved, way)) for moved in (momenta, discounted))
    return float(way[-1]), at_once, fastest, float(at[-1])


def main() -> None:
    """Print the table."""
    print("| robot | swing | angle [rad] | in no time [N s/kg] | fastest [N s/kg] | takes [s] |")
    print("|---|---|---|---|---|---|")
    for name, swings in SWINGS.items():
        robot = compiled_robot(robot_description(name))
        for swing in swings:
            way, at_once, fastest, duration = worth(robot, swing)
            print(f"| {name} | {swing.name} | {way:.2f} | {at_once:.3f} | {fastest:.3f} | {duration:.2f} |")


if __name__ == "__main__":
    main()
