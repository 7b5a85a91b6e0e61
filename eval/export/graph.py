"""A learned policy's network as an ONNX graph."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np

from ...controllers.errors import MissingExtraError
from ...controllers.learned.network import NetworkPolicy

OPSET, IR = 17, 8  # which runtimes of 2022 and later read
INPUT = "inputs"
NODES = {"tanh": "Tanh", "relu": "Relu"}


def require_onnx() -> None:
    """Raise MissingExtraError, naming the command that installs it, unless onnx is there."""
    try:
        import onnx  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("onnx", "onnx") from error


def output_name(policy: NetworkPolicy) -> str:
    """What the graph's output is called: what a residual's network gives is no action."""
    return "action" if policy.description.residual is None else "correction"


def onnx_model(policy: NetworkPolicy) -> Any:
    """Normalisation, network and clip to [-1, 1]: float32 inputs (n, i) to float32 (n, a), as a ModelProto.

    The normalisation is in double precision, as numpy's is: a large mean over a small deviation would cost
    digits. What is to be done with the output stands in the metadata.

    Args:
        policy: of a file, or from Stable-Baselines3.
    """
    require_onnx()
    from onnx import TensorProto, helper

    parts = _Parts()
    row = parts.normalised(policy)
    network, last = policy.network, len(policy.network.weights) - 1
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        row = parts.add("Gemm", row, parts.constant(weight), parts.constant(bias), transB=1)
        kind = network.activation if i < last else network.output
        row = parts.add(NODES[kind], row) if kind in NODES else row
    bounds = [parts.constant(np.float32(bound)) for bound in (-1.0, 1.0)]
    name = output_name(policy)
    parts.add("Clip", row, *bounds, output=name)
    begin, end = (
        helper.make_tensor_value_info(end, TensorProto.FLOAT, ["n", size])
        for end, size in ((INPUT, network.sizes[0]), (name, network.sizes[-1]))
    )
    graph = helper.make_graph(parts.nodes, "push-recovery policy", [begin], [end], parts.constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR)
    helper.set_model_props(model, metadata(policy))
    return model


class _Parts:
    """Nodes and constants of a graph, in the order in which they are made."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any) -> str:
        """The name of a constant."""
        from onnx import numpy_helper

        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def add(self, kind: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        """The name of the output of a node."""
        from onnx import helper

        name = output or f"row_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def normalised(self, policy: NetworkPolicy) -> str:
        """The name of clip((x - mean) / sqrt(variance + epsilon), -clip, clip) of the graph's input x."""
        from onnx import TensorProto

        n = policy.normalisation
        deviation = np.sqrt(n.variance + n.epsilon)
        row = self.add("Cast", INPUT, to=TensorProto.DOUBLE)
        row = self.add("Sub", row, self.constant(n.mean))
        row = self.add("Div", row, self.constant(deviation))
        row = self.add("Clip", row, *(self.constant(np.float64(end)) for end in (-n.clip, n.clip)))
        return self.add("Cast", row, to=TensorProto.FLOAT)


def metadata(policy: NetworkPolicy) -> dict[str, str]:
    """What the graph's input and output are, and what to do with the latter; records as JSON."""
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
