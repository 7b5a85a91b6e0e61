"""Double support: the transfer, the hull of both soles, and a CoP as an action while both stand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import (
    box_around,
    gaits_of_actions,
    nearest_in_hull,
    nominal_gait,
    step_start_dcm,
    transfer_mean,
    transfer_weight,
)
from push_recovery.controllers.model.observation import ELAPSED, OBSERVATION_SIZE, SWING_POSITION
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.two_stage import TwoStagePolicy, make_policy, scale_actions
from push_recovery.controllers.settings import PlannerConfig, preset_config
from scipy.integrate import quad, solve_ivp

ROBOT, LIMITS, D = RobotModel(), GaitLimits(), 0.1
OMEGA = ROBOT.omega
HALF = np.array([LIMITS.cop_x_max, LIMITS.cop_y_max])


def standing(elapsed, other, seed=0):
    obs = 0.02 * np.random.default_rng(seed).normal(size=OBSERVATION_SIZE)
    obs[ELAPSED] = elapsed
    obs[SWING_POSITION] = *other, 0.0
    obs[15:19] = obs[25:27] = 0.0  # trunk upright, in place
    return obs


@pytest.mark.parametrize("elapsed", [0.0, 0.013, 0.0999, 0.1, 0.3])
def test_transfer_weight_is_the_discounted_mean(elapsed):
    end = max(D, elapsed)
    expected, _ = quad(lambda s: OMEGA * math.exp(-OMEGA * (s - elapsed)) * (1 - s / D), elapsed, end)
    assert transfer_weight(elapsed, D, OMEGA) == pytest.approx(expected, abs=1e-12)
    assert transfer_weight(elapsed, 0.0, OMEGA) == 0.0


def test_means_held_for_a_period_each_do_to_the_dcm_what_the_transfer_does():
    dcm = held = 0.013
    period, other = 0.01, 0.2
    for k in range(12):
        share = transfer_mean(k * period, period, D, OMEGA)
        held = share * other + math.exp(OMEGA * period) * (held - share * other)
    moved = solve_ivp(
        lambda t, y: OMEGA * (y - other * max(1 - t / D, 0.0)), (0, 0.12), [dcm], rtol=1e-11, max_step=0.01
    )
    assert held == pytest.approx(moved.y[0, -1], abs=1e-9)
    closed = math.exp(OMEGA * 0.12) * (dcm - other * transfer_weight(0.0, D, OMEGA))
    assert held == pytest.approx(closed, abs=1e-12)


@pytest.mark.parametrize("velocity", [(0, 0), (0.5, 0), (-0.25, 0), (0, 0.2), (0.3, -0.1)])
def test_nominal_gait_is_periodic_when_integrated(velocity):
    """Two steps of xi' = omega (xi - z), z linear from the old foot to the new one."""
    sides = [nominal_gait(ROBOT, LIMITS, (velocity[0], s * velocity[1]), double_support=D) for s in (1, -1)]
    start = np.array(step_start_dcm(sides[0], ROBOT.pelvis_width, OMEGA, double_support=D))
    dcm = start
    for gait, before in (sides, sides[::-1]):
        other = np.array([-before.length, before.width])

        def motion(t, y, other=other):
            return OMEGA * (y - other * max(1.0 - t / D, 0.0))

        for span in ((0.0, D), (D, gait.duration)):
            dcm = solve_ivp(motion, span, dcm, rtol=1e-11, atol=1e-13).y[:, -1]
        offset = dcm - [gait.length, gait.width]
        assert offset == pytest.approx(gait.offset, abs=1e-8)
        dcm = offset * [1, -1]
    assert dcm == pytest.approx(start, abs=1e-8)


def distance_to_hull(point, other):
    shares = np.linspace(0.0, 1.0, 20001)[:, None]
    left = np.abs(point - shares * other) - HALF
    return np.hypot(*np.maximum(left, 0.0).T).min()


def test_nearest_point_of_the_hull():
    rng, cut = np.random.default_rng(0), 0
    for _ in range(200):
        other = np.array([rng.uniform(-0.5, 0.5), rng.uniform(0.1, 0.4)])
        box = np.array([box_around(-h, h, p) for h, p in zip(HALF, other, strict=True)]).T
        point = rng.uniform(*box)
        nearest = np.array(nearest_in_hull(*point, *other, *HALF))
        assert distance_to_hull(nearest, other) < 1e-5
        assert np.hypot(*(nearest - point)) == pytest.approx(distance_to_hull(point, other), abs=2e-5)
        cut += bool(np.hypot(*(nearest - point)) > 0.01)
        assert nearest_in_hull(*nearest, *other, *HALF) == pytest.approx(nearest, abs=1e-15)
    assert cut > 40
    assert nearest_in_hull(0.3, -0.3, 0.0, 0.0, 0.1, 0.05) == (0.1, -0.05)


def test_actions_span_the_box_about_both_soles_while_both_stand():
    other = np.array([-0.3, 0.25])
    observations = np.stack([standing(0.05, other), standing(0.1, other), standing(0.4, other)])
    for sign in (-1.0, 1.0):
        gaits = gaits_of_actions(LIMITS, observations, np.full((3, 7), sign), D)
        edge = [other[0] - 0.1, -0.05] if sign < 0 else [0.1, other[1] + 0.05]
        assert gaits[0, 3:5] == pytest.approx(edge)
        assert np.array_equal(gaits[1:], LIMITS.from_action(np.full((2, 7), sign)))
        assert np.array_equal(np.delete(gaits[0], [3, 4]), np.delete(gaits[1], [3, 4]))
        without = gaits_of_actions(LIMITS, observations, np.full((3, 7), sign), 0.0)
        assert np.array_equal(without, LIMITS.from_action(np.full((3, 7), sign)))


@pytest.mark.parametrize("name", ["passive", "stage-1", "two-stage"])
def test_policy_and_environment_mean_the_same_cop(name):
    policy = make_policy(name, preset="double-support")
    assert isinstance(policy, TwoStagePolicy)
    observations = np.stack([standing(0.01 * k, (-0.2, 0.22), seed=k) for k in range(14)])
    actions, _ = policy.predict(observations)
    gaits = gaits_of_actions(LIMITS, observations, actions, D)
    for obs, gait in zip(observations, gaits, strict=True):
        plan = policy.plan(obs)
        assert gait[3:7] == pytest.approx(plan.gait[3:7], abs=2e-6)
        if name != "two-stage":
            share = transfer_mean(obs[ELAPSED], 0.01, D, OMEGA)
            assert plan.cop == pytest.approx(share * obs[SWING_POSITION][:2], abs=1e-15)


def test_stage_1_predicts_the_dcm_at_touchdown_and_keeps_what_the_next_step_grows_from():
    """u + b is the DCM at T after the transfer; stage 1 holds b + c u at its nominal value."""
    policy = make_policy("stage-1", preset="double-support")
    assert isinstance(policy, TwoStagePolicy)
    share = transfer_weight(0.0, D, OMEGA)
    for k in range(10):
        obs = standing(0.012 * k, (0.03, 0.21), seed=k)
        plan = policy.plan(obs)
        left = plan.duration - obs[ELAPSED]
        shift = transfer_weight(obs[ELAPSED], D, OMEGA) * obs[SWING_POSITION][:2]
        dcm = math.exp(OMEGA * left) * (obs[1:3] - shift)
        assert plan.step + plan.offset == pytest.approx(dcm, abs=1e-9)
        nominal = np.array([plan.nominal.length, plan.nominal.width])
        grown = plan.nominal.offset + share * nominal
        assert plan.dcm_target == pytest.approx((1 - share) * plan.step + grown, abs=1e-12)
        inside = np.abs(plan.step - 0.5 * (LIMITS.low[:2] + LIMITS.high[:2])) < [0.499, 0.149]
        error = plan.offset + share * plan.step - grown
        assert np.abs(error[inside]).max(initial=0.0) < 1e-5


def test_a_vanishing_double_support_changes_no_plan():
    config = preset_config("double-support")
    brief, none = (TwoStagePolicy(config=replace(config, double_support=d)) for d in (1e-6, 0.0))
    observations = np.stack([standing(0.01 * k, (-0.2, 0.22), seed=k) for k in range(1, 31)])
    np.testing.assert_allclose(brief.predict(observations)[0], none.predict(observations)[0], atol=1e-4)


def test_what_cannot_be_is_refused():
    with pytest.raises(InvalidValueError, match=r"exclude each other, got 0\.1 s and 0\.02 s"):
        PlannerConfig(double_support=0.1, touchdown_delay=0.02)
    with pytest.raises(InvalidValueError, match=r"shorter than the shortest step, 0\.3 s, got 0\.3"):
        TwoStagePolicy(config=PlannerConfig(double_support=0.3))
    with pytest.raises(InvalidValueError, match="in form 'zoh' only, got form 'jerk'"):
        make_policy("two-stage-paper", preset="double-support")
    assert make_policy("stage-1-paper", preset="double-support").predict(standing(0.0, (0.0, 0.2)))


def actions_of(gaits, elapsed=0.3, double_support=0.0):
    """Actions (n, 7) of gaits (n, 7) `elapsed` into a step whose swing foot stood at (-0.3, 0.25)."""
    gaits = np.array(gaits, dtype=np.float64)
    observations = np.zeros((len(gaits), 36))
    observations[:, ELAPSED], observations[:, SWING_POSITION] = elapsed, (-0.3, 0.25, 0.0)
    actions = np.full((len(gaits), 7), np.nan, np.float32)
    scale_actions(gaits, observations, LIMITS.low, LIMITS.high, double_support, actions)
    return actions, observations


def test_the_box_is_spanned_and_what_lies_beyond_is_clipped():
    middle, span = (0.5 * (LIMITS.low + LIMITS.high), LIMITS.high - LIMITS.low)
    shares = [0.0, 0.5, -0.25, 1.0, -1.0, 1.5, -1.5]
    found, _ = actions_of([middle + 0.5 * share * span for share in shares])
    np.testing.assert_allclose(found, np.repeat(np.clip(shares, -1.0, 1.0)[:, None], 7, axis=1), atol=1e-6)


@pytest.mark.parametrize(("elapsed", "both"), [(0.05, True), (0.11, False)])
def test_while_both_feet_stand_the_cop_spans_the_box_about_both_soles(elapsed, both):
    """Soles of 0.2 x 0.1 m at the origin and at (-0.3, 0.25)."""
    low, high = LIMITS.low.copy(), LIMITS.high.copy()
    if both:
        low[3:5], high[3:5] = (-0.4, -0.05), (0.1, 0.3)
    found, observations = actions_of([low, high, 0.5 * (low + high)], elapsed, D)
    np.testing.assert_allclose(found, np.repeat([[-1.0], [1.0], [0.0]], 7, axis=1), atol=1e-6)
    again = gaits_of_actions(LIMITS, observations[2:], found[2:], D)
    np.testing.assert_allclose(np.delete(again[0], [3, 4]), np.delete(0.5 * (low + high), [3, 4]), atol=1e-6)


def test_a_cop_beyond_the_box_about_both_soles_is_brought_to_it():
    """Soles of 0.2 x 0.1 m at the origin and at (-0.3, 0.25); also of a robot that stands."""
    other = np.array([-0.3, 0.25])
    observations = np.stack([standing(0.05, other), standing(-1.0, other)])
    for sign, edge in ((-1.0, (-0.4, -0.05)), (1.0, (0.1, 0.3))):
        gaits = gaits_of_actions(LIMITS, observations, np.full((2, 7), 3.0 * sign), D)
        np.testing.assert_allclose(gaits[:, 3:5], [edge, edge], atol=1e-12)
