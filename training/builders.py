"""Environments of a run: what it trains and scores on, built from its settings."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor, VecNormalize

from ..controllers.errors import InvalidValueError
from ..controllers.model.robot import Similarity
from ..controllers.policies import two_stage
from ..controllers.policies.residual import ResidualRule
from ..envs.episode.episodes import GaitEpisodes
from ..envs.wrappers import ActionHold, ResidualAction
from ..eval.rollout import default_workers, environments
from ..eval.rollout.episodes import action_rule, batch_episodes
from ..eval.rollout.load_policy import acts_on_joints
from . import starts, vec_env
from .actor import Actor
from .reward import REWARDS
from .settings import STARTS, TrainingSettings

OBSERVATION_CLIP = 10.0
ROBOTS_A_THREAD = 4  # at least: with fewer, waking a thread costs what it saves


def make_plain_env(env_id: str, profile: Sequence[str] = ("exact",)) -> gym.Env:
    """The environment that policies are scored on.

    Raises:
        UnknownNameError: No such id is registered; the message lists the valid ones.
        InvalidValueError: It has not the interface that scoring needs, or a space is not a Box of one row.
    """
    env = environments.make_env(env_id, **({} if profile == ("exact",) else {"profile": profile}))
    for name, space in (("observation", env.observation_space), ("action", env.action_space)):
        if not (isinstance(space, gym.spaces.Box) and len(space.shape) == 1):
            raise InvalidValueError(f"{env_id} has the {name} space {space}; training needs a Box of one row")
    return env


def make_env(settings: TrainingSettings) -> gym.Env:
    """One training environment: the plain one, the residual, the hold."""
    env = make_plain_env(settings.env_id, settings.profile)
    if hasattr(env.unwrapped, "push_distribution"):
        env.unwrapped.push_distribution = settings.drawn_pushes.scaled(environments.size_of(env))  # type: ignore[attr-defined]
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


def layers_of(env: gym.Env) -> Iterator[gym.Wrapper]:
    """The wrappers of an environment, from the outermost on."""
    while isinstance(env, gym.Wrapper):
        yield env
        env = env.env


def find_residual(env: gym.Env) -> ResidualAction | None:
    """The residual among an environment's wrappers, or None."""
    return next((layer for layer in layers_of(env) if isinstance(layer, ResidualAction)), None)


def own_episodes(env: gym.Env, n: int) -> GaitEpisodes | None:
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
    episodes = own_episodes(env, 1)
    walks = episodes is not None and episodes.walks
    default = settings.left_open(episodes is not None, walks)
    can = {
        "starts": STARTS if walks else ("reset",),
        "reward": tuple(REWARDS) if episodes is not None else (default["reward"],),
    }
    for name, valid in can.items():
        if (value := getattr(settings, name)) is None:
            settings = replace(settings, **{name: default[name]})
        elif value not in valid:
            raise InvalidValueError(
                f"{settings.env_id} is trained with {name} {default[name]!r}, not {value!r}"
            )
    if settings.critic and episodes is None:
        raise InvalidValueError(f"nothing is known of {settings.env_id} that only its critic could see")
    inputs = default["inputs"]
    if settings.inputs is None:
        return replace(settings, inputs=inputs)
    if unknown := [name for name in settings.inputs if name not in inputs]:
        raise InvalidValueError(
            f"a network of kind {settings.kind!r} on {settings.env_id} has no input {unknown[0]!r}; "
            f"choose from: {', '.join(inputs)}"
        )
    return settings


def make_robots(settings: TrainingSettings, env: gym.Env, seed: int) -> VecEnv:
    """All training environments as one of Stable-Baselines3; arguments are those of `make_vec_env`.

    Where `env`, one of them, is this project's, they are robots on one core, whose physics all processor
    cores share; what comes out does not depend on how many. Others are called one by one.
    """
    episodes = own_episodes(env, settings.n_envs)
    if episodes is None:
        return DummyVecEnv([lambda: make_env(settings)] * settings.n_envs)
    rule = None
    if (residual := find_residual(env)) is not None:
        rule = ResidualRule(residual.policy, episodes.robot, episodes.limits, residual.scale, residual.gate)
    actor = Actor(episodes, settings.inputs or (), rule, settings.critic)
    reward = REWARDS[settings.reward or ""](episodes, settings.gamma)
    begin = make_starts(settings, episodes, seed)
    return vec_env.TrainingRobots(episodes, actor, begin, reward, settings.periods)


def make_starts(settings: TrainingSettings, episodes: GaitEpisodes, seed: int) -> starts.Starts:
    """Where the episodes of a run begin; for starts at pushes the walks are walked now."""
    size = Similarity.of(episodes.robot)
    pushes, easy = settings.drawn_pushes.scaled(size), settings.easy_pushes.scaled(size)
    walking, pushing = (np.random.default_rng(stream) for stream in np.random.SeedSequence(seed).spawn(2))
    like = None if settings.drawn_like is None else settings.drawn_like.scaled(size)
    choice = episodes, pushes, easy, settings.easy_share, settings.least_acceptance, pushing
    if settings.starts == "reset":
        return starts.ResetStarts(*choice, like=like, retries=settings.retries)
    planner = two_stage.make_policy(settings.policy, episodes.robot, episodes.limits, episodes.preset)
    walks = starts.take_walks(episodes, planner, like or pushes, settings.walks, walking)
    return starts.PushStarts(*choice, walks, like=like, retries=settings.retries)


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


def segment_seed(seed: int, timesteps: int) -> int:
    """Seed of a part of a run that begins after `timesteps`: a resumed run meets new pushes."""
    return int(np.random.SeedSequence([seed, timesteps]).generate_state(1)[0]) >> 1 if timesteps else seed
