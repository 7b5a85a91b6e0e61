"""Policies as ONNX: the same numbers, what the output means, and no file where it would be wrong."""

import itertools
import json
import sys

import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription, ResidualBase
from push_recovery.controllers.policies.mlp import ACTIVATIONS, OUTPUTS, Mlp, Normalisation
from push_recovery.eval.cli.main import main
from push_recovery.eval.record import onnx_export as write
from push_recovery.eval.record.onnx_export import ExportError, export_onnx, met_inputs, metadata, onnx_model
from push_recovery.eval.rollout.environments import make_env

onnx = pytest.importorskip("onnx")
reference = pytest.importorskip("onnx.reference")

PENDULUM = "PushRecovery/Pendulum-v0"
FORMS = list(itertools.product(ACTIVATIONS, OUTPUTS))


def make_policy(form=("tanh", "linear"), residual=False, env_id=PENDULUM, width=64):
    """A random network as wide as trained ones; means far from zero, of small deviations."""
    rng = np.random.default_rng(5)
    inputs = ("observation", "base", "gate", "margin") if residual else ("observation",)
    size = 45 if residual else 36
    shapes = list(itertools.pairwise((size, width, width, 7)))
    network = Mlp(
        tuple(rng.normal(0, 0.8 / np.sqrt(i), (o, i)).astype(np.float32) for i, o in shapes),
        tuple(rng.normal(0, 0.1, o).astype(np.float32) for _, o in shapes),
        *form,
    )  # fmt: skip
    variance = rng.uniform(1e-4, 1.0, size)
    variance[3] = 0.0  # of an input that never changed
    normalisation = Normalisation(rng.normal(size=size), variance, clip=5.0)
    base = ResidualBase("two-stage", "default", (0.3,) * 7, gate=(0.02, 0.06)) if residual else None
    about = PolicyDescription(env_id, RobotModel(), GaitLimits(), base, hold=2, inputs=inputs)
    return NetworkPolicy(network, normalisation, about)


def run(model, rows):
    (found,) = reference.ReferenceEvaluator(model).run(None, {"inputs": np.asarray(rows, np.float32)})
    return found


@pytest.mark.parametrize("form", FORMS)
def test_the_graph_is_the_network_in_double_precision(form):
    policy = make_policy(form)
    n, rng = policy.normalisation, np.random.default_rng(0)
    rows = (n.mean + 4.0 * np.sqrt(n.variance) * rng.normal(size=(200, 36))).astype(np.float32)
    x = np.clip((rows.astype(float) - n.mean) / np.sqrt(n.variance + 1e-8), -5.0, 5.0)
    functions = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0), "linear": lambda x: x}
    layers = (form[0], form[0], form[1]), policy.network.weights, policy.network.biases
    for name, w, b in zip(*layers, strict=True):
        x = functions[name](x @ w.T.astype(float) + b)
    assert np.abs(x).max() > 0.5
    found = run(onnx_model(policy), rows)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, np.clip(x, -1.0, 1.0), atol=2e-6)


def test_the_output_is_clipped_to_the_actions():
    policy = make_policy()
    wide = Mlp(policy.network.weights, tuple(9.0 + b for b in policy.network.biases))
    found = run(onnx_model(NetworkPolicy(wide, policy.normalisation, policy.description)), np.zeros((1, 36)))
    np.testing.assert_array_equal(found, 1.0)


@pytest.mark.parametrize("residual", [False, True])
def test_a_written_file_gives_what_the_policy_learned(tmp_path, residual):
    policy, env, path = make_policy(residual=residual), make_env(PENDULUM), tmp_path / "p.onnx"
    assert 0.0 <= export_onnx(policy, env, path) <= 1e-6
    observation, _ = env.reset(seed=3)
    seen = policy.network_inputs(observation)
    assert seen.shape == (1, 45 if residual else 36)
    model = onnx.load(path)
    (output,) = model.graph.output
    assert output.name == ("correction" if residual else "action")
    np.testing.assert_allclose(run(model, seen)[0], policy.learned_action(observation), atol=1e-4)


def test_the_check_meets_a_walk_that_is_pushed():
    """The push opens the gate of a walk that keeps it shut before."""
    met = met_inputs(make_policy(residual=True), make_env(PENDULUM))
    assert met.shape[0] > 50
    assert met[0, 43] == 0.0
    assert met[:, 43].max() > 0.5


def test_the_metadata_says_what_to_do_with_the_output(tmp_path):
    policy = make_policy(residual=True)
    about = {entry.key: entry.value for entry in onnx_model(policy).metadata_props}
    assert about == metadata(policy)
    assert "clip(base + g * scale * correction, -1, 1)" in about["use"]
    assert json.loads(about["inputs"]) == ["observation", "base", "gate", "margin"]
    residual = json.loads(about["residual"])
    assert (residual["policy"], residual["gate"], about["hold"]) == ("two-stage", [0.02, 0.06], "2")
    np.testing.assert_array_equal(np.float32(residual["scale"]), np.float32([0.3] * 7))
    assert "correction" not in metadata(make_policy())["use"]


def test_a_graph_that_differs_is_not_written(tmp_path, monkeypatch):
    policy, other = make_policy(), make_policy()
    biases = (*other.network.biases[:-1], other.network.biases[-1] + np.float32(3e-6))
    shifted = NetworkPolicy(Mlp(other.network.weights, biases), other.normalisation, other.description)
    monkeypatch.setattr(write, "onnx_model", lambda _: onnx_model(shifted))
    with pytest.raises(ExportError, match=r"differs from numpy by [34](\.\d)?e-06"):
        export_onnx(policy, make_env(PENDULUM), tmp_path / "p.onnx")
    assert list(tmp_path.iterdir()) == []


def test_a_bad_place_and_a_missing_extra_are_named_before_the_work(tmp_path, monkeypatch):
    with pytest.raises(InvalidValueError, match=r"ends in \.onnx"):
        export_onnx(make_policy(), make_env(PENDULUM), tmp_path / "p")
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'push-recovery\[onnx\]'"):
        export_onnx(make_policy(), make_env(PENDULUM), tmp_path / "p.onnx")


def test_the_command_writes_a_file_and_refuses_what_is_no_network(tmp_path, capsys):
    name = toy.save_policy(tmp_path / "p", 2.0) + ".safetensors"
    path = tmp_path / "p.onnx"
    words = ["--onnx", str(path), "--env", toy.ENV_ID]
    assert main(["export", name, *words]) == 0
    assert "agrees with numpy to" in capsys.readouterr().out
    found = run(onnx.load(path), np.full((1, 36), 0.25))
    np.testing.assert_allclose(found, [[-0.5, -0.5, 0, 0, 0, 0, 0]], atol=1e-6)  # a gain of 2 on the DCM
    for bad, said in (
        (["two-stage", *words], "has no network"),
        ([name, "--onnx", str(tmp_path / "p.pt"), "--env", toy.ENV_ID], "ends in .onnx"),
        ([name, "--onnx", str(path / "x.onnx"), "--env", toy.ENV_ID], "can't write"),
    ):
        assert main(["export", *bad]) == 2
        assert said in capsys.readouterr().err
