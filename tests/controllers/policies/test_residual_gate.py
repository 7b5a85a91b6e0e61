import dataclasses

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.controllers.model.observation import COMMAND, DCM, ELAPSED, OBSERVATION_SIZE
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.interface import PlainPolicy, as_policy
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription, ResidualBase
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.controllers.policies.residual import ResidualGate, check_gate, make_gate
from push_recovery.controllers.policies.two_stage import TwoStagePolicy, make_policy
from push_recovery.controllers.settings import preset_config

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


@pytest.mark.parametrize("delay", [0.0, 0.03])
@pytest.mark.parametrize("command", [(0.0, 0.0), (0.4, 0.0), (-0.2, 0.1), (0.0, -0.1)])
def test_opening_is_linear_in_the_error_of_the_dcm(command, delay):
    gate = ResidualGate(ROBOT, LIMITS, delay, (0.02, 0.06))
    errors = np.array([0.0, 0.0199, 0.03, 0.04, 0.05, 0.0601, 0.5])
    rows = np.array([observation(e, command=command, delay=delay) for e in errors])
    np.testing.assert_allclose(gate(rows)[:, 0], np.clip((errors - 0.02) / 0.04, 0, 1), atol=1e-6)
    assert gate(rows)[0, 0] == 0.0
    assert gate(rows).dtype == np.float32


def test_batch_and_single_have_equal_bits():
    gate = ResidualGate(ROBOT, LIMITS, 0.0, (0.02, 0.06))
    rows = np.array([observation(e) for e in np.linspace(0, 0.1, 9)])
    assert gate(rows).tobytes() == b"".join(gate(row[None]).tobytes() for row in rows)


@pytest.mark.parametrize(
    "band", [(0.06, 0.02), (0.02, 0.02), (-0.1, 0.1), (0, np.nan), 0.1, "wide", (1, 2, 3)]
)
def test_impossible_gates_are_refused(band):
    with pytest.raises(InvalidValueError, match="0 <= shut < open"):
        check_gate(band)


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
        gate = make_gate(policy, ROBOT, LIMITS, (0.02, 0.06))
        assert gate is not None
        assert gate(observation(0.0, delay=0.03)[None])[0, 0] == 0.0
    assert make_gate(planner, ROBOT, LIMITS, None) is None


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
