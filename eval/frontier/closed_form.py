"""F*, the yardstick of every frontier: the closed-form limit of two boxes of steps, each named.

The robot's own box says what its controller could at best have reached. The paper's (Tables I and II, l_p
0.2 m, foot 0.2 x 0.1 m) is the same for every robot and cannot be moved by choosing other limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from ...controllers.model.capturability import max_recoverable_force
from ...controllers.model.nominal_gait import NominalGait, nominal_gait
from ...controllers.model.robot import RobotModel
from ...envs.scenario.scenario import Command

OWN, PAPER, POINT_FOOT = "F* of the robot's own box", "F* of the paper's box", "own box, point foot"


@dataclass(frozen=True)
class DirectionLimits:
    """F* in one direction [N]."""

    own: float  # of the robot's own gait limits
    paper: float  # of the paper's robot and gait limits

    @staticmethod
    def share(force: float, limit: float) -> float | None:
        """A force [N] as a share of a limit [N]; None where the limit is 0."""
        return force / limit if limit > 0 else None


def nominal_gait_in_use(env: gym.Env, command: Command) -> NominalGait:
    """Nominal gait of an environment for a command, on left stance (its y axis points right)."""
    unwrapped: Any = env.unwrapped
    return nominal_gait(unwrapped.robot, unwrapped.limits, (command.vx, -command.vy))


def own_limit_force(
    env: gym.Env, psi: float, duration: float, command: Command, point_foot: bool = False
) -> float:
    """F* [N] of the environment's own robot and gait limits; arguments as for `limit_force`.

    A point foot has no sole to shift the CoP in and no trunk to swing.
    """
    unwrapped: Any = env.unwrapped
    gait, moved = nominal_gait_in_use(env, command), not point_foot
    return float(
        max_recoverable_force(
            unwrapped.robot, psi, duration, limits=unwrapped.limits, gait=gait, foot=moved, flywheel=moved
        )
    )


def limit_force(env: gym.Env, psi: float, duration: float, command: Command) -> float:
    """F* [N] within the paper's limits, from the nominal gait of the environment.

    Args:
        env: decides the nominal gait.
        psi: direction of the push, counter-clockwise from forward, at the start of a left stance [rad].
        duration: of the push [s].
        command: commanded velocity.
    """
    gait = nominal_gait_in_use(env, command)
    return float(max_recoverable_force(RobotModel(), psi, duration, gait=gait))


def direction_limits(env: gym.Env, psi_deg: float, duration: float, command: Command) -> DirectionLimits:
    """Both limits towards psi [deg]; the other arguments as for `limit_force`."""
    push = math.radians(psi_deg), duration, command
    return DirectionLimits(own_limit_force(env, *push), limit_force(env, *push))


def limit_curves(
    env: gym.Env, psi_deg: list[float], duration: float, command: Command
) -> dict[str, list[float]]:
    """Limits [N] over directions [deg]: both yardsticks, and the own box with a point foot."""
    limits = [direction_limits(env, psi, duration, command) for psi in psi_deg]
    angles = map(math.radians, psi_deg)
    return {
        OWN: [limit.own for limit in limits],
        PAPER: [limit.paper for limit in limits],
        POINT_FOOT: [own_limit_force(env, psi, duration, command, point_foot=True) for psi in angles],
    }
