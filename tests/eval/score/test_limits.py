"""F* of a robot that walks, F*_stand, shares of them, and F* at the phases of a step."""

import math
from dataclasses import replace

import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.model.capturability import capture_margin, recoverable_offset
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import Command
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score import limits as yardsticks

DURATION = 0.1


@pytest.fixture(scope="module")
def env():
    made = make_env("PushRecovery/Pendulum-v0")
    yield made
    made.close()


PAPER, PAPER_LIMITS = RobotModel(), GaitLimits.of(RobotModel())


def force_for(robot: RobotModel, shift: float) -> float:
    """A push that moves the DCM by `shift` [m]: F (1 - exp(-omega d)) / (m omega^2)."""
    return shift * robot.mass * robot.omega**2 / (1.0 - math.exp(-robot.omega * DURATION))


@pytest.mark.parametrize("command", [Command(0.3, 0.1), Command(0.3, -0.1), Command(-0.2, 0.15)])
def test_the_limit_starts_from_the_gait_of_the_command(env, command):
    """On left stance the swing side is the right one: a velocity to the left narrows the step."""
    gait = nominal_gait(PAPER, PAPER_LIMITS, (command.vx, -command.vy))
    assert (gait.width < PAPER.pelvis_width) == (command.vy > 0)
    x, y = step_start_dcm(gait, PAPER.pelvis_width, PAPER.omega)
    bounds = recoverable_offset(PAPER, PAPER_LIMITS)
    sagittal = (0.0, bounds.high[0] - x), (math.pi, x - bounds.low[0])
    lateral = (-math.pi / 2, bounds.high[1] - y), (math.pi / 2, y - bounds.low[1])
    for psi, room in (*sagittal, *lateral):
        expected = pytest.approx(force_for(PAPER, room))
        assert yardsticks.limit_force(env, psi, DURATION, command) == expected
        assert yardsticks.own_limit_force(env, psi, DURATION, command) == expected


def test_the_own_limit_is_of_the_robots_box_and_the_papers_is_not():
    small = GaitLimits(length_min=-0.3, length_max=0.3)
    env = make_env("PushRecovery/Pendulum-v0", limits=small)
    x, _ = step_start_dcm(nominal_gait(PAPER, small), PAPER.pelvis_width, PAPER.omega)
    for found, limits in ((yardsticks.own_limit_force, small), (yardsticks.limit_force, PAPER_LIMITS)):
        room = recoverable_offset(PAPER, limits).high[0] - x
        assert found(env, 0.0, DURATION, Command()) == pytest.approx(force_for(PAPER, room))
    point = recoverable_offset(PAPER, small, foot=False, flywheel=False).high[0] - x
    found = yardsticks.own_limit_force(env, 0.0, DURATION, Command(), point_foot=True)
    assert found == pytest.approx(force_for(PAPER, point))


WALKS = [Command(), Command(0.3, 0.1), Command(-0.2, -0.15)]


@pytest.mark.parametrize("command", WALKS)
@pytest.mark.parametrize("psi", [0.0, 0.7, -2.1, 3.0])
def test_at_the_start_of_a_left_stance_it_is_the_force_by_the_limit(env, command, psi):
    push = polar_push(120.0, psi, 0.1, GaitEvent(4, "left"))
    assert yardsticks.limit_share(env, push, command) == pytest.approx(
        120.0 / yardsticks.own_limit_force(env, psi, 0.1, command)
    )


@pytest.mark.parametrize("command", WALKS)
@pytest.mark.parametrize("psi", [0.3, -0.9, 2.5])
def test_in_mid_step_the_limit_brings_the_dcm_to_its_bound(env, command, psi):
    robot, limits = env.unwrapped.robot, env.unwrapped.limits
    push = polar_push(100.0, psi, 0.2, GaitEvent(4, "left", 0.6))
    share = yardsticks.limit_share(env, push, command)
    assert share is not None
    gait = nominal_gait(robot, limits, (command.vx, -command.vy))
    elapsed = 0.6 * gait.duration
    start = np.array(step_start_dcm(gait, robot.pelvis_width, robot.omega)) * math.exp(robot.omega * elapsed)
    shift = 100.0 * (1.0 - math.exp(-robot.omega * 0.2)) / (robot.mass * robot.omega**2)
    pushed = start + shift / share * np.array([math.cos(psi), -math.sin(psi)])
    assert capture_margin(robot, limits, elapsed, pushed) == pytest.approx(0.0, abs=1e-12)


def test_a_mirrored_push_has_the_same_share_and_one_at_a_time_has_none(env):
    assert yardsticks.limit_share(env, Push((50.0, 0.0, 0.0), 0.1, 2.0), Command()) is None
    push, command = polar_push(90.0, 1.1, 0.1, GaitEvent(4, "right", 0.3)), Command(0.2, 0.1)
    mirrored = yardsticks.limit_share(env, push.mirrored(), replace(command, vy=-command.vy))
    assert yardsticks.limit_share(env, push, command) == pytest.approx(mirrored)
    assert yardsticks.limit_share(env, push, command) != pytest.approx(
        yardsticks.limit_share(env, push.mirrored(), command)
    )


@pytest.mark.parametrize(("psi", "reach"), [(0.0, 0.1), (math.pi / 2, 0.15)])
def test_the_standing_limit_is_how_far_both_soles_reach_and_what_the_trunk_gives(env, psi, reach):
    """0.2 x 0.1 m soles whose centres are 0.2 m apart; B by the closed form of a bang-bang swing."""
    torque, inertia, lean = PAPER.trunk_torque_max, PAPER.trunk_inertia, PAPER.trunk_angle_max
    swing = math.sqrt(lean * inertia / torque)
    reserve = torque / (PAPER.mass * 9.81) * (1.0 - math.exp(-PAPER.omega * swing)) ** 2
    expected = force_for(PAPER, reach + reserve)
    assert yardsticks.standing_limit_force(env, psi, DURATION) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("psi", "force"), [(-90, 641), (-45, 907), (0, 1120), (45, 582), (90, 412)])
def test_limit_is_the_papers_in_place(psi, force):
    # l_p 0.2 m, foot 0.2 x 0.1 m, T 0.65 s; on the left stance a push to the left is the hard one
    env = make_env(toy.ENV_ID)
    assert yardsticks.limit_force(env, math.radians(psi), 0.1, Command()) == pytest.approx(force, abs=1.0)


def test_own_limit_is_that_of_the_environments_own_box():
    """Forward with a point foot: F = m omega^2 L_max / (e^(omega T_min) - 1) / (1 - e^(-omega d))."""
    limits = replace(GaitLimits.of(RobotModel()), length_max=0.3, duration_min=0.4)
    env = make_env("PushRecovery/Pendulum-v0", limits=limits)
    mass, omega = 60.0, math.sqrt(9.81 / env.unwrapped.robot.com_height)  # type: ignore[attr-defined]
    offset = 0.3 / (math.exp(0.4 * omega) - 1.0)
    expected = mass * omega**2 * offset / (1.0 - math.exp(-0.1 * omega))
    assert yardsticks.own_limit_force(env, 0.0, 0.1, Command(), point_foot=True) == pytest.approx(expected)
    found = yardsticks.direction_limits(env, 0.0, 0.1, Command())
    assert expected < found.own < found.paper == yardsticks.limit_force(env, 0.0, 0.1, Command())
    curves = yardsticks.limit_curves(env, [0.0, -90.0], 0.1, Command())
    assert list(curves) == [yardsticks.OWN, yardsticks.PAPER, yardsticks.POINT_FOOT, yardsticks.STAND]
    for psi, own, paper, point, stand in zip((0.0, -90.0), *curves.values(), strict=True):
        assert yardsticks.DirectionLimits(own, paper, stand) == yardsticks.direction_limits(
            env, psi, 0.1, Command()
        )
        assert point < own


def test_the_limit_of_phases_is_that_of_the_weakest_phases_left_out(env):
    """Ahead the bound stays from T_min on and the DCM, which in place has no offset ahead, is free to grow.

    F* at an elapsed time t before T_min is F* at the start times exp(omega t) less what the sole, which is
    there at any time, does not gain.
    """
    robot, limits = env.unwrapped.robot, env.unwrapped.limits
    period = nominal_gait(robot, limits).duration
    phases = [0.5 * k / 10 * limits.duration_min / period for k in range(10)]

    def force(phase):
        return force_for(robot, recoverable_offset(robot, limits, phase * period).high[0])

    for share, left_out in ((1.0, 0), (0.8, 2), (0.75, 2), (0.1, 9)):
        found = yardsticks.limit_of_phases(env, 0.0, DURATION, Command(), phases, share)
        assert found == pytest.approx(force(phases[left_out])), share
    reversed_phases = yardsticks.limit_of_phases(env, 0.0, DURATION, Command(), phases[::-1], 0.8)
    assert reversed_phases == pytest.approx(force(phases[2]))
    assert force(phases[2]) > yardsticks.own_limit_force(env, 0.0, DURATION, Command())


def test_a_gait_out_of_bounds_has_no_limit_and_its_phase_counts_as_no_force(env, monkeypatch):
    """Of F* of none, 2, 4 and 5 N three quarters are at least 2 N."""
    start = yardsticks.PushedStart(0.0, np.array([0.0, -9.0]), np.array([0.1, 0.0]))
    push = polar_push(100.0, 0.0, 0.1, GaitEvent(4, "left"))
    with monkeypatch.context() as patch:
        patch.setattr(yardsticks, "pushed_start", lambda *_: start)
        assert yardsticks.limit_share(env, push, Command()) is None
    shares, phases = iter(2 * [None, 0.5, 0.25, 0.2]), [0.1, 0.3, 0.6, 0.9]
    monkeypatch.setattr(yardsticks, "limit_share", lambda *_: next(shares))
    found = [yardsticks.limit_of_phases(env, 0.0, 0.1, Command(), phases, share) for share in (1.0, 0.75)]
    assert found == [0.0, 2.0]
