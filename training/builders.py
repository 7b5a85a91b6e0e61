"""The environments and the PPO of a run: Stable-Baselines3's own, with wrappers only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor, VecNormalize

from ..controllers.errors import InvalidValueError
from ..controllers.policies.residual_gate import ResidualGate, make_gate
from ..envs.episode.vector_env import GaitVectorEnv
from ..envs.residual.action_hold import ActionHold
from ..envs.residual.vector_env import ResidualVectorEnv
from ..envs.residual.wrapper import ResidualAction
from ..eval.rollout import environments
from ..eval.rollout.batch import batch_episodes
from ..eval.rollout.load_policy import acts_on_joints
from ..eval.rollout.names import default_workers
from ..eval.rollout.wrapped_action import action_rule
from .gated_ppo import GatedPPO, GateNormalize
from .sb3_vec_env import SB3VecEnv
from .settings import TrainingSettings

OBSERVATION_CLIP = 10.0
ROBOTS_A_THREAD = 4  # at least: with fewer, waking a thread costs what it saves


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
    env = environments.make_env(env_id)
    for name, space in (("observation", env.observation_space), ("action", env.action_space)):
        if not (isinstance(space, gym.spaces.Box) and len(space.shape) == 1):
            raise InvalidValueError(f"{env_id} has the {name} space {space}; training needs a Box of one row")
    return env


def make_env(settings: TrainingSettings) -> gym.Env:
    """One training environment: the plain one, the residual, the hold."""
    env = make_plain_env(settings.env_id)
    if hasattr(env.unwrapped, "push_distribution"):
        env.unwrapped.push_distribution = settings.pushes  # type: ignore[attr-defined]
    if acts_on_joints(env) != settings.on_joints:
        kinds = ("residual", "scratch") if settings.on_joints else ("joint", "joint-residual")
        raise InvalidValueError(
            f"{settings.env_id} does not take the actions of the kind {settings.kind!r}; choose from: "
            f"{', '.join(kinds)}"
        )
    if settings.residual:
        if find_residual(env) is not None:
            raise InvalidValueError(
                f"{settings.env_id} takes residuals already; name the environment below it"
            )
        env = ResidualAction(env, settings.policy, settings.scale, gate=settings.gate)
    return ActionHold(env, settings.hold)


def find_residual(env: gym.Env) -> ResidualAction | None:
    """The residual among an environment's wrappers, or None."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, ResidualAction):
            return env
        env = env.env
    return None


def make_robots(settings: TrainingSettings, env: gym.Env) -> VecEnv:
    """All training environments as one of Stable-Baselines3.

    Where `env`, one of them, is this project's, they are robots of one native vector environment, whose
    physics all cores share; what comes out does not depend on how many. Others are called one by one.
    """
    n, rule = settings.n_envs, action_rule(env)
    threads = min(default_workers(), -(-n // ROBOTS_A_THREAD))
    episodes = None if rule is None else batch_episodes(rule.env, n, threads)
    if rule is None or episodes is None:
        return DummyVecEnv([lambda: make_env(settings)] * n)
    pushes, residual = rule.env.push_distribution, rule.residual
    if residual is None:
        return SB3VecEnv(GaitVectorEnv(episodes, pushes, "Disabled", hold=rule.hold))
    return SB3VecEnv(
        ResidualVectorEnv(
            episodes, residual.policy, residual.scale, hold=rule.hold, gate=residual.gate,
            push_distribution=pushes, autoreset_mode="Disabled",
        )
    )  # fmt: skip


def find_gate(env: gym.Env) -> ResidualGate | None:
    """The gate of an environment's residual, or None."""
    residual, unwrapped = find_residual(env), env.unwrapped
    if residual is None:
        return None
    return make_gate(residual.policy, unwrapped.robot, unwrapped.limits, residual.gate)  # type: ignore[attr-defined]


def make_vec_env(settings: TrainingSettings, seed: int) -> VecNormalize:
    """All training environments, with episode statistics and normalised observations (and rewards)."""
    env = make_env(settings)
    venv, gate = VecMonitor(make_robots(settings, env)), find_gate(env)
    venv.seed(seed)
    options = {
        "norm_reward": settings.normalise_reward,
        "clip_obs": OBSERVATION_CLIP,
        "gamma": settings.gamma,
    }
    return VecNormalize(venv, **options) if gate is None else GateNormalize(venv, gate, **options)


def make_ppo(settings: TrainingSettings, venv: VecNormalize, seed: int, out: Path | None) -> PPO:
    """PPO with a tanh network whose last policy layer is zero: the untrained residual is the policy below."""
    torch.set_num_threads(1)  # a small network gains nothing from more, and its sums would depend on them
    model = (GatedPPO if isinstance(venv, GateNormalize) else PPO)(
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
