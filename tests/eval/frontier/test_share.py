"""The share of a push of the closed-form limit, against the limit itself and against the capture margin."""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import capture_margin
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import Command
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.frontier import limit_share, own_limit_force

WALKS = [Command(), Command(0.3, 0.1), Command(-0.2, -0.15)]


@pytest.fixture(scope="module")
def env():
    made = make_env("PushRecovery/Pendulum-v0")
    yield made
    made.close()


@pytest.mark.parametrize("command", WALKS)
@pytest.mark.parametrize("psi", [0.0, 0.7, -2.1, 3.0])
def test_at_the_start_of_a_left_stance_it_is_the_force_by_the_limit(env, command, psi):
    push = polar_push(120.0, psi, 0.1, GaitEvent(4, "left"))
    assert limit_share(env, push, command) == pytest.approx(120.0 / own_limit_force(env, psi, 0.1, command))


@pytest.mark.parametrize("command", WALKS)
@pytest.mark.parametrize("psi", [0.3, -0.9, 2.5])
def test_in_mid_step_the_limit_brings_the_dcm_to_its_bound(env, command, psi):
    robot, limits = env.unwrapped.robot, env.unwrapped.limits
    push = polar_push(100.0, psi, 0.2, GaitEvent(4, "left", 0.6))
    share = limit_share(env, push, command)
    assert share is not None
    gait = nominal_gait(robot, limits, (command.vx, -command.vy))
    elapsed = 0.6 * gait.duration
    start = np.array(step_start_dcm(gait, robot.pelvis_width, robot.omega)) * math.exp(robot.omega * elapsed)
    shift = 100.0 * (1.0 - math.exp(-robot.omega * 0.2)) / (robot.mass * robot.omega**2)
    pushed = start + shift / share * np.array([math.cos(psi), -math.sin(psi)])
    assert capture_margin(robot, limits, elapsed, pushed) == pytest.approx(0.0, abs=1e-12)


def test_a_mirrored_push_has_the_same_share(env):
    push, command = polar_push(90.0, 1.1, 0.1, GaitEvent(4, "right", 0.3)), Command(0.2, 0.1)
    mirrored = limit_share(env, push.mirrored(), replace(command, vy=-command.vy))
    assert limit_share(env, push, command) == pytest.approx(mirrored)
    assert limit_share(env, push, command) != pytest.approx(limit_share(env, push.mirrored(), command))


def test_no_share_of_a_push_at_a_time(env):
    assert limit_share(env, Push((50.0, 0.0, 0.0), 0.1, 2.0), Command()) is None
