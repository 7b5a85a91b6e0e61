"""The baselines of the field: what they keep fixed, and what they are made of."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.observation import COMMAND, DCM, ELAPSED
from push_recovery.controllers.policies.two_stage import TwoStagePolicy, make_policy
from push_recovery.controllers.settings import ARMS, PresetFile, named_preset

PUSHED = np.zeros(36)
PUSHED[ELAPSED], PUSHED[DCM], PUSHED[COMMAND] = 0.1, (0.15, 0.2), (0.2, 0.0)


def arm(name: str, preset: str = "default") -> TwoStagePolicy:
    policy = make_policy(name, preset=preset)
    assert isinstance(policy, TwoStagePolicy)
    return policy


@pytest.mark.parametrize("name", ["raibert", "herdt", "fixed-time"])
def test_the_time_of_a_baseline_is_nominal_whatever_happens(name):
    policy = arm(name)
    nominal = nominal_gait(policy.robot, policy.limits, (0.2, 0.0))
    plan = policy.plan(PUSHED)
    assert plan.duration == pytest.approx(nominal.duration, abs=1e-12)
    assert plan.step[0] > nominal.length + 0.05  # and its place is not
    assert arm("stage-1").plan(PUSHED).duration < nominal.duration - 0.05


def test_with_a_fixed_time_the_place_is_a_weighted_mean():
    """min alpha_1 (u - u_nom)^2 + alpha_3 (a tau - u - b_nom)^2 for T nominal, a = xi exp(-omega t)."""
    policy = arm("fixed-time", "biped")
    config, omega = policy.config, policy.robot.omega
    delay = config.touchdown_delay
    nominal = nominal_gait(policy.robot, policy.limits, (0.2, 0.0), delay)
    observation = PUSHED.copy()
    observation[DCM] = 0.05, 0.1
    end = 0.05 * math.exp(omega * (nominal.duration + delay - 0.1))
    weights = config.alpha_step, config.alpha_offset
    length = (weights[0] * nominal.length + weights[1] * (end - nominal.offset_x)) / sum(weights)
    assert policy.limits.low[0] < length < policy.limits.high[0]
    assert policy.plan(observation).step[0] == pytest.approx(length, abs=1e-12)


def test_a_preset_may_tune_a_baseline():
    preset = PresetFile("biped", arms={"raibert": {"upright_stiffness": 12.0}})
    assert preset.config("raibert").upright_stiffness == 12.0
    base = named_preset("biped")
    assert preset.config("raibert").upright_damping == base.config("raibert").upright_damping
    assert preset.config("fixed-time") == base.config("fixed-time")


def test_an_arm_overrides_of_a_preset_only_what_makes_it_that_arm():
    assert ARMS["two-stage"].settings == {"use_cop": True, "use_trunk": True}
    fixed = {"use_cop": False, "use_trunk": False, "adapt_duration": False}
    assert ARMS["fixed-time"].settings == fixed
    rule = {"use_cop": False, "use_trunk": False, "foothold": "capture_point"}
    assert ARMS["raibert"].settings == rule
    assert ARMS["herdt"].settings == {**rule, "foothold": "linear_mpc"}
