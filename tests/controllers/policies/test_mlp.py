"""Networks with relu between the layers and a tanh after the last, and files from before there were any."""

import itertools
import json

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.capturability import capture_margin
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies import mlp
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription
from push_recovery.controllers.policies.residual import Below

ROBOT, LIMITS = RobotModel(), GaitLimits()


def test_blocks_stand_in_the_order_in_which_they_are_named():
    rng = np.random.default_rng(0)
    observations = rng.normal(0.0, 0.1, (4, 36))
    below = Below(rng.uniform(-1, 1, (4, 7)).astype(np.float32), rng.uniform(0, 1, (4, 1)).astype(np.float32))
    rows = mlp.NetworkInputs(("observation", "gate", "base"), ROBOT, LIMITS).rows(observations, below)
    assert rows.shape == (4, mlp.input_size(("observation", "gate", "base"), 36)) == (4, 44)
    np.testing.assert_array_equal(rows, np.hstack([observations, below.opening, below.base]))
    alone = mlp.NetworkInputs(("observation",), ROBOT, LIMITS).rows(observations, None)
    np.testing.assert_array_equal(alone, observations)


@pytest.mark.parametrize(("dcm", "wanted"), [((0.05, 0.02), None), ((9.0, 0.0), -0.5), ((0.0, 0.1), None)])
def test_the_margin_is_that_of_capturability_within_half_a_metre(dcm, wanted):
    """By the public function of the robot's model, from the same time, DCM and trunk."""
    observation = np.zeros((1, 36))
    observation[0, 0], observation[0, 1:3] = 0.1, dcm
    observation[0, 15:17], observation[0, 17:19] = (0.1, -0.05), (0.3, 0.2)
    margin = mlp.NetworkInputs(("observation", "margin"), ROBOT, LIMITS).rows(observation, None)[0, -1]
    exact = capture_margin(ROBOT, LIMITS, 0.1, dcm, (0.1, -0.05), (0.3, 0.2))
    assert margin == (exact if wanted is None else wanted)
    assert abs(exact) < 0.5 or wanted is not None


def test_a_margin_beyond_half_a_metre_tells_no_more():
    wide = GaitLimits(length_min=-9.0, length_max=9.0, width_max=9.0)
    assert capture_margin(ROBOT, wide, 0.1, (0.1, 3.0)) > 0.5
    observation = np.zeros((1, 36))
    observation[0, :3] = 0.1, 0.1, 3.0
    assert mlp.NetworkInputs(("observation", "margin"), ROBOT, wide).rows(observation, None)[0, -1] == 0.5


def test_inputs_that_cannot_be_are_refused():
    assert mlp.check_inputs(mlp.INPUTS, residual=True) == mlp.INPUTS
    with pytest.raises(UnknownNameError, match="input of a network 'force'"):
        mlp.check_inputs(("observation", "force"), residual=True)
    for wrong in ((), ("gate", "observation"), ("observation", "gate", "gate")):
        with pytest.raises(InvalidValueError, match="'observation' and then others, each once"):
            mlp.check_inputs(wrong, residual=True)
    for name in ("base", "gate"):
        with pytest.raises(InvalidValueError, match=f"only a residual has the input '{name}'"):
            PolicyDescription("Env-v0", ROBOT, LIMITS, inputs=("observation", name))


FORMS = list(itertools.product(mlp.ACTIVATIONS, mlp.OUTPUTS))
FUNCTIONS = {"tanh": np.tanh, "relu": lambda x: np.where(x > 0.0, x, 0.0), "linear": lambda x: x}
OBSERVATIONS = np.random.default_rng(2).normal(size=(40, 36))


def network(activation, output, sizes=(36, 24, 16, 7)):
    rng = np.random.default_rng(0)
    shapes = list(itertools.pairwise(sizes))
    weights = tuple(rng.normal(0, 1.5 / np.sqrt(i), (o, i)).astype(np.float32) for i, o in shapes)
    biases = tuple(rng.normal(0, 0.3, o).astype(np.float32) for _, o in shapes)
    return mlp.Mlp(weights, biases, activation, output)


def policy(*form):
    about = PolicyDescription("PushRecovery/Pendulum-v0", RobotModel(), GaitLimits())
    return NetworkPolicy(network(*form), mlp.Normalisation(np.zeros(36), np.ones(36)), about)


@pytest.mark.parametrize("form", FORMS)
def test_forward_is_the_network_in_double_precision(form):
    net = network(*form)
    x = OBSERVATIONS.astype(np.float32).astype(np.float64)
    for name, w, b in zip((form[0], form[0], form[1]), net.weights, net.biases, strict=True):
        x = FUNCTIONS[name](x @ w.T.astype(np.float64) + b)
    np.testing.assert_allclose(net.forward(OBSERVATIONS.astype(np.float32)), x, atol=3e-6)


def test_the_forms_differ():
    outputs = [network(*form).forward(OBSERVATIONS.astype(np.float32)) for form in FORMS]
    for one, other in itertools.combinations(outputs, 2):
        assert np.abs(one - other).max() > 0.01


def test_a_network_is_tanh_with_a_linear_output_unless_told_otherwise():
    net = network("tanh", "linear")
    assert mlp.Mlp(net.weights, net.biases) == net


@pytest.mark.parametrize("form", [("gelu", "linear"), ("linear", "linear"), ("tanh", "relu"), ("tanh", None)])
def test_other_forms_are_refused(form):
    with pytest.raises(UnknownNameError, match=r"unknown (activation|output)"):
        network(*form)


@pytest.mark.parametrize("form", FORMS)
def test_a_file_keeps_the_form(tmp_path, form):
    p = policy(*form)
    q = NetworkPolicy.load(p.save(tmp_path / "p"))
    assert (q.network.activation, q.network.output) == form
    assert q.predict(OBSERVATIONS)[0].tobytes() == p.predict(OBSERVATIONS)[0].tobytes()


@pytest.mark.parametrize("earlier", [1, 2])
def test_files_of_earlier_versions_are_tanh_networks_with_a_linear_output(tmp_path, earlier):
    p = policy("tanh", "linear")
    path = p.save(tmp_path / "p").with_suffix(".json")
    about = json.loads(path.read_text())
    assert about["format_version"] == 3
    del about["output"]
    path.write_text(json.dumps(about))
    with pytest.raises(InvalidValueError, match="lacks output"):
        NetworkPolicy.load(path)
    path.write_text(json.dumps(about | {"format_version": earlier}))
    assert NetworkPolicy.load(path).predict(OBSERVATIONS)[0].tobytes() == p.predict(OBSERVATIONS)[0].tobytes()


@pytest.mark.parametrize("epsilon", [0.0, -1e-8, np.nan, np.inf])
def test_a_constant_entry_needs_an_epsilon(epsilon):
    """(x - mean) / sqrt(0 + 0) is no number."""
    with pytest.raises(InvalidValueError, match="epsilon > 0"):
        mlp.Normalisation(np.zeros(2), np.zeros(2), epsilon=epsilon)
