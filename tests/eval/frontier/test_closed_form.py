"""F* of a robot that walks: the room between the DCM at the start of its step and the bounds of a box."""

import math

import pytest
from push_recovery.controllers.model.capturability import recoverable_offset
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.scenario.scenario import Command
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.frontier import limit_force, own_limit_force

PAPER, PAPER_LIMITS = RobotModel(), GaitLimits.of(RobotModel())
DURATION = 0.1


def force_for(robot: RobotModel, shift: float) -> float:
    """A push that moves the DCM by `shift` [m]: F (1 - exp(-omega d)) / (m omega^2)."""
    return shift * robot.mass * robot.omega**2 / (1.0 - math.exp(-robot.omega * DURATION))


@pytest.mark.parametrize("command", [Command(0.3, 0.1), Command(0.3, -0.1), Command(-0.2, 0.15)])
def test_the_limit_starts_from_the_gait_of_the_command(command):
    """On left stance the swing side is the right one: a velocity to the left narrows the step."""
    env = make_env("PushRecovery/Pendulum-v0")
    gait = nominal_gait(PAPER, PAPER_LIMITS, (command.vx, -command.vy))
    assert (gait.width < PAPER.pelvis_width) == (command.vy > 0)
    x, y = step_start_dcm(gait, PAPER.pelvis_width, PAPER.omega)
    bounds = recoverable_offset(PAPER, PAPER_LIMITS)
    rooms = {
        0.0: bounds.high[0] - x,
        math.pi: x - bounds.low[0],
        -math.pi / 2: bounds.high[1] - y,
        math.pi / 2: y - bounds.low[1],
    }
    for psi, room in rooms.items():
        expected = pytest.approx(force_for(PAPER, room))
        assert limit_force(env, psi, DURATION, command) == expected
        assert own_limit_force(env, psi, DURATION, command) == expected


def test_the_own_limit_is_of_the_robots_box_and_the_papers_is_not():
    small = GaitLimits(length_min=-0.3, length_max=0.3)
    env = make_env("PushRecovery/Pendulum-v0", limits=small)
    x, _ = step_start_dcm(nominal_gait(PAPER, small), PAPER.pelvis_width, PAPER.omega)
    for found, limits in ((own_limit_force, small), (limit_force, PAPER_LIMITS)):
        room = recoverable_offset(PAPER, limits).high[0] - x
        assert found(env, 0.0, DURATION, Command()) == pytest.approx(force_for(PAPER, room))
    point = recoverable_offset(PAPER, small, foot=False, flywheel=False).high[0] - x
    found = own_limit_force(env, 0.0, DURATION, Command(), point_foot=True)
    assert found == pytest.approx(force_for(PAPER, point))
