"""Yardsticks of a push: the closed-form limit F* of two boxes of steps, and F*_stand of who takes none.

F* of the robot's own box of steps says what its controller could at best have reached. F* of the paper's box
(Tables I and II, l_p 0.2 m, foot 0.2 x 0.1 m) is the same for every robot and cannot be moved by choosing
other limits.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.model.capturability import max_recoverable_force, recoverable_offset
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.nominal_gait import NominalGait, nominal_gait, step_start_dcm
from ...controllers.model.robot import RobotModel
from ...controllers.model.standing import max_standing_force
from ...envs.scenario.push import GaitEvent, Push, polar_push
from ...envs.scenario.scenario import Command, Scenario
from .draw import feet_at_first

NOMINAL_STEPS = 4  # before the push

OWN, PAPER, POINT_FOOT = "F* of the robot's own box", "F* of the paper's box", "own box, point foot"
STAND = "F*_stand of the robot's own soles and trunk"
PHASES = "F* of the robot's own box at 0.8 of the phases"


@dataclass(frozen=True)
class DirectionLimits:
    """F* and F*_stand in one direction [N]."""

    own: float  # of the robot's own gait limits
    paper: float  # of the paper's robot and gait limits
    stand: float  # of the robot's own soles and trunk, at rest on both feet, without a step
    phases: float | None = None  # own, up to which a share of replicas is within its limit; None: no phases


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


def standing_limit_force(env: gym.Env, psi: float, duration: float) -> float:
    """F*_stand [N] of the environment's own soles and trunk; arguments as for `limit_force`."""
    unwrapped: Any = env.unwrapped
    return max_standing_force(unwrapped.robot, psi, duration, limits=unwrapped.limits)


def direction_limits(env: gym.Env, psi_deg: float, duration: float, command: Command) -> DirectionLimits:
    """All limits towards psi [deg]; the other arguments as for `limit_force`."""
    push = math.radians(psi_deg), duration, command
    stand = standing_limit_force(env, *push[:2])
    return DirectionLimits(own_limit_force(env, *push), limit_force(env, *push), stand)


def limit_curves(
    env: gym.Env, psi_deg: Sequence[float], duration: float, command: Command
) -> dict[str, list[float]]:
    """Limits [N] over directions [deg]: both yardsticks, the own box with a point foot, and F*_stand."""
    pushes = [(math.radians(psi), duration, command) for psi in psi_deg]
    return {
        OWN: [own_limit_force(env, *push) for push in pushes],
        PAPER: [limit_force(env, *push) for push in pushes],
        POINT_FOOT: [own_limit_force(env, *push, point_foot=True) for push in pushes],
        STAND: [standing_limit_force(env, *push[:2]) for push in pushes],
    }


@dataclass(frozen=True)
class PushedStart:
    """A nominal step when a push begins, in its canonical frame."""

    elapsed: float  # of the step [s]
    dcm: np.ndarray  # (2,) [m]
    shift: np.ndarray  # (2,) that the push counts as [m]


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
    no legs. None where there is no such limit: the push comes at a time, or the unpushed gait is out of
    bounds.
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


def limit_of_phases(
    env: gym.Env, psi: float, duration: float, command: Command, phases: Sequence[float], share: float
) -> float:
    """Largest force that is at most F* of the own box at a share of phases of the pushed step [N].

    Args:
        env: the robot and its box.
        psi: direction [rad].
        duration: of the push [s].
        command: commanded velocity.
        phases: in [0, 1].
        share: of them, in (0, 1].
    """
    pushes = (polar_push(1.0, psi, duration, GaitEvent(NOMINAL_STEPS, "left", phase)) for phase in phases)
    shares = (limit_share(env, push, command) for push in pushes)
    rising = sorted(0.0 if one is None else 1.0 / one for one in shares)
    return rising[len(rising) - math.ceil(share * len(rising) - 1e-9)]


def standing_share(env: gym.Env, scenario: Scenario) -> float:
    """The first push of a scenario in which the robot stands at rest, as a share of its own F*_stand."""
    unwrapped: Any = env.unwrapped
    robot, push = unwrapped.robot, scenario.pushes[0]
    feet = feet_at_first(robot, scenario.stance_side, scenario.stride)
    limit = max_standing_force(robot, push.direction, push.duration, limits=unwrapped.limits, feet=feet)
    return math.hypot(*push.force[:2]) / limit
