"""The interface of a learning algorithm in a training run, around a model of Stable-Baselines3.

A new algorithm is a subclass of `Algorithm` in a file of its own, and a line of `settings.ALGORITHMS`.
"""

import importlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common import base_class, save_util
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from ..controllers.errors import InvalidValueError
from ..controllers.policies.learned import NetworkPolicy
from ..controllers.policies.mlp import Mlp
from .from_sb3 import acting_network
from .settings import ALGORITHMS, TrainingSettings

KEPT = 1e15  # observations that count as seen before: what a run adds to them changes nothing
Tensors = dict[str, NDArray[Any]]


class Algorithm(ABC):
    """A model of Stable-Baselines3 that learns on the environments of a run.

    Args:
        settings: of the run, completed.
        venv: its environments.
        seed: of weights and exploration.
        log: folder of TensorBoard's files, or None.

    Raises:
        InvalidValueError: the settings ask for a GPU, and there is none.
    """

    def __init__(self, settings: TrainingSettings, venv: VecNormalize, seed: int, log: Path | None = None):
        if settings.device != "cpu" and not torch.cuda.is_available():
            raise InvalidValueError(
                f"training setting device is {settings.device!r}, and torch finds no GPU here; take cpu"
            )
        torch.set_num_threads(settings.threads)
        self.settings, self.venv = settings, venv
        self.model = self.make(seed, None if log is None else str(log))

    @abstractmethod
    def make(self, seed: int, log: str | None) -> base_class.BaseAlgorithm:
        """The untrained model on `self.venv`, with the hyperparameters of `self.settings`."""

    def callbacks(self) -> list[BaseCallback]:
        """Callbacks of its own while it learns; none by default."""
        return []

    def learn(self, timesteps: int, callbacks: Sequence[BaseCallback]) -> None:
        """Go on for some timesteps, at least; counting goes on, too."""
        torch.set_num_threads(self.settings.threads)  # a teacher may have shown with one since
        model: Any = self.model
        model.learn(
            timesteps,
            callback=[*callbacks, *self.callbacks()],
            reset_num_timesteps=model.num_timesteps == 0,
            tb_log_name=self.settings.algorithm,
        )

    @property
    def updates(self) -> int:
        """Gradient epochs so far, Stable-Baselines3's counter."""
        return self.model._n_updates  # type: ignore[attr-defined]

    def network(self) -> Mlp:
        """The network that it acts by without exploration, in numpy."""
        return acting_network(self.model).mlp()

    def start_from(self, policy: NetworkPolicy) -> None:
        """Give the acting network the weights of a policy, and the environments its normalisation.

        The normalisation stays as it is from then on: the weights were learned behind it. What only a critic
        sees stands behind it, and passes as it is.

        Raises:
            InvalidValueError: layers, activation or output are others, or clip or epsilon of the
            normalisation.
        """
        acting, given = acting_network(self.model), policy.network
        found = tuple((layer.in_features, layer.out_features) for layer in acting.layers)
        wanted = tuple((weight.shape[1], weight.shape[0]) for weight in given.weights)
        if found != wanted:
            raise InvalidValueError(
                f"a run that starts from a policy needs its layers, {wanted}, got {found}: set policy_layers"
            )
        kinds = [f"{one.activation} and {one.output}" for one in (given, acting)]
        if kinds[0] != kinds[1]:
            raise InvalidValueError(
                f"a run that starts from a policy needs its activation and output, {kinds[0]}, got {kinds[1]}"
            )
        normalisation, statistics = policy.normalisation, self.statistics()["observation"]
        if (self.venv.clip_obs, self.venv.epsilon) != (normalisation.clip, normalisation.epsilon):
            raise InvalidValueError(
                f"the policy's clip and epsilon {(normalisation.clip, normalisation.epsilon)} are not the "
                f"environments', {(self.venv.clip_obs, self.venv.epsilon)}"
            )
        for layer, weight, bias in zip(acting.layers, given.weights, given.biases, strict=True):
            layer.weight.data.copy_(torch.from_numpy(weight))
            layer.bias.data.copy_(torch.from_numpy(bias))
        more = len(statistics.mean) - len(normalisation.mean)
        statistics.mean = np.append(normalisation.mean, np.zeros(more))
        statistics.var = np.append(normalisation.variance, np.ones(more))
        statistics.count = KEPT

    def statistics(self) -> dict[str, Any]:
        """The running mean and variance of observations and returns, by the names of a checkpoint."""
        return {"observation": self.venv.obs_rms, "return": self.venv.ret_rms}

    def tensors(self) -> Tensors:
        """All that training needs to go on, by name: networks, optimisers, running statistics."""
        tensors: dict[str, Any] = {}
        parts, variables = self.model._get_torch_save_params()
        for part in parts:
            whole = save_util.recursive_getattr(self.model, part)
            state = whole.state_dict()
            if isinstance(whole, torch.optim.Optimizer):
                state = {
                    f"{index}.{key}": value
                    for index, moments in state["state"].items()
                    for key, value in moments.items()
                }
            tensors |= {f"{part.removeprefix('policy.')}.{name}": value for name, value in state.items()}
        tensors |= {name: save_util.recursive_getattr(self.model, name).detach() for name in variables}
        arrays = {name: value.cpu().numpy().copy() for name, value in tensors.items()}
        for name, statistics in self.statistics().items():
            values = (("mean", statistics.mean), ("variance", statistics.var), ("count", statistics.count))
            arrays |= {f"{name}.{key}": np.array(value, dtype=np.float64) for key, value in values}
        return arrays

    def restore(self, tensors: Mapping[str, NDArray[Any]], timesteps: int, updates: int) -> None:
        """Go on from the tensors and counters of a checkpoint.

        Raises:
            InvalidValueError: the checkpoint is of other spaces or layers.
        """
        parts, variables = self.model._get_torch_save_params()
        try:
            for part in parts:
                whole = save_util.recursive_getattr(self.model, part)
                state: dict[str, Any] = _under(tensors, f"{part.removeprefix('policy.')}.")
                if isinstance(whole, torch.optim.Optimizer):
                    moments: dict[int, dict[str, torch.Tensor]] = {}
                    for name, tensor in state.items():
                        index, key = name.split(".", 1)
                        moments.setdefault(int(index), {})[key] = tensor
                    state = whole.state_dict() | {"state": moments}
                whole.load_state_dict(state)
            for name in variables:
                parameter = save_util.recursive_getattr(self.model, name)
                parameter.data.copy_(torch.from_numpy(tensors[name].copy()))
            shapes = {"observation": self.model.observation_space.shape, "return": ()}
            for name, statistics in self.statistics().items():
                mean, variance = tensors[f"{name}.mean"], tensors[f"{name}.variance"]
                if {mean.shape, variance.shape} != {shapes[name]}:
                    raise ValueError(
                        f"statistics of the {name} have shape {mean.shape}, expected {shapes[name]}"
                    )
                statistics.mean, statistics.var = mean.copy(), variance.copy()
                statistics.count = float(tensors[f"{name}.count"])
        except (RuntimeError, KeyError, ValueError) as error:
            raise InvalidValueError(
                f"the checkpoint of {self.settings.env_id} does not fit its environment: {error}"
            ) from error
        self.model.num_timesteps, self.model._n_updates = timesteps, updates  # type: ignore[attr-defined]


def _under(tensors: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, torch.Tensor]:
    """The tensors whose names begin with a prefix, without it."""
    named = {name: value for name, value in tensors.items() if name.startswith(prefix)}
    return {name.removeprefix(prefix): torch.from_numpy(value.copy()) for name, value in named.items()}


def make_algorithm(
    settings: TrainingSettings, venv: VecNormalize, seed: int, log: Path | None = None
) -> Algorithm:
    """The algorithm of the settings, see `Algorithm`."""
    kind = ALGORITHMS[settings.algorithm]
    if isinstance(kind, str):  # loaded only here: it needs torch
        module, _, name = kind.partition(":")
        kind = getattr(importlib.import_module(module, __package__), name)
    return kind(settings, venv, seed, log)
