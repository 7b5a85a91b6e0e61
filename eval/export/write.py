"""An ONNX file of a learned policy, written only where it computes what the policy does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, PushRecoveryError
from ...controllers.files import write_atomically
from ...controllers.learned.network import NetworkPolicy
from ...envs.scenario.push import polar_push
from ...envs.scenario.scenario import Scenario
from ..output.place import require_place
from ..rollout.one import rollout
from .graph import INPUT, onnx_model, require_onnx

TOLERANCE = 1e-6  # between the graph and numpy, in units of the action
RANDOM = 1000  # inputs of the check that are drawn, spread as those of the training were
PUSHED = Scenario("export", (polar_push(250.0, 2.0, 0.1, 0.5),), duration=2.5)  # 25 N s, back and to the left


class ExportError(PushRecoveryError):
    """A file does not compute what its policy does; it was not written."""


def export_onnx(policy: NetworkPolicy, env: gym.Env, path: Path) -> float:
    """Write a policy as ONNX; returns the largest difference from numpy that was met.

    It is compared on random inputs and on those that the policy meets in an episode with a push.

    Args:
        policy: of a file, or from Stable-Baselines3.
        env: that it acts in.
        path: of the file.

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


def random_inputs(policy: NetworkPolicy) -> NDArray[np.float64]:
    """RANDOM inputs (n, i), normal, with twice the deviation that those of the training had."""
    n = policy.normalisation
    draws = np.random.default_rng(0).normal(size=(RANDOM, n.mean.size))
    return n.mean + 2.0 * np.sqrt(n.variance) * draws


def met_inputs(policy: NetworkPolicy, env: gym.Env) -> NDArray[np.float64]:
    """What the network sees (n, i) in an episode with a push."""
    met: list[NDArray[np.float64]] = []

    class Watched:
        def predict(
            self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
        ) -> tuple[Any, Any]:
            met.append(policy.network_inputs(observation))
            return policy.predict(observation, state, episode_start, deterministic)

    rollout(env, Watched(), PUSHED, "export")
    return np.concatenate(met)


def largest_difference(content: bytes, policy: NetworkPolicy, inputs: NDArray[np.float32]) -> float:
    """Of a file's outputs from those of numpy for the same inputs (n, i), in units of the action."""
    import onnx
    from onnx.reference import ReferenceEvaluator

    model = onnx.load_from_string(content)
    onnx.checker.check_model(model, full_check=True)
    (theirs,) = ReferenceEvaluator(model).run(None, {INPUT: inputs})
    ours = policy.network.forward(policy.normalisation.apply(inputs.astype(np.float64)))
    return float(np.abs(np.asarray(theirs, np.float64) - np.clip(ours, -1.0, 1.0)).max())
