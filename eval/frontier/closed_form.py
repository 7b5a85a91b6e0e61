"""F*, the yardstick of every frontier: the closed-form limit with the paper's robot and step box."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...controllers.model.nominal_gait import NominalGait, nominal_gait
from ...controllers.model.robot import RobotModel
from ...envs.scenario.scenario import Command
from ..rollout.by_name import make_env


def nominal_gait_in_use(env: gym.Env, command: Command) -> NominalGait:
    """Nominal gait of an environment for a command, on left stance (its y axis points right)."""
    unwrapped: Any = env.unwrapped
    return nominal_gait(unwrapped.robot, unwrapped.limits, (command.vx, -command.vy))


def limit_force(env: gym.Env, psi: float, duration: float, command: Command) -> float:
    """F* [N]: what no controller within the paper's limits can exceed.

    Args:
        env: decides the nominal gait.
        psi: direction of the push, counter-clockwise from forward, at the start of a left stance [rad].
        duration: of the push [s].
        command: commanded velocity.
    """
    from ...controllers.model.capturability import max_recoverable_force

    gait = nominal_gait_in_use(env, command)
    return float(max_recoverable_force(RobotModel(), psi, duration, gait=gait))


def limit_curves(
    env_id: str, angles: NDArray[np.float64], duration: float, command: Command
) -> dict[str, NDArray[np.float64]]:
    """Limits [N] over directions (n,) [rad]: F* with foot and flywheel, and that of a point foot."""
    from ...controllers.model.capturability import max_recoverable_force

    env = make_env(env_id)
    gait = nominal_gait_in_use(env, command)
    env.close()
    robot = RobotModel()
    return {
        label: np.array(
            [
                max_recoverable_force(robot, psi, duration, gait=gait, foot=both, flywheel=both)
                for psi in angles
            ]
        )
        for label, both in (("limit F*: foot + flywheel", True), ("limit: point foot", False))
    }
