"""Proximal policy optimisation, whose value network may see more and may learn first."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common import policies, torch_layers
from stable_baselines3.common.callbacks import BaseCallback

from ..controllers.errors import InvalidValueError
from .actor import critic_size
from .algorithm import Algorithm, Tensors

RATE = "rate.now"  # name in a checkpoint


class PPOAlgorithm(Algorithm):
    """PPO with a tanh network whose last policy layer is zero: an untrained residual is the policy below."""

    model: PPO

    def make(self, seed: int, log: str | None) -> PPO:
        """PPO with the settings' own initial exploration noise for every action, which it then adapts.

        Raises:
            InvalidValueError: there are neither one nor as many log_std as actions.
        """
        settings = self.settings
        self._adapted = (
            None if settings.wanted_kl is None else AdaptedRate(settings.learning_rate, settings.wanted_kl)
        )
        policy, options = "MlpPolicy", {}
        if settings.critic:
            inputs: Any = self.venv.observation_space.shape
            policy, options = AsymmetricPolicy, {"seen": inputs[0] - critic_size(settings.critic)}
        model = PPO(
            policy,
            self.venv,
            learning_rate=self._adapted or FallingRate(settings.learning_rate, settings.learning_rate_end),
            n_steps=settings.n_steps,
            batch_size=settings.minibatch,
            n_epochs=settings.n_epochs,
            gamma=settings.gamma,
            gae_lambda=settings.gae_lambda,
            clip_range=settings.clip_range,
            target_kl=settings.target_kl,
            policy_kwargs={
                "net_arch": {"pi": list(settings.policy_layers), "vf": list(settings.value_layers)},
                "activation_fn": torch.nn.Tanh,
                **options,
            },
            tensorboard_log=log,
            seed=seed,
            device=settings.device,
        )
        for parameter in model.policy.action_net.parameters():
            torch.nn.init.zeros_(parameter)
        log_std: torch.Tensor = model.policy.log_std.data
        initial = settings.initial_log_std
        if len(initial) not in {1, log_std.numel()}:
            raise InvalidValueError(
                f"log_std must be one number or {log_std.numel()} for the actions of {settings.env_id}, "
                f"got {list(initial)}"
            )
        log_std.copy_(torch.tensor(initial))
        return model

    def tensors(self) -> Tensors:
        """Those of every algorithm, and the rate that it has adapted."""
        return super().tensors() | ({} if self._adapted is None else {RATE: np.array(self._adapted.now)})

    def restore(self, tensors: Mapping[str, NDArray[Any]], timesteps: int, updates: int) -> None:
        """Go on with the rate of the checkpoint, too, where it has one."""
        super().restore(tensors, timesteps, updates)
        if self._adapted is not None and RATE in tensors:
            self._adapted.now = float(tensors[RATE])

    def callbacks(self) -> list[BaseCallback]:
        """The rest of the policy for the first `value_first` timesteps, its noise and its rate."""
        settings = self.settings
        own: list[BaseCallback] = [ValueFirst(settings.value_first)]
        if settings.log_std_end is not None:
            own.append(FallingNoise(settings.initial_log_std, settings.log_std_end, settings.timesteps))
        if self._adapted is not None:
            own.append(HoldDivergence(self._adapted))
        return own


@dataclass(frozen=True)
class FallingRate:
    """Learning rate that falls linearly from `start` to `end` as the remaining share goes from 1 to 0."""

    start: float
    end: float

    def __call__(self, remaining: float) -> float:
        """Rate at a remaining share of the run in [0, 1]."""
        return self.end + (self.start - self.end) * remaining


LEAST_RATE, LARGEST_RATE = 1e-6, 1e-2  # of Adam
FACTOR = 1.5  # of a change of the rate


@dataclass
class AdaptedRate:
    """Learning rate that is `now`, whatever remains of the run; it holds updates near a wanted divergence."""

    now: float
    wanted: float

    def __call__(self, remaining: float) -> float:
        """The rate."""
        return self.now

    def adapt(self, divergence: float) -> None:
        """Lower it after a divergence of more than twice the wanted one, raise it after less than half.

        This is the rule of Schulman et al. (2017), section 4, on the rate in place of the penalty. A policy
        that rests, whose divergence is 0, says nothing of the rate.
        """
        if divergence > 2.0 * self.wanted:
            self.now = max(self.now / FACTOR, LEAST_RATE)
        elif 0.0 < divergence < 0.5 * self.wanted:
            self.now = min(self.now * FACTOR, LARGEST_RATE)


class HoldDivergence(BaseCallback):
    """Adapts the rate after each update to the divergence that Stable-Baselines3 has logged of it."""

    def __init__(self, rate: AdaptedRate):
        super().__init__()
        self.rate = rate

    def _on_rollout_start(self) -> None:
        divergence = self.model.logger.name_to_value.get("train/approx_kl")
        if divergence is not None:  # there has been no update yet
            self.rate.adapt(float(divergence))

    def _on_step(self) -> bool:
        return True


class FallingNoise(BaseCallback):
    """Bounds the log-std of every action: linearly in the timesteps, from the `initial` ones to `end`."""

    def __init__(self, initial: tuple[float, ...], end: float, timesteps: int):
        super().__init__()
        self.initial, self.end, self.timesteps = torch.tensor(initial), end, timesteps

    def _on_rollout_start(self) -> None:
        done = min(1.0, self.num_timesteps / self.timesteps)
        policy: Any = self.model.policy
        log_std: torch.Tensor = policy.log_std.data
        bound = self.initial + (self.end - self.initial) * done
        log_std.copy_(torch.minimum(log_std, bound.to(log_std.device)))

    def _on_step(self) -> bool:
        return True


class ValueFirst(BaseCallback):
    """Lets the policy rest until the value network has learned what it is worth."""

    def __init__(self, timesteps: int):
        super().__init__()
        self.timesteps = timesteps

    def _on_rollout_start(self) -> None:
        policy: Any = self.model.policy
        acts = self.num_timesteps >= self.timesteps
        parts = policy.mlp_extractor.policy_net, policy.action_net
        for parameter in (policy.log_std, *(one for part in parts for one in part.parameters())):
            parameter.requires_grad_(acts)

    def _on_step(self) -> bool:
        return True


class AsymmetricExtractor(torch_layers.MlpExtractor):
    """Hidden layers of both networks; the policy's see the first `seen` inputs only (Pinto et al., 2017)."""

    def __init__(self, seen: int, feature_dim: int, **options: Any):
        super().__init__(feature_dim, **options)
        self.seen = seen
        first: Any = self.policy_net[0]
        self.policy_net[0] = torch.nn.Linear(seen, first.out_features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Output of the policy network's hidden layers for features (n, feature_dim)."""
        return self.policy_net(features[:, : self.seen])


class AsymmetricPolicy(policies.ActorCriticPolicy):
    """`MlpPolicy` with an `AsymmetricExtractor`; `seen` is its argument more."""

    def __init__(self, *arguments: Any, seen: int, **options: Any):
        self.seen = seen
        super().__init__(*arguments, **options)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | {"seen": self.seen}

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = AsymmetricExtractor(
            self.seen,
            self.features_dim,
            net_arch=self.net_arch,
            activation_fn=self.activation_fn,
            device=self.device,
        )
