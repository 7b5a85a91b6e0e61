import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.capturability import capture_margin
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.learned import PolicyDescription
from push_recovery.controllers.policies.mlp import INPUTS, NetworkInputs, check_inputs, input_size
from push_recovery.controllers.policies.residual import Below

ROBOT, LIMITS = RobotModel(), GaitLimits()


def test_blocks_stand_in_the_order_in_which_they_are_named():
    rng = np.random.default_rng(0)
    observations = rng.normal(0.0, 0.1, (4, 36))
    below = Below(rng.uniform(-1, 1, (4, 7)).astype(np.float32), rng.uniform(0, 1, (4, 1)).astype(np.float32))
    rows = NetworkInputs(("observation", "gate", "base"), ROBOT, LIMITS).rows(observations, below)
    assert rows.shape == (4, input_size(("observation", "gate", "base"), 36)) == (4, 44)
    np.testing.assert_array_equal(rows, np.hstack([observations, below.opening, below.base]))
    alone = NetworkInputs(("observation",), ROBOT, LIMITS).rows(observations, None)
    np.testing.assert_array_equal(alone, observations)


@pytest.mark.parametrize(("dcm", "wanted"), [((0.05, 0.02), None), ((9.0, 0.0), -0.5), ((0.0, 0.1), None)])
def test_the_margin_is_that_of_capturability_within_half_a_metre(dcm, wanted):
    """By the public function of the robot's model, from the same time, DCM and trunk."""
    observation = np.zeros((1, 36))
    observation[0, 0], observation[0, 1:3] = 0.1, dcm
    observation[0, 15:17], observation[0, 17:19] = (0.1, -0.05), (0.3, 0.2)
    margin = NetworkInputs(("observation", "margin"), ROBOT, LIMITS).rows(observation, None)[0, -1]
    exact = capture_margin(ROBOT, LIMITS, 0.1, dcm, (0.1, -0.05), (0.3, 0.2))
    assert margin == (exact if wanted is None else wanted)
    assert abs(exact) < 0.5 or wanted is not None


def test_a_margin_beyond_half_a_metre_tells_no_more():
    wide = GaitLimits(length_min=-9.0, length_max=9.0, width_max=9.0)
    assert capture_margin(ROBOT, wide, 0.1, (0.1, 3.0)) > 0.5
    observation = np.zeros((1, 36))
    observation[0, :3] = 0.1, 0.1, 3.0
    assert NetworkInputs(("observation", "margin"), ROBOT, wide).rows(observation, None)[0, -1] == 0.5


def test_inputs_that_cannot_be_are_refused():
    assert check_inputs(INPUTS, residual=True) == INPUTS
    with pytest.raises(UnknownNameError, match="input of a network 'force'"):
        check_inputs(("observation", "force"), residual=True)
    for wrong in ((), ("gate", "observation"), ("observation", "gate", "gate")):
        with pytest.raises(InvalidValueError, match="'observation' and then others, each once"):
            check_inputs(wrong, residual=True)
    for name in ("base", "gate"):
        with pytest.raises(InvalidValueError, match=f"only a residual has the input '{name}'"):
            PolicyDescription("Env-v0", ROBOT, LIMITS, inputs=("observation", name))
