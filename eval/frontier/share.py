"""How large a push is beside the largest that the closed form leaves to any controller at that moment."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.model.capturability import recoverable_offset
from ...controllers.model.nominal_gait import nominal_gait
from ...controllers.model.nominal_start import step_start_dcm
from ...envs.scenario.push import GaitEvent, Push
from ...envs.scenario.scenario import Command


def limit_share(env: gym.Env, push: Push, command: Command) -> float | None:
    """The push as a share of F* of the robot's own box, at its moment of the nominal step.

    A force F for a time d counts as a shift of the DCM by F (1 - exp(-omega d)) / (m omega^2) when it begins.
    The share is that by which the shift must be divided so that the DCM ends on the nearest of its bounds;
    at the start of a left stance it is F / F* of the frontier. The pendulum's limit: no turn, no legs.

    Args:
        env: its robot and gait limits.
        push: at a moment of the gait.
        command: commanded velocity.

    Returns:
        None where there is no such limit: the push comes at a time, or the unpushed gait is out of bounds.
    """
    if not isinstance(push.start, GaitEvent):
        return None
    unwrapped: Any = env.unwrapped
    robot, limits = unwrapped.robot, unwrapped.limits
    swing = -1.0 if push.start.side == "left" else 1.0  # side of the swing foot, left is positive
    gait = nominal_gait(robot, limits, (command.vx, swing * command.vy))
    elapsed = push.start.fraction * gait.duration
    start = np.array(step_start_dcm(gait, robot.pelvis_width, robot.omega)) * math.exp(robot.omega * elapsed)
    force = np.array([push.force[0], swing * push.force[1]])
    shift = force * -math.expm1(-robot.omega * push.duration) / (robot.mass * robot.omega**2)
    bounds = recoverable_offset(robot, limits, elapsed)
    room = np.where(shift > 0.0, bounds.high - start, start - bounds.low)
    if (room <= 0.0).any():
        return None
    return float(np.max(np.abs(shift) / room))
