"""Steps of a robot that no planner leads, told by its contacts alone.

Stance side, time in the step and touchdown are what every episode is judged by. Under a gait they are those
of the gait machine; here the same machine is led by the loads under the feet. The plan that it holds is the
nominal gait of the command, and a touchdown is the same one (`has_landed`: near T, or under heavy load late
in the step), of a foot that has been off the floor since the step began. A robot that stands on both feet
makes no steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.kernels import njit
from ..model.gait_box import COP, DURATION, STEP, GaitLimits
from ..model.nominal_gait import NOMINAL_DURATION, NOMINAL_SIZE, NOMINAL_STEP, nominal_gait_kernel
from ..model.observation import COMMAND
from ..model.robot import RobotModel
from ..whole_body.gait_machine import Gait, GaitSettings, has_landed, touch_down
from ..whole_body.kinematics import Array, Physics
from ..whole_body.turning import SWING
from .drives import Joints

UNLOADED = 1.0  # load under a foot that is off the floor, at most [N]
LIFTED = 10  # physics steps without load after which a foot counts as lifted: 20 ms

_COMMAND = COMMAND.start
_BOX = 3  # bounds of step length, width and duration
_LOW = 4  # where they begin


class NominalConstants(NamedTuple):
    """What the nominal gait follows from; then the low and the high bounds of the step."""

    omega: float  # [1/s]
    pelvis_width: float  # [m]
    delay: float  # of touchdown [s]
    double_support: float  # [s]


def nominal_constants(robot: RobotModel, limits: GaitLimits, delay: float) -> Array:
    """`NominalConstants` and the bounds of the step, (10,)."""
    constants = NominalConstants(robot.omega, robot.pelvis_width, delay, 0.0)
    return np.array([*constants, *limits.low[:_BOX], *limits.high[:_BOX]])


@njit(cache=True, forceinline=True)
def hold_nominal(gait: Gait, k: int, observation: Array, constants: Array) -> None:
    """Hold the nominal step of the command that the observation (36,) of robot k repeats."""
    nominal = np.empty(NOMINAL_SIZE)
    nominal_gait_kernel(
        observation[_COMMAND], observation[_COMMAND + 1], constants[1], constants[_LOW : _LOW + _BOX],
        constants[_LOW + _BOX :], constants[0], constants[2], nominal, constants[3],
    )  # fmt: skip
    plan = gait.plan[k]
    plan[STEP], plan[STEP + 1] = nominal[NOMINAL_STEP], nominal[NOMINAL_STEP + 1]
    plan[DURATION] = nominal[NOMINAL_DURATION]
    plan[COP:] = 0.0


@njit(cache=True, forceinline=True)
def follow_contacts(phys: Physics, gait: Gait, k: int, s: GaitSettings, joints: Joints) -> None:
    """Exchange the feet of robot k where its swing foot has landed.

    That foot was lifted in this step, or the stance foot is now: the robot then stands on the other. The
    heading goes on by what the command asked for in the step.
    """
    stance, air = gait.stance[k], joints.air[k]
    for leg in range(2):
        air[leg] = air[leg] + 1 if phys.load[k, leg] <= UNLOADED else 0
    if air[1 - stance] >= LIFTED:
        joints.lifted[k] = 1
    if joints.lifted[k] == 0 and air[stance] < LIFTED:
        return
    if has_landed(phys.load[k, 1 - stance], gait.elapsed[k], gait.plan[k, DURATION], s):
        gait.yaw[k, SWING] = gait.turn[k] * gait.elapsed[k]
        touch_down(phys, gait, k)
        joints.lifted[k] = 0
