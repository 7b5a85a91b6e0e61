"""Networks with relu between the layers and a tanh after the last, and files from before there were any."""

import itertools
import json

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription
from push_recovery.controllers.policies.mlp import ACTIVATIONS, OUTPUTS, Mlp, Normalisation

FORMS = list(itertools.product(ACTIVATIONS, OUTPUTS))
FUNCTIONS = {"tanh": np.tanh, "relu": lambda x: np.where(x > 0.0, x, 0.0), "linear": lambda x: x}
OBSERVATIONS = np.random.default_rng(2).normal(size=(40, 36))


def network(activation, output, sizes=(36, 24, 16, 7)):
    rng = np.random.default_rng(0)
    shapes = list(itertools.pairwise(sizes))
    weights = tuple(rng.normal(0, 1.5 / np.sqrt(i), (o, i)).astype(np.float32) for i, o in shapes)
    biases = tuple(rng.normal(0, 0.3, o).astype(np.float32) for _, o in shapes)
    return Mlp(weights, biases, activation, output)


def policy(*form):
    about = PolicyDescription("PushRecovery/Pendulum-v0", RobotModel(), GaitLimits())
    return NetworkPolicy(network(*form), Normalisation(np.zeros(36), np.ones(36)), about)


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
    assert Mlp(net.weights, net.biases) == net


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
