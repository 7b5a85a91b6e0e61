"""The environments and the PPO of a run: Stable-Baselines3's own, with wrappers only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from ..controllers.errors import InvalidValueError
from ..envs.action_hold import ActionHold
from ..envs.residual import ResidualAction
from ..eval import loading
from .quiet import SkipQuiet
from .settings import TrainingSettings

OBSERVATION_CLIP = 10.0


@dataclass(frozen=True)
class FallingRate:
    """Learning rate that falls linearly from `start` to `end` as the remaining share goes from 1 to 0."""

    start: float
    end: float

    def __call__(self, remaining: float) -> float:
        """Rate at a remaining share of the run in [0, 1]."""
        return self.end + (self.start - self.end) * remaining


def make_plain_env(env_id: str) -> gym.Env:
    """The environment that policies are scored on.

    Raises:
        UnknownNameError: No such id is registered; the message lists the valid ones.
        InvalidValueError: It has not the interface that scoring needs, or a space is not a Box of one row.
    """
    env = loading.make_env(env_id)
    for name, space in (("observation", env.observation_space), ("action", env.action_space)):
        if not (isinstance(space, gym.spaces.Box) and len(space.shape) == 1):
            raise InvalidValueError(f"{env_id} has the {name} space {space}; training needs a Box of one row")
    return env


def make_env(settings: TrainingSettings) -> gym.Env:
    """One training environment: the plain one, the residual, the hold."""
    env = make_plain_env(settings.env_id)
    if hasattr(env.unwrapped, "push_distribution"):
        env.unwrapped.push_distribution = settings.pushes  # type: ignore[attr-defined]
    if settings.residual:
        if find_residual(env) is not None:
            raise InvalidValueError(
                f"{settings.env_id} takes residuals already; name the environment below it"
            )
        env = ResidualAction(env, settings.policy, settings.scale, gate=settings.gate)
    return ActionHold(env, settings.hold)


def make_learning_env(settings: TrainingSettings) -> gym.Env:
    """What PPO steps through: the training environment, without what a shut gate takes from it."""
    env = make_env(settings)
    residual = find_residual(env)
    if residual is None or residual.gate is None:
        return env
    return SkipQuiet(env, residual)


def find_residual(env: gym.Env) -> ResidualAction | None:
    """The residual among an environment's wrappers, or None."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, ResidualAction):
            return env
        env = env.env
    return None


def make_vec_env(settings: TrainingSettings, seed: int) -> VecNormalize:
    """All training environments, with episode statistics and normalised observations (and rewards).

    They run in this process: a planning period costs less than its way to another process and back.
    """
    venv = VecMonitor(DummyVecEnv([lambda: make_learning_env(settings) for _ in range(settings.n_envs)]))
    venv.seed(seed)
    return VecNormalize(
        venv,
        norm_reward=settings.normalise_reward,
        clip_obs=OBSERVATION_CLIP,
        gamma=settings.gamma,
    )


def make_ppo(settings: TrainingSettings, venv: VecNormalize, seed: int, out: Path | None) -> PPO:
    """PPO with a tanh network whose last policy layer is zero: the untrained residual is the policy below."""
    torch.set_num_threads(1)  # the environments need the cores
    model = PPO(
        "MlpPolicy",
        venv,
        learning_rate=FallingRate(settings.learning_rate, settings.learning_rate_end),
        n_steps=settings.n_steps,
        batch_size=settings.minibatch,
        n_epochs=settings.n_epochs,
        gamma=settings.gamma,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip_range,
        policy_kwargs={
            "net_arch": {"pi": list(settings.policy_layers), "vf": list(settings.value_layers)},
            "activation_fn": torch.nn.Tanh,
        },
        tensorboard_log=None if out is None else str(out / "tensorboard"),
        seed=seed,
        device="cpu",
    )
    for parameter in model.policy.action_net.parameters():
        torch.nn.init.zeros_(parameter)
    _set_log_std(model, settings)
    return model


def _set_log_std(model: PPO, settings: TrainingSettings) -> None:
    """Give every action its own initial exploration noise, which PPO then adapts."""
    log_std: torch.Tensor = model.policy.log_std.data
    initial = settings.initial_log_std
    if len(initial) not in {1, log_std.numel()}:
        raise InvalidValueError(
            f"log_std must be one number or {log_std.numel()} for the actions of {settings.env_id}, "
            f"got {list(initial)}"
        )
    log_std.copy_(torch.tensor(initial))


def segment_seed(seed: int, timesteps: int) -> int:
    """Seed of a run's part that begins after `timesteps`, so that a resumed run meets new pushes."""
    return int(np.random.SeedSequence([seed, timesteps]).generate_state(1)[0]) >> 1 if timesteps else seed
