"""Models of Stable-Baselines3 as policies that can be saved, scored and shipped.

The policy of a run as a `NetworkPolicy`, which needs neither torch nor Stable-Baselines3.

A model of Stable-Baselines3 as a policy that can be saved, scored and shipped.

A model that Stable-Baselines3 has saved, as a policy: whoever loads one runs the code in it.
"""

from __future__ import annotations

import hashlib
import importlib
import io
import json
import pickle
import zipfile
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecNormalize

from ..controllers.errors import InvalidValueError, MissingExtraError
from ..controllers.files import read_file
from ..controllers.policies.learned import NetworkPolicy, PolicyDescription, ResidualBase
from ..controllers.policies.mlp import OBSERVATION, Mlp, Normalisation
from ..controllers.policies.two_stage import POLICY_NAMES
from ..envs.wrappers import ActionHold, ResidualAction
from .builders import find_residual
from .networks import network_of, normalisation_of
from .settings import ENV_OF_KIND, TrainingSettings


def export_policy(
    network: Mlp, venv: VecNormalize, env: gym.Env, settings: TrainingSettings
) -> NetworkPolicy:
    """The policy as it stands, in numpy.

    Args:
        network: that it acts by.
        venv: Its normalisation.
        env: One training environment, for the robot, the limits and the policy below.
        settings: Of the run, completed.
    """
    unwrapped: Any = env.unwrapped
    wrapper = find_residual(env) if settings.residual else None  # or it is the environment's own
    base = None if wrapper is None else residual_base(wrapper, settings.policy)
    description = PolicyDescription(
        settings.env_id,
        unwrapped.robot,
        unwrapped.limits,
        base,
        settings.periods,
        settings.inputs or (OBSERVATION,),
    )
    below = None if wrapper is None else wrapper.policy
    whole = normalisation_of(venv)
    seen = slice(network.weights[0].shape[1])  # what only the critic sees stands behind it
    normalisation = replace(whole, mean=whole.mean[seen], variance=whole.variance[seen])
    return NetworkPolicy(network, normalisation, description, below)


def residual_base(wrapper: ResidualAction, name: str) -> ResidualBase:
    """What a residual corrects, the policy below by its name."""
    preset = str(wrapper.unwrapped.preset)  # type: ignore[attr-defined]
    config = getattr(wrapper.policy, "config", None)
    return ResidualBase(name, preset, tuple(wrapper.scale.tolist()), config, wrapper.gate)


TOLERANCE = 1e-5  # between numpy and torch, in units of the action
SAMPLES = 256  # observations of the check


def from_sb3(model: Any, env: gym.Env, normalise: VecNormalize | None = None) -> NetworkPolicy:
    """PPO or SAC as a policy that needs neither torch nor Stable-Baselines3.

        from_sb3(model, gym.make("push_recovery:PushRecovery/BipedResidual-v0", hold=2)).save("mine")

    What it gives is compared with the model's own `predict` before it is returned.

    Args:
        model: with an MlpPolicy of tanh or relu layers.
        env: like one of those that it was trained in, wrappers included: a residual and a hold become part of
            the policy.
        normalise: of its observations, where it was trained with one.

    Raises:
        InvalidValueError: the model acts by something that a policy file does not hold, or the environment is
            not like those of its training.
    """
    _check_spaces(model, env)
    network = network_of(model)
    normalisation = normalisation_of(normalise, network.sizes[0])
    _check_agreement(model, network, normalisation, normalise)
    wrapper, hold = find_residual(env), _hold(env)
    unwrapped: Any = env.unwrapped
    if lacks := [part for part in ("robot", "limits", "preset") if not hasattr(unwrapped, part)]:
        raise InvalidValueError(f"a policy file is for a gait environment; {env} has no {', '.join(lacks)}")
    if unwrapped.spec is None:
        raise InvalidValueError(f"{env} has no id, under which its policy could be scored: use gym.make")
    env_id = unwrapped.spec.id
    if wrapper is not None:  # a residual's policy acts on the environment below
        env_id = ENV_OF_KIND["residual"].get(env_id, env_id)
    base = None if wrapper is None else _base(wrapper)
    about = PolicyDescription(env_id, unwrapped.robot, unwrapped.limits, base, hold)
    return NetworkPolicy(network, normalisation, about, None if wrapper is None else wrapper.policy)


def _base(wrapper: ResidualAction) -> ResidualBase:
    """What a residual corrects, by name."""
    policy: Any = wrapper.policy
    name = getattr(policy, "name", None)
    if name not in POLICY_NAMES:
        raise InvalidValueError(
            f"a policy file names what it corrects, one of {', '.join(POLICY_NAMES)}; this residual is on "
            f"{policy!r}"
        )
    return residual_base(wrapper, name)


def _hold(env: gym.Env) -> int:
    """Planning periods for which an action is held.

    Raises:
        InvalidValueError: a wrapper changes what the network sees or gives, and is no part of a policy file.
    """
    periods, layer = 1, env
    while isinstance(layer, gym.Wrapper):
        if isinstance(layer, ActionHold):
            periods *= layer.periods
        elif isinstance(layer, gym.ObservationWrapper | gym.ActionWrapper):
            raise InvalidValueError(
                f"the wrapper {type(layer).__name__} changes observations or actions, and a policy file does "
                "not hold it; for running means use VecNormalize"
            )
        layer = layer.env
    return periods


def _check_spaces(model: Any, env: gym.Env) -> None:
    for name in ("observation_space", "action_space"):
        theirs, here = getattr(model, name), getattr(env, name)
        if theirs != here:
            raise InvalidValueError(f"the model was trained with the {name} {theirs}, and {env} has {here}")
    space = model.action_space
    if not (isinstance(space, gym.spaces.Box) and np.all(space.low == -1.0) and np.all(space.high == 1.0)):
        raise InvalidValueError(f"the actions of a policy file are in [-1, 1], those of the model in {space}")


def _check_agreement(
    model: Any, network: Mlp, normalisation: Normalisation, normalise: VecNormalize | None
) -> None:
    """Raise InvalidValueError where the network in numpy gives other actions than the model."""
    draws = np.random.default_rng(0).normal(size=(SAMPLES, network.sizes[0]))
    rows = normalisation.mean + 2.0 * np.sqrt(normalisation.variance) * draws
    theirs, _ = model.predict(
        rows if normalise is None else normalise.normalize_obs(rows), deterministic=True
    )
    ours = np.clip(network.forward(normalisation.apply(rows)), -1.0, 1.0)
    difference = float(np.abs(ours - theirs).max())
    if not difference <= TOLERANCE:
        raise InvalidValueError(
            f"the network in numpy differs from the model by {difference:.2g} in the action: a policy file "
            "does not hold all that this model acts by"
        )


# What only the algorithm of that name has among its settings, the first that fits
ALGORITHMS = {"PPO": "clip_range", "TD3": "target_policy_noise", "SAC": "target_entropy", "A2C": "vf_coef"}
STATISTICS = "vecnormalize.pkl"  # beside the archive, where it was trained on normalised observations


@dataclass(frozen=True)
class ArchivePolicy:
    """Acts as the model of an archive, without exploration; workers load it for themselves.

    `load_policy` makes it act by what the model was trained in, see `model_policy`.

    Args:
        path: of the archive, FILE.zip.
        sha256: of what was read when the policy was named; other content is refused later.
    """

    path: str
    sha256: str

    @classmethod
    def of(cls, path: str) -> ArchivePolicy:
        """The policy of an archive, whose content is not looked at yet.

        Raises:
            InvalidValueError: it can't be read.
        """
        return cls(path, hashlib.sha256(b"".join(_contents(path))).hexdigest())

    def predict(self, observation: Any, deterministic: bool = True) -> tuple[Any, None]:
        """The model's action, in the way of Stable-Baselines3."""
        model, statistics = self.loaded
        seen = observation if statistics is None else statistics.normalize_obs(observation)
        return model.predict(seen, deterministic=deterministic)[0], None

    @cached_property
    def loaded(self) -> tuple[Any, Any]:
        """The model, and the statistics of its observations or None."""
        archive, *statistics = _contents(self.path)
        if hashlib.sha256(b"".join((archive, *statistics))).hexdigest() != self.sha256:
            raise InvalidValueError(f"{self.path!r} has changed since it was named")
        try:
            library = importlib.import_module("stable_baselines3")
        except ImportError as error:
            raise MissingExtraError("stable_baselines3", "train") from error
        name = algorithm_of(self.path, archive)
        try:
            model = getattr(library, name).load(io.BytesIO(archive), device="cpu")
            found = [pickle.loads(content) for content in statistics]  # noqa: S301  # trusted by the user
        except Exception as error:  # of any library that the archive names
            raise InvalidValueError(f"{self.path!r} can't be loaded as {name}: {error}") from error
        for one in found:
            one.training = False
        return model, found[0] if found else None

    def __getstate__(self) -> dict[str, str]:
        """What workers are handed: not the model."""
        return {"path": self.path, "sha256": self.sha256}


def algorithm_of(path: str, archive: bytes) -> str:
    """Name of the algorithm that has saved an archive, from its settings; runs nothing of it.

    Raises:
        InvalidValueError: no archive of Stable-Baselines3, or of another algorithm.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as content:
            settings = json.loads(content.read("data"))
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        raise InvalidValueError(f"{path!r} is no archive of Stable-Baselines3: {error}") from error
    name = next((name for name, key in ALGORITHMS.items() if key in settings), None)
    if name is None:
        raise InvalidValueError(f"{path!r} is of none of the algorithms {', '.join(ALGORITHMS)}")
    return name


def _contents(path: str) -> list[bytes]:
    """The archive, and the statistics beside it where there are any."""
    beside = Path(path).with_name(STATISTICS)
    try:
        return [read_file(place) for place in (Path(path), *([beside] if beside.is_file() else []))]
    except OSError as error:
        raise InvalidValueError(f"can't read the policy {path!r}: {error.strerror or error}") from error
