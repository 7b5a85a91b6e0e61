"""PPO whose value network sees more than its policy network (Pinto et al., 2017)."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor


class AsymmetricExtractor(MlpExtractor):
    """Hidden layers of both networks, of which that of the policy sees the first `seen` inputs only.

    Args:
        seen: inputs of the policy network.
        feature_dim: inputs of the value network.
        options: those of `MlpExtractor`.
    """

    def __init__(self, seen: int, feature_dim: int, **options: Any):
        super().__init__(feature_dim, **options)
        self.seen = seen
        first: Any = self.policy_net[0]
        self.policy_net[0] = torch.nn.Linear(seen, first.out_features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Of the policy network, features (n, feature_dim)."""
        return self.policy_net(features[:, : self.seen])


class AsymmetricPolicy(ActorCriticPolicy):
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
