"""Proximal policy optimisation, whose value network may see more and may learn first."""

from dataclasses import dataclass
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common import policies, torch_layers
from stable_baselines3.common.callbacks import BaseCallback

from ..controllers.errors import InvalidValueError
from .actor import critic_size
from .algorithm import Algorithm


class PPOAlgorithm(Algorithm):
    """PPO with a tanh network whose last policy layer is zero: an untrained residual is the policy below."""

    model: PPO

    def make(self, seed: int, log: str | None) -> PPO:
        """PPO with the settings' own initial exploration noise for every action, which it then adapts.

        Raises:
            InvalidValueError: there are neither one nor as many log_std as actions.
        """
        settings = self.settings
        policy, options = "MlpPolicy", {}
        if settings.critic:
            inputs: Any = self.venv.observation_space.shape
            policy, options = AsymmetricPolicy, {"seen": inputs[0] - critic_size(settings.critic)}
        model = PPO(
            policy,
            self.venv,
            learning_rate=FallingRate(settings.learning_rate, settings.learning_rate_end),
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

    def callbacks(self) -> list[BaseCallback]:
        """The rest of the policy for the first `value_first` timesteps."""
        return [ValueFirst(self.settings.value_first)]


@dataclass(frozen=True)
class FallingRate:
    """Learning rate that falls linearly from `start` to `end` as the remaining share goes from 1 to 0."""

    start: float
    end: float

    def __call__(self, remaining: float) -> float:
        """Rate at a remaining share of the run in [0, 1]."""
        return self.end + (self.start - self.end) * remaining


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
