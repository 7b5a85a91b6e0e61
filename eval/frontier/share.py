"""How large a push is beside the largest that the closed form leaves to any controller at that moment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...controllers.model.capturability import recoverable_offset
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.nominal_gait import nominal_gait
from ...controllers.model.nominal_start import step_start_dcm
from ...controllers.model.robot import RobotModel
from ...envs.scenario.push import GaitEvent, Push
from ...envs.scenario.scenario import Command


@dataclass(frozen=True)
class PushedStart:
    """A nominal step when a push begins, in its canonical frame."""

    elapsed: float  # of the step [s]
    dcm: NDArray[np.float64]  # (2,) [m]
    shift: NDArray[np.float64]  # (2,) that the push counts as [m]


def pushed_start(robot: RobotModel, limits: GaitLimits, push: Push, command: Command) -> PushedStart | None:
    """Where a push finds the DCM, and what it does to it: F (1 - exp(-omega d)) / (m omega^2).

    None for a push at a time, whose step is not known.
    """
    if not isinstance(push.start, GaitEvent):
        return None
    swing = -1.0 if push.start.side == "left" else 1.0  # side of the swing foot, left is positive
    gait = nominal_gait(robot, limits, (command.vx, swing * command.vy))
    elapsed = push.start.fraction * gait.duration
    dcm = np.array(step_start_dcm(gait, robot.pelvis_width, robot.omega)) * math.exp(robot.omega * elapsed)
    force = np.array([push.force[0], swing * push.force[1]])
    shift = force * -math.expm1(-robot.omega * push.duration) / (robot.mass * robot.omega**2)
    return PushedStart(elapsed, dcm, shift)


def limit_share(env: gym.Env, push: Push, command: Command) -> float | None:
    """The push as a share of F* of the robot's own box, at its moment of the nominal step.

    The share is that by which the shift of `pushed_start` must be divided so that the DCM ends on the nearest
    of its bounds; at the start of a left stance it is F / F* of the frontier. The pendulum's limit: no turn,
    no legs.

    Args:
        env: its robot and gait limits.
        push: at a moment of the gait.
        command: commanded velocity.

    Returns:
        None where there is no such limit: the push comes at a time, or the unpushed gait is out of bounds.
    """
    unwrapped: Any = env.unwrapped
    start = pushed_start(unwrapped.robot, unwrapped.limits, push, command)
    if start is None:
        return None
    bounds = recoverable_offset(unwrapped.robot, unwrapped.limits, start.elapsed)
    room = np.where(start.shift > 0.0, bounds.high - start.dcm, start.dcm - bounds.low)
    if (room <= 0.0).any():
        return None
    return float(np.max(np.abs(start.shift) / room))
