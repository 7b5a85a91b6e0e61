"""Stage 2 of robots whose waist lacks an axis."""

from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.observation import ELAPSED, PREVIOUS_ACTION, SWING_POSITION, TRUNK_RATE
from push_recovery.controllers.policies.two_stage import TwoStagePolicy
from push_recovery.controllers.qp import QuadraticProgram
from push_recovery.controllers.settings import PlannerConfig, preset_config
from push_recovery.controllers.stage_2.problem import STATUS, solve_again

COP, TRUNK = 3, 5
AXES = [("trunk_pitch", 0), ("trunk_roll", 1)]
DEFAULT = preset_config("default").replace(trunk_debt=False)
CONFIGS = [DEFAULT, DEFAULT.replace(use_cop=False), DEFAULT.replace(solver="osqp"), preset_config("paper")]


def observations(n=20):
    """States in mid-step whose lean, rates and DCM call for the trunk about both axes."""
    rng = np.random.default_rng(8)
    seen = rng.normal(0.0, 0.05, (n, 36))
    seen[:, ELAPSED] = rng.uniform(0.0, 0.3, n)
    seen[:, TRUNK_RATE] *= 10.0
    seen[:, PREVIOUS_ACTION] = 0.0
    return seen


def gaits(config: PlannerConfig, seen, **axes: bool):
    """Gait variables (n, 7) that the planner asks for."""
    limits = replace(GaitLimits(), **axes)
    policy = TwoStagePolicy(limits=limits, config=config)
    return np.array([policy.plan(row).gait for row in seen])


@pytest.mark.parametrize("config", CONFIGS, ids=["default", "no CoP", "osqp", "paper"])
@pytest.mark.parametrize(("missing", "axis"), AXES)
def test_one_axis_is_planned_without_trunk_and_the_other_as_ever(config, missing, axis):
    """The axes are two programs of their own, so each is that of a robot with both axes or with neither."""
    seen = observations(6)
    found, whole = gaits(config, seen, **{missing: False}), gaits(config, seen)
    rigid = gaits(config.replace(use_trunk=False), seen)
    assert (whole[:, TRUNK + axis] != 0.0).all()
    np.testing.assert_array_equal(found[:, TRUNK + axis], 0.0)
    np.testing.assert_array_equal(found[:, COP + axis], rigid[:, COP + axis])
    for column in (COP, TRUNK):
        np.testing.assert_array_equal(found[:, column + 1 - axis], whole[:, column + 1 - axis])


@pytest.mark.parametrize("config", CONFIGS[:2], ids=["default", "no CoP"])
def test_without_any_axis_the_planner_is_the_one_without_a_trunk(config):
    seen = observations()
    found = gaits(config, seen, trunk_pitch=False, trunk_roll=False)
    rigid = gaits(config.replace(use_trunk=False), seen)
    np.testing.assert_array_equal(found[:, TRUNK:], 0.0)
    np.testing.assert_array_equal(found[:, :TRUNK], rigid[:, :TRUNK])


@pytest.mark.parametrize(("missing", "axis"), AXES)
def test_double_support_plans_no_acceleration_about_the_missing_axis(missing, axis):
    config = preset_config("double-support")
    seen = observations()
    seen[:, ELAPSED] = 0.02
    seen[:, SWING_POSITION] = -0.1, 0.2, 0.0
    limits = replace(GaitLimits(), **{missing: False})
    policy = TwoStagePolicy(limits=limits, config=config)
    plans = [policy.plan(row) for row in seen]
    assert {plan.status for plan in plans} == {"solved"}
    np.testing.assert_array_equal([plan.trunk_acceleration[axis] for plan in plans], 0.0)
    assert np.abs([plan.trunk_acceleration[1 - axis] for plan in plans]).min() > 1e-3


@pytest.mark.parametrize(("missing", "axis"), AXES)
def test_stage_1_counts_no_debt_of_a_trunk_that_cannot_swing(missing, axis):
    """A rate about the missing axis is the pelvis' own, and stops without the waist."""
    config = DEFAULT.replace(trunk_debt=True, use_trunk=False, use_cop=False)
    still, turning = observations(), observations()
    still[:, TRUNK_RATE.start + axis] = 0.0
    turning[:, TRUNK_RATE.start + axis] = 0.8
    step = slice(0, 3)
    with_axis = [gaits(config, seen)[:, step] for seen in (still, turning)]
    without = [gaits(config, seen, **{missing: False})[:, step] for seen in (still, turning)]
    np.testing.assert_array_equal(*without)
    assert np.abs(with_axis[0] - with_axis[1]).max() > 1e-3


@pytest.mark.parametrize(("missing", "axis"), AXES)
def test_the_expected_dcm_of_the_missing_axis_is_that_without_a_trunk(missing, axis):
    def ends(config=DEFAULT, **axes):
        policy = TwoStagePolicy(limits=replace(GaitLimits(), **axes), config=config)
        return np.array([policy.plan(row).dcm_end for row in observations(6)])

    found, whole, rigid = ends(**{missing: False}), ends(), ends(DEFAULT.replace(use_trunk=False))
    np.testing.assert_array_equal(found[:, axis], rigid[:, axis])
    np.testing.assert_array_equal(found[:, 1 - axis], whole[:, 1 - axis])
    assert np.abs(whole - rigid)[:, axis].max() > 1e-8


def test_where_osqp_gives_up_daqps_plan_stays_and_the_status_says_so():
    """x_0 >= 1 and x_0 <= -1."""
    row = np.array([[1.0, 0.0], [1.0, 0.0]])
    nowhere = QuadraticProgram(
        np.eye(2), np.zeros(2), row, np.array([1.0, -2.0]), np.array([2.0, -1.0]), np.zeros(2)
    )
    out = np.arange(7.0)
    solve_again([(nowhere, [])], out)
    assert out.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, STATUS.index("daqp")]
