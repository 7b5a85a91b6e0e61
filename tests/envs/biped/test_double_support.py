"""Double support of the biped: both feet bear load for the first 0.1 s of every step."""

import math

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.capturability import recoverable_offset
from push_recovery.controllers.model.nominal_gait import step_start_dcm
from push_recovery.controllers.model.observation import (
    DCM,
    ON_BOTH_FEET,
    SWING_POSITION,
    TRUNK_ANGLE,
    TRUNK_RATE,
)
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.stage_1 import swing_time
from push_recovery.controllers.whole_body.limits import COP_EDGE
from push_recovery.envs.joint.env import BipedJointEnv
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import HARDWARE, Command, CommandChange, Scenario

D, PRESET = 0.1, "biped-double-support"


@pytest.fixture(scope="module")
def env():
    made = gym.make("PushRecovery/Biped-v0", preset=PRESET).unwrapped
    yield made
    made.close()


@pytest.fixture(scope="module")
def policy(env):
    return make_policy("two-stage", env.robot, env.limits, env.preset)


class Steps:
    """What every physics step of an episode has shown, and the observations of its periods."""

    def __init__(self, env, policy, scenario):
        core, rows = env.core, []
        phys, gait, weight = core.physics, core.gait, env.robot.mass * GRAVITY

        def look():
            stance = gait.stance[0]
            loads = phys.load[0, stance] / weight, phys.load[0, 1 - stance] / weight
            rows.append((gait.elapsed[0], gait.steps[0], *loads, core.limits_record.plan[0]))

        seen, _ = env.reset(options={"scenario": scenario})
        core.after_physics_step, self.seen, over = look, [seen], False
        while not over:
            seen, _, self.fell, late, self.info = env.step(policy.predict(seen)[0])
            self.seen.append(seen)
            over = self.fell or late
        core.after_physics_step = None
        self.elapsed, self.number, self.stance, self.other, self.met = np.array(rows).T

    def transfer(self, first=0.0, last=D):
        """Physics steps that end in a part of double support, the first steps of the walk left out."""
        return (self.elapsed > first) & (self.elapsed < last + 1e-6) & (self.number >= 4)


@pytest.mark.parametrize("command", [Command(), Command(0.3), Command(0.0, 0.2), Command(0.0, 0.0, 0.3)])
def test_walks_for_20_s_and_the_load_goes_linearly_from_foot_to_foot(env, policy, command):
    steps = Steps(env, policy, Scenario("walk", command=command, duration=20.0))
    assert not steps.fell
    assert steps.number[-1] >= 45
    landed = 0.02  # [s] by which the blow of the landing is over
    inside = steps.transfer(landed)
    assert steps.other[inside] == pytest.approx(1.0 - steps.elapsed[inside] / D, abs=0.15)
    assert (steps.stance + steps.other)[inside] == pytest.approx(1.0, abs=0.1)
    for load in (steps.stance, steps.other):  # within a planning period
        jumps = np.abs(load[5:] - load[:-5])[steps.transfer(landed)[5:]]
        assert jumps.max() < 0.2
    lifted = steps.transfer(D + 0.03, 0.2)
    assert not steps.other[lifted].any()
    assert not (steps.met[steps.transfer()].astype(int) & COP_EDGE).any()


def test_steps_in_place_start_at_the_nominal_dcm(env, policy):
    seen = np.array(Steps(env, policy, Scenario("in place", duration=20.0)).seen)
    robot, gait = env.robot, env.episodes.nominal(0.0, 0.0)
    assert gait.duration == pytest.approx(0.403)  # 0.303 s as without double support, and 0.1 s
    nominal = step_start_dcm(gait, robot.pelvis_width, robot.omega, 0.0, D)
    starts = seen[1:][seen[1:, 0] < seen[:-1, 0]]
    assert len(starts) >= 48
    other, back = starts[:, SWING_POSITION][:, :2], np.exp(-robot.omega * starts[:, :1])
    started = other + back * (starts[:, DCM] - other)  # the CoP stays on the old foot until the next plan
    assert np.abs(started[4:] - nominal).max() < 0.01


@pytest.mark.parametrize("psi", [0, 90, 180, 270])
@pytest.mark.parametrize("fraction", [0.0, 0.12])
def test_pushes_in_the_transfer_are_survived(env, policy, psi, fraction):
    """Of 500 N for 0.1 s; the foot that lifts has given its load away, and the next one has time to swing."""
    push = polar_push(500.0, math.radians(psi), 0.1, GaitEvent(4, "left", fraction))
    steps = Steps(env, policy, Scenario("pushed", (push,), duration=8.0))
    assert not steps.fell
    assert steps.info["recovered_at"] is not None
    assert steps.other[steps.transfer(D - 0.003)].max() < 0.2
    for seen in steps.seen:
        plan = policy.plan(seen)
        if 0.0 <= seen[0] < D - 0.01 and plan.duration < env.limits.duration_max - 1e-6:
            distance = math.dist(plan.step, seen[SWING_POSITION][:2])
            swing = swing_time(distance, 0.0, policy.config.swing_acceleration)
            assert plan.duration - D > 0.97 * swing


def test_left_and_right_are_mirror_images(env, policy):
    push = polar_push(400.0, math.radians(60.0), 0.1, GaitEvent(4, "left", 0.1))
    scenario = Scenario("pushed", (push,), duration=4.0)
    left, right = (np.array(Steps(env, policy, s).seen) for s in (scenario, scenario.mirrored()))
    assert right[:150] == pytest.approx(left[:150], abs=5e-3)


def test_capture_margin_counts_what_the_other_foot_still_gives(env, policy):
    """Towards it, p, the bounds lie p (1 - exp(-omega (d - t))) farther."""
    seen, _ = env.reset(options={"scenario": Scenario("x", duration=1.0)})
    for _ in range(20):
        bounds = recoverable_offset(env.robot, env.limits, seen[0], seen[TRUNK_ANGLE], seen[TRUNK_RATE])
        reach = -math.expm1(-env.robot.omega * max(D - seen[0], 0.0)) * seen[SWING_POSITION][:2]
        below = seen[DCM] - bounds.low - np.minimum(reach, 0.0)
        above = bounds.high + np.maximum(reach, 0.0) - seen[DCM]
        assert env.core.margin[0] == pytest.approx(min(below.min(), above.min()), abs=1e-6)
        seen = env.step(policy.predict(seen)[0])[0]


def test_stands_walks_and_stands_again(env, policy):
    changes = CommandChange(1.0, Command(0.2)), CommandChange(4.0, Command(stand=True))
    steps = Steps(env, policy, Scenario("x", (), Command(stand=True), changes=changes, duration=8.0))
    assert not steps.fell
    assert steps.number[-1] >= 6
    assert steps.elapsed[-1] == ON_BOTH_FEET
    begun = int(np.argmax(steps.elapsed >= 0.0))
    assert (steps.other[begun + 10 : begun + 30] > 0.3).all()  # its first step begins with a transfer, too


def test_walks_on_its_own_sensors(env, policy):
    push = Push((60.0, 40.0, 0.0), 0.1, 3.02)
    scenario = HARDWARE.applied(Scenario("x", (push,), Command(0.2), duration=8.0, noise_seed=2))
    assert not Steps(env, policy, scenario).fell


def test_targets_of_joints_know_no_double_support():
    with pytest.raises(
        InvalidValueError,
        match=rf"^preset '{PRESET}' walks with double support of 0.1 s, which "
        r"PushRecovery/BipedJoint-v0 does not know; choose from: "
        r"apollo, berkeley, biped, default, g1, jvrc1, op3, paper, t1$",
    ):
        BipedJointEnv(preset=PRESET)


def test_a_cop_of_double_support_does_not_outlast_it(env):
    """5 ms of it are left: three physics steps of 2 ms begin before its end, two after it."""
    env.reset(options={"scenario": Scenario("x", duration=1.0)})
    core, cops = env.core, []
    core.gait.elapsed[0] = D - 0.005
    core.after_physics_step = lambda: cops.append(core.gait.plan[0, 4])
    env.step(np.ones(7, np.float32))  # the outer edge of the other sole
    core.after_physics_step = None
    half = env.limits.cop_y_max
    assert min(cops[:3]) > 0.15 + half
    assert cops[3:] == pytest.approx([half, half])
