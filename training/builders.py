"""The environments and the PPO of a run: Stable-Baselines3's own, with wrappers only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor, VecNormalize

from ..controllers.errors import InvalidValueError
from ..controllers.model.robot import Similarity
from ..controllers.policies.interface import Policy
from ..controllers.policies.mlp import BASE, GATE, MARGIN, OBSERVATION
from ..controllers.policies.residual import ResidualRule
from ..controllers.policies.two_stage import make_policy
from ..envs.biped.env import BipedEpisodes
from ..envs.episode.episodes import GaitEpisodes
from ..envs.joint.env import JointEpisodes, JointResidualEpisodes
from ..envs.wrappers import ActionHold, ResidualAction
from ..eval.rollout import environments
from ..eval.rollout.episodes import action_rule, batch_episodes
from ..eval.rollout.load_policy import acts_on_joints
from ..eval.rollout.names import default_workers
from .actor import Actor, critic_size
from .networks import AsymmetricPolicy
from .reward import REWARDS
from .settings import STARTS, TrainingSettings
from .starts import PushStarts, ResetStarts, Starts, Uncorrected, take_walks
from .vec_env import TrainingRobots

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


def make_plain_env(env_id: str, profile: str = "exact") -> gym.Env:
    """The environment that policies are scored on.

    Args:
        env_id: of it.
        profile: of the robots in scenarios that are drawn; only bipeds know another than exact.

    Raises:
        UnknownNameError: No such id is registered; the message lists the valid ones.
        InvalidValueError: It has not the interface that scoring needs, or a space is not a Box of one row.
    """
    env = environments.make_env(env_id, **({} if profile == "exact" else {"profile": profile}))
    for name, space in (("observation", env.observation_space), ("action", env.action_space)):
        if not (isinstance(space, gym.spaces.Box) and len(space.shape) == 1):
            raise InvalidValueError(f"{env_id} has the {name} space {space}; training needs a Box of one row")
    return env


def make_env(settings: TrainingSettings) -> gym.Env:
    """One training environment: the plain one, the residual, the hold."""
    env = make_plain_env(settings.env_id, settings.profile)
    if hasattr(env.unwrapped, "push_distribution"):
        env.unwrapped.push_distribution = settings.pushes.scaled(environments.size_of(env))  # type: ignore[attr-defined]
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
    return ActionHold(env, settings.periods)


def find_residual(env: gym.Env) -> ResidualAction | None:
    """The residual among an environment's wrappers, or None."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, ResidualAction):
            return env
        env = env.env
    return None


def own_episodes(settings: TrainingSettings, env: gym.Env, n: int) -> GaitEpisodes | None:
    """Episodes of n robots like that of a training environment; None where it is not this project's."""
    rule = action_rule(env)
    threads = min(default_workers(), -(-n // ROBOTS_A_THREAD))
    return None if rule is None else batch_episodes(rule.env, n, threads)


def completed(settings: TrainingSettings, env: gym.Env) -> TrainingSettings:
    """Settings of which none is left open, as the environment allows.

    Raises:
        InvalidValueError: the environment does not allow what they say.
    """
    settings = replace(settings, hold=settings.periods)
    episodes = own_episodes(settings, env, 1)
    blocks = (OBSERVATION, BASE, GATE, MARGIN) if settings.residual else (OBSERVATION, MARGIN)
    rewards = ("recovery", "environment")
    if settings.kind == "joint":  # which has to walk by itself and learns nothing from ends alone
        rewards = ("environment", "recovery")
    can = {
        "starts": STARTS if planned_for(episodes) else ("reset",),
        "reward": ("environment",) if episodes is None else rewards,
        "inputs": (OBSERVATION,) if episodes is None or settings.on_joints else blocks,
    }
    for name in ("starts", "reward"):
        if (value := getattr(settings, name)) is None:
            settings = replace(settings, **{name: can[name][0]})
        elif value not in can[name]:
            raise InvalidValueError(
                f"{settings.env_id} is trained with {name} {can[name][0]!r}, not {value!r}"
            )
    if settings.critic and episodes is None:
        raise InvalidValueError(f"nothing is known of {settings.env_id} that only its critic could see")
    if settings.inputs is None:
        return replace(settings, inputs=can["inputs"])
    if unknown := [name for name in settings.inputs if name not in can["inputs"]]:
        raise InvalidValueError(
            f"a network of kind {settings.kind!r} on {settings.env_id} has no input {unknown[0]!r}; "
            f"choose from: {', '.join(can['inputs'])}"
        )
    return settings


def planned_for(episodes: GaitEpisodes | None) -> bool:
    """Whether a planner can walk these robots, and each be put back into its walk."""
    return isinstance(episodes, BipedEpisodes) and not isinstance(episodes, JointEpisodes)


def make_robots(settings: TrainingSettings, env: gym.Env, seed: int) -> VecEnv:
    """All training environments as one of Stable-Baselines3.

    Where `env`, one of them, is this project's, they are robots on one core, whose physics all processor
    cores share; what comes out does not depend on how many. Others are called one by one.

    Args:
        settings: completed.
        env: a training environment.
        seed: of the pushes and walks.
    """
    episodes = own_episodes(settings, env, settings.n_envs)
    if episodes is None:
        return DummyVecEnv([lambda: make_env(settings)] * settings.n_envs)
    residual = find_residual(env)
    rule = None
    if residual is not None:
        rule = ResidualRule(residual.policy, episodes.robot, episodes.limits, residual.scale, residual.gate)
    actor = Actor(episodes, settings.inputs or (), rule, settings.critic)
    starts = make_starts(settings, episodes, seed)
    reward = REWARDS[settings.reward or ""](episodes, settings.gamma)
    return TrainingRobots(episodes, actor, starts, reward, settings.periods)


def make_starts(settings: TrainingSettings, episodes: GaitEpisodes, seed: int) -> Starts:
    """Where the episodes of a run begin; for starts at pushes the walks are walked now."""
    size = Similarity.of(episodes.robot)
    pushes, easy = settings.drawn_pushes.scaled(size), settings.easy_pushes.scaled(size)
    walking, pushing = (np.random.default_rng(stream) for stream in np.random.SeedSequence(seed).spawn(2))
    shares = settings.easy_share, settings.least_acceptance
    if settings.starts == "reset":
        return ResetStarts(episodes, pushes, easy, *shares, pushing)
    walker: Policy = make_policy(settings.policy, episodes.robot, episodes.limits, episodes.preset)
    if isinstance(episodes, JointResidualEpisodes):  # whose planner is within
        walker = Uncorrected(episodes.action_size)
    walks = take_walks(episodes, walker, pushes, settings.walks, walking)
    return PushStarts(episodes, walks, pushes, easy, *shares, pushing)


def make_vec_env(settings: TrainingSettings, env: gym.Env, seed: int) -> VecNormalize:
    """All training environments, with episode statistics and normalised observations (and rewards).

    Args:
        settings: completed.
        env: a training environment.
        seed: of the pushes and walks.
    """
    venv = VecMonitor(make_robots(settings, env, seed))
    venv.seed(seed)
    normalise = settings.normalise_reward
    return VecNormalize(
        venv,
        norm_reward=settings.reward == "environment" if normalise is None else normalise,
        clip_obs=OBSERVATION_CLIP,
        gamma=settings.gamma,
    )


def make_ppo(settings: TrainingSettings, venv: VecNormalize, seed: int, out: Path | None) -> PPO:
    """PPO with a tanh network whose last policy layer is zero: the untrained residual is the policy below."""
    torch.set_num_threads(1)  # a small network gains nothing from more, and its sums would depend on them
    policy, options = "MlpPolicy", {}
    if settings.critic:
        inputs: Any = venv.observation_space.shape
        policy, options = AsymmetricPolicy, {"seen": inputs[0] - critic_size(settings.critic)}
    model = PPO(
        policy,
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
            **options,
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
