"""What an action of a wrapped environment does to the gait: it is held, or added to a policy's own."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing
from numpy.typing import NDArray

from ...controllers.policies.random import RandomPolicy
from ...controllers.policies.two_stage import TwoStagePolicy
from ...envs.episode.env import GaitEnv
from ...envs.residual.action_hold import ActionHold
from ...envs.residual.wrapper import ResidualAction

Actions = NDArray[np.float32]


class ActionRule:
    """`ActionHold` around `ResidualAction`, each where there is one, for many robots; the same bits.

    Args:
        env: the gait environment below.
        residual: the wrapper whose policy acts below; None where actions are gait actions.
        hold: planning periods for which an action is held.
    """

    def __init__(self, env: GaitEnv, residual: ResidualAction | None = None, hold: int = 1):
        self.env, self.residual, self.hold = env, residual, hold

    def gait_actions(self, observations: NDArray[np.float64], actions: Actions) -> Actions:
        """Gait actions (n, 7) that actions (n, 7) mean at observations (n, 36)."""
        if self.residual is None:
            return actions
        return self.residual.act(observations, actions).total


def action_rule(env: gym.Env) -> ActionRule | None:
    """The rule of an environment; None where it has wrappers that are not known to change nothing else."""
    hold, residual, layer = 1, None, env
    while isinstance(layer, gym.Wrapper):
        if residual is None and _steps_as(layer, ActionHold):
            hold *= layer.periods  # type: ignore[attr-defined]
        elif residual is None and _steps_as(layer, ResidualAction):
            residual = layer
        elif type(layer) is not OrderEnforcing:
            return None
        layer = layer.env
    if not isinstance(layer, GaitEnv):
        return None
    if residual is None:
        return ActionRule(layer, None, hold)
    if type(residual.policy) not in {TwoStagePolicy, RandomPolicy}:  # type: ignore[attr-defined]
        return None  # it may remember, or depend on what else is in the batch
    return ActionRule(layer, residual, hold)  # type: ignore[arg-type]


def _steps_as(layer: Any, wrapper: type[gym.Wrapper]) -> bool:
    """Whether a layer is such a wrapper, or differs from it in nothing that acts."""
    return isinstance(layer, wrapper) and all(
        getattr(type(layer), name) is getattr(wrapper, name) for name in ("reset", "step")
    )
