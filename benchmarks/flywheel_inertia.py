"""The angular momentum that turning the upper body gives: python benchmarks/flywheel_inertia.py.

In the walking posture, soles and CoM at rest: dL / d(rate) about the CoM, of the waist's pitch and roll, and
of pelvis and trunk together about the hips [kg m^2], beside the inertia that the planner counts on, which is
that of all that the waist carries about its axis. L / (m h) is the change of velocity that it is worth.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from push_recovery.envs.biped.posture import jacobian_of_com_and_soles, posture
from push_recovery.envs.robots.compiled_robot import CompiledRobot, compiled_robot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.robots.indices import MISSING

ROBOTS = ("biped", "g1", "t1", "jvrc1")
AXES = 1, 0  # pitch and roll, as components of an angular momentum


def placed(robot: CompiledRobot) -> mujoco.MjData:
    """The robot at its walking height on two soles."""
    model, half = robot.robot, 0.5 * robot.robot.pelvis_width
    soles = np.array([[0.0, half, 0.0], [0.0, -half, 0.0]])
    data = mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:] = posture(robot, np.array([0.0, 0.0, model.com_height]), np.zeros(3), soles)
    mujoco.mj_forward(robot.model, data)
    return data


def momentum(robot: CompiledRobot, data: mujoco.MjData, dof: int) -> NDArray[np.float64]:
    """Angular momentum about the CoM, (3,) [kg m^2/s], at 1 rad/s of one joint; legs keep soles and CoM."""
    model, indices, rows = robot.model, robot.indices, jacobian_of_com_and_soles(robot, data)
    data.qvel[:] = 0.0
    data.qvel[dof] = 1.0
    data.qvel[indices.moving_dof] = np.linalg.solve(rows[:, indices.moving_dof], -rows[:, dof])
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return data.subtree_angmom[indices.pelvis].copy()


def main() -> None:
    """Print the table."""
    print("| robot | the planner's | waist pitch | waist roll | all about the hips, pitch | roll |")
    print("|---|---|---|---|---|---|")
    for name in ROBOTS:
        robot = compiled_robot(robot_description(name))
        data, model, cells = placed(robot), robot.robot, []
        for joint, axis in zip(robot.indices.joints[1:3], AXES, strict=True):
            dof = int(robot.model.jnt_dofadr[joint])
            cells.append(0.0 if joint == MISSING else abs(momentum(robot, data, dof)[axis]))
        cells += [abs(momentum(robot, data, 3 + axis)[axis]) for axis in AXES]  # of the pelvis
        told = f"{model.trunk_inertia:.2f}" if cells[0] or cells[1] else "-"
        print(f"| {name} | {told} | " + " | ".join(f"{cell:.2f}" if cell else "-" for cell in cells) + " |")


if __name__ == "__main__":
    main()
