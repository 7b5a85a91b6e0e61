"""A learned policy's network as an ONNX graph, written only where it computes what the policy does."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.errors import InvalidValueError, MissingExtraError, PushRecoveryError
from ...controllers.files import write_atomically
from ...controllers.policies.learned import NetworkPolicy
from ...envs.scenario.push import polar_push
from ...envs.scenario.scenario import Scenario
from ..output.rows import require_place
from ..rollout.episodes import rollout
from .record import Array, RecordedPolicy

OPSET, IR = 17, 8  # which runtimes of 2022 and later read
INPUT = "inputs"
NODES = {"tanh": "Tanh", "relu": "Relu"}


def require_onnx() -> Any:
    """Onnx; raises MissingExtraError, naming the command that installs it, where it is not there."""
    try:
        import onnx
    except ImportError as error:
        raise MissingExtraError("onnx", "onnx") from error
    return onnx


def onnx_model(policy: NetworkPolicy) -> Any:
    """Normalisation, network and clip to [-1, 1]: float32 inputs (n, i) to float32 (n, a), as a ModelProto.

    The normalisation clip((x - mean) / sqrt(variance + epsilon), -clip, clip) is in double precision, as
    numpy's is: a large mean over a small deviation would cost digits. The metadata say how to use the output.
    """
    onnx = require_onnx()
    helper, kinds = onnx.helper, onnx.TensorProto
    parts, n = _Parts(onnx), policy.normalisation
    row = parts.add("Cast", INPUT, to=kinds.DOUBLE)
    row = parts.add("Sub", row, parts.constant(n.mean))
    row = parts.add("Div", row, parts.constant(np.sqrt(n.variance + n.epsilon)))
    row = parts.add("Clip", row, *(parts.constant(np.float64(end)) for end in (-n.clip, n.clip)))
    row = parts.add("Cast", row, to=kinds.FLOAT)
    network, last = policy.network, len(policy.network.weights) - 1
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        row = parts.add("Gemm", row, parts.constant(weight), parts.constant(bias), transB=1)
        kind = network.activation if i < last else network.output
        row = parts.add(NODES[kind], row) if kind in NODES else row
    bounds = [parts.constant(np.float32(bound)) for bound in (-1.0, 1.0)]
    name = "action" if policy.description.residual is None else "correction"
    parts.add("Clip", row, *bounds, output=name)
    begin, end = (
        helper.make_tensor_value_info(end, kinds.FLOAT, ["n", size])
        for end, size in ((INPUT, network.sizes[0]), (name, network.sizes[-1]))
    )
    graph = helper.make_graph(parts.nodes, "push-recovery policy", [begin], [end], parts.constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR)
    helper.set_model_props(model, metadata(policy))
    return model


class _Parts:
    """Nodes and constants of a graph, in the order in which they are made."""

    def __init__(self, onnx: Any):
        self._onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any) -> str:
        """The name of a constant."""
        name = f"constant_{len(self.constants)}"
        self.constants.append(self._onnx.numpy_helper.from_array(np.asarray(value), name))
        return name

    def add(self, kind: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        """The name of the output of a node."""
        name = output or f"row_{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(kind, list(inputs), [name], **attributes))
        return name


def metadata(policy: NetworkPolicy) -> dict[str, str]:
    """Meaning of the graph's input and output, and the use of the latter; dataclasses as JSON."""
    about = policy.description
    use = "The output is the action of env_id, in [-1, 1]"
    if about.residual is not None:
        use = (
            "The output is a correction, no action: action = clip(base + g * scale * correction, -1, 1), "
            "base the action of residual.policy with the weights in residual.config, g = clip((e - shut) / "
            "(open - shut), 0, 1) with (shut, open) = residual.gate and e the distance of the DCM, traced "
            "back to the begin of the step, from the nominal gait's [m]; g = 1 where residual.gate is null"
        )
    return {
        "format": "push-recovery policy",
        "use": f"{use}. A new one is due every `hold` planning periods; base and g in each.",
        "env_id": about.env_id,
        "inputs": json.dumps(list(about.inputs)),
        "hold": str(about.hold),
        "residual": json.dumps(None if about.residual is None else asdict(about.residual)),
        "robot": json.dumps(asdict(about.robot)),
        "limits": json.dumps(asdict(about.limits)),
    }


TOLERANCE = 1e-6  # between the graph and numpy, in units of the action
RANDOM = 1000  # inputs of the check that are drawn, spread as those of the training were
PUSHED = Scenario("export", (polar_push(250.0, 2.0, 0.1, 0.5),), duration=2.5)  # 25 N s, back and to the left


class ExportError(PushRecoveryError):
    """A file does not compute what its policy does; it was not written."""


def export_onnx(policy: NetworkPolicy, env: gym.Env, path: Path) -> float:
    """Write a policy, which acts in `env`, as ONNX; returns the largest difference from numpy that was met.

    It is compared on random inputs and on those that the policy meets in an episode with a push.

    Raises:
        MissingExtraError: onnx is not installed.
        InvalidValueError: nothing can be written there.
        ExportError: the graph gives something else; nothing is written.
    """
    require_onnx()
    if path.suffix != ".onnx":
        raise InvalidValueError(f"an ONNX file ends in .onnx, got {str(path)!r}")
    require_place(path)
    content = onnx_model(policy).SerializeToString()
    inputs = np.concatenate([random_inputs(policy), met_inputs(policy, env)])
    difference = largest_difference(content, policy, inputs.astype(np.float32))
    if not difference <= TOLERANCE:
        raise ExportError(
            f"the ONNX graph of the policy differs from numpy by {difference:.2g} in the action, more than "
            f"{TOLERANCE:g}; {path} was not written"
        )
    write_atomically(path, content)
    return difference


def random_inputs(policy: NetworkPolicy) -> Array:
    """RANDOM inputs (n, i), normal, with twice the deviation that those of the training had."""
    n = policy.normalisation
    draws = np.random.default_rng(0).normal(size=(RANDOM, n.mean.size))
    return n.mean + 2.0 * np.sqrt(n.variance) * draws


def met_inputs(policy: NetworkPolicy, env: gym.Env) -> Array:
    """Inputs of the network (n, i) in an episode with a push."""
    recorded = RecordedPolicy(policy)
    rollout(env, recorded, PUSHED, "export")
    return np.concatenate([policy.network_inputs(seen) for seen in recorded.observations])


def largest_difference(content: bytes, policy: NetworkPolicy, inputs: np.ndarray) -> float:
    """Largest difference of a file's outputs from numpy's for inputs (n, i), in units of the action."""
    import onnx
    from onnx.reference import ReferenceEvaluator

    model = onnx.load_from_string(content)
    onnx.checker.check_model(model, full_check=True)
    (theirs,) = ReferenceEvaluator(model).run(None, {INPUT: inputs})
    ours = policy.network.forward(policy.normalisation.apply(inputs.astype(np.float64)))
    return float(np.abs(np.asarray(theirs, np.float64) - np.clip(ours, -1.0, 1.0)).max())
