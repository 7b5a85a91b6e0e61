"""What a correction of 1 means, from the box written out by hand."""

import dataclasses

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.controllers.model.observation import (
    COMMAND,
    DCM,
    ELAPSED,
    OBSERVATION_SIZE,
)
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies import residual
from push_recovery.controllers.policies.interface import PlainPolicy, as_policy
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription, ResidualBase
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.controllers.policies.two_stage import TwoStagePolicy, make_policy
from push_recovery.controllers.settings import preset_config


def test_a_correction_of_one_is_so_many_metres_seconds_and_radians():
    """0.12 m, 0.10 m, 0.15 s, CoP 0.06 and 0.03 m, 12 rad/s^2; an action of 2 spans the box."""
    spans = np.array([1.0, 0.3, 0.7, 0.2, 0.1, 37.5, 37.5])  # high - low of the paper's box
    physical = np.array([0.12, 0.10, 0.15, 0.06, 0.03, 12.0, 12.0])
    assert residual.default_residual_scale(GaitLimits()) == pytest.approx(2.0 * physical / spans, rel=1e-6)
    assert residual.default_residual_scale(GaitLimits(), 0.5) == pytest.approx(physical / spans, rel=1e-6)


def test_an_entry_without_a_range_is_not_corrected():
    scale = residual.default_residual_scale(GaitLimits(trunk_roll=False))
    assert scale[6] == 0.0
    assert scale[5] == pytest.approx(24.0 / 37.5)


ROBOT, LIMITS = RobotModel(), GaitLimits()


def observation(error, elapsed=0.2, command=(0.3, 0.1), delay=0.0, direction=0.7):
    """A moment of the nominal gait whose DCM was `error` [m] off at the begin of the step."""
    start = step_start_dcm(
        nominal_gait(ROBOT, LIMITS, command, delay), ROBOT.pelvis_width, ROBOT.omega, delay
    )
    obs = np.zeros(OBSERVATION_SIZE)
    obs[ELAPSED], obs[COMMAND] = elapsed, command
    off = np.array(start) + error * np.array([np.cos(direction), np.sin(direction)])
    obs[DCM] = off * np.exp(ROBOT.omega * elapsed)
    return obs


def test_the_gate_is_shut_on_both_feet():
    gate = residual.ResidualGate(ROBOT, LIMITS, 0.0, (0.02, 0.06))
    walking, standing = observation(0.5), observation(0.5)
    standing[ELAPSED] = -1.0
    assert gate(np.array([walking, standing]))[:, 0].tolist() == [1.0, 0.0]


@pytest.mark.parametrize("delay", [0.0, 0.03])
@pytest.mark.parametrize("command", [(0.0, 0.0), (0.4, 0.0), (-0.2, 0.1), (0.0, -0.1)])
def test_opening_is_linear_in_the_error_of_the_dcm(command, delay):
    gate = residual.ResidualGate(ROBOT, LIMITS, delay, (0.02, 0.06))
    errors = np.array([0.0, 0.0199, 0.03, 0.04, 0.05, 0.0601, 0.5])
    rows = np.array([observation(e, command=command, delay=delay) for e in errors])
    np.testing.assert_allclose(gate(rows)[:, 0], np.clip((errors - 0.02) / 0.04, 0, 1), atol=1e-6)
    assert gate(rows)[0, 0] == 0.0
    assert gate(rows).dtype == np.float32


def test_batch_and_single_have_equal_bits():
    gate = residual.ResidualGate(ROBOT, LIMITS, 0.0, (0.02, 0.06))
    rows = np.array([observation(e) for e in np.linspace(0, 0.1, 9)])
    assert gate(rows).tobytes() == b"".join(gate(row[None]).tobytes() for row in rows)


@pytest.mark.parametrize(
    "band",
    [
        (0.06, 0.02),
        (0.02, 0.02),
        (-0.1, 0.1),
        (0, np.nan),
        (0, 10**400),
        (False, True),
        0.1,
        "wide",
        (1, 2, 3),
    ],
)
def test_impossible_gates_are_refused(band):
    with pytest.raises(InvalidValueError, match="0 <= shut < open"):
        residual.check_gate(band)


class Planning:
    """A user's policy: a planner behind a predict that takes the observation alone."""

    def __init__(self, planner):
        self.config, self._planner = planner.config, planner

    def predict(self, observation):
        return self._planner.predict(observation)[0]


def test_a_gate_takes_the_planners_touchdown_delay():
    planner = TwoStagePolicy(
        ROBOT, LIMITS, dataclasses.replace(preset_config("default"), touchdown_delay=0.03)
    )
    plain = as_policy(Planning(planner))
    assert isinstance(plain, PlainPolicy)
    for policy in (planner, plain):
        gate = residual.make_gate(policy, ROBOT, LIMITS, (0.02, 0.06))
        assert gate is not None
        assert gate(observation(0.0, delay=0.03)[None])[0, 0] == 0.0
    assert residual.make_gate(planner, ROBOT, LIMITS, None) is None


def test_a_gated_policy_is_the_planner_in_a_quiet_walk_and_survives_its_file(tmp_path):
    base = ResidualBase("two-stage", "default", (0.2,) * 7, preset_config("default"), (0.02, 0.06))
    network = Mlp((np.zeros((7, OBSERVATION_SIZE), np.float32),), (np.full(7, 0.5, np.float32),))
    normal = Normalisation(np.zeros(OBSERVATION_SIZE), np.ones(OBSERVATION_SIZE))
    policy = NetworkPolicy(
        network, normal, PolicyDescription("PushRecovery/Pendulum-v0", ROBOT, LIMITS, base)
    )
    policy.save(tmp_path / "gated")
    again = NetworkPolicy.load(tmp_path / "gated")
    planner = make_policy("two-stage", ROBOT, LIMITS)
    rows = np.array([observation(e) for e in (0.0, 0.015, 0.04, 0.1)])
    learned, own = again.predict(rows)[0], planner.predict(rows)[0]
    assert learned.tobytes() == policy.predict(rows)[0].tobytes()
    assert learned[:2].tobytes() == own[:2].tobytes()
    np.testing.assert_allclose(learned[2], np.clip(own[2] + 0.05, -1, 1), atol=1e-6)
    np.testing.assert_allclose(learned[3], np.clip(own[3] + 0.1, -1, 1), atol=1e-6)


SCALE = np.array([0.5, 0.25, 0.0, 1.0, 0.125, 2.0, 0.5], np.float32)
BASE = np.array([[0.5, -0.75, 0.1, 0.9, -0.9, 0.0, 0.3]], np.float32)
LEARNED = np.array([[0.5, -0.5, 1.0, 0.5, -1.0, -0.25, 0.0]], np.float32)
# by hand: base + scale x learned, held within [-1, 1]
SHIFT = np.array([[0.25, -0.125, 0.0, 0.5, -0.125, -0.5, 0.0]], np.float32)
TOTAL = np.array([[0.75, -0.875, 0.1, 1.0, -1.0, -0.5, 0.3]], np.float32)


class Fixed:
    """The same action everywhere; with a memory where `state` is given."""

    def __init__(self, state=None):
        self.state = state

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.repeat(BASE, len(observation), axis=0), self.state


def at_nominal_start(error: float) -> np.ndarray:
    """An observation at the start of a nominal step in place whose DCM is off by `error` along x [m]."""
    observation = np.zeros(36)
    gait = nominal_gait(ROBOT, LIMITS, (0.0, 0.0))
    growth = np.exp(ROBOT.omega * gait.duration)
    observation[1] = gait.offset_x + error
    observation[2] = (gait.width - ROBOT.pelvis_width) / (growth - 1) + ROBOT.pelvis_width / (growth + 1)
    return observation[None]


def test_base_shift_and_total_by_hand():
    rule = residual.ResidualRule(Fixed(), ROBOT, LIMITS, SCALE, None)
    found = rule.act(np.zeros((1, 36)), LEARNED)
    np.testing.assert_array_equal(found.base, BASE)
    np.testing.assert_array_equal(found.shift, SHIFT)
    np.testing.assert_array_equal(found.total, TOTAL)
    np.testing.assert_array_equal(rule.opening(np.zeros((3, 36))), np.ones((3, 1)))


@pytest.mark.parametrize(
    ("error", "opening"), [(0.0, 0.0), (0.02, 0.0), (0.03, 0.25), (-0.04, 0.5), (0.07, 1.0)]
)
def test_the_gate_scales_the_learned_action(error, opening):
    rule = residual.ResidualRule(Fixed(), ROBOT, LIMITS, SCALE, (0.02, 0.06))
    found = rule.act(at_nominal_start(error), LEARNED)
    np.testing.assert_allclose(rule.opening(at_nominal_start(error)), opening, atol=1e-6)
    np.testing.assert_allclose(found.shift, opening * SHIFT, atol=1e-6)
    if opening == 0.0:
        np.testing.assert_array_equal(found.total, BASE)


def test_an_action_beyond_the_box_passes_where_nothing_is_added_on_its_own():
    rule = residual.ResidualRule(Fixed(), ROBOT, LIMITS, SCALE, None)
    beyond = np.full((1, 7), 1.5, np.float32)
    np.testing.assert_array_equal(rule.correct(np.zeros((1, 36)), beyond, np.zeros_like(BASE)).total, beyond)


def test_a_policy_with_a_memory_is_refused():
    rule = residual.ResidualRule(Fixed(state=(np.zeros(1),)), ROBOT, LIMITS, SCALE, None)
    with pytest.raises(InvalidValueError, match="policy without memory"):
        rule.act(np.zeros((1, 36)), LEARNED)


def test_a_gate_knows_no_double_support_and_no_pelvis_beyond_the_box():
    with pytest.raises(InvalidValueError, match=r"knows no double support, got 0\.1 s"):
        residual.make_gate(make_policy("two-stage", preset="double-support"), ROBOT, LIMITS, (0.02, 0.06))
    with pytest.raises(InvalidValueError, match="pelvis_width must lie within"):
        residual.ResidualGate(RobotModel(pelvis_width=0.5), LIMITS, 0.0, (0.02, 0.06))


def test_a_base_beyond_the_box_is_clipped_where_it_acts(monkeypatch):
    beyond = np.full((1, 7), 1.5, np.float32)
    rule = residual.ResidualRule(Fixed(), ROBOT, LIMITS, SCALE, None)
    monkeypatch.setattr(rule.policy, "predict", lambda observations: (beyond, None))
    found = rule.act(np.zeros((1, 36)), np.zeros_like(BASE))
    np.testing.assert_array_equal(found.total, np.ones((1, 7)))
    np.testing.assert_array_equal(found.base, beyond)


def test_a_residual_on_the_nominal_walk_stays_on_it():
    below = ResidualBase("passive", "default", (0.0,) * 7, make_policy("passive").config).make(ROBOT, LIMITS)
    seen = np.zeros(36)
    seen[ELAPSED], seen[DCM] = 0.1, (0.15, 0.2)  # far off
    assert below.plan(seen).gait[:3] == pytest.approx([0.0, 0.2, 0.65])
