"""Models of Stable-Baselines3 as they are, in memory or in an archive, by what they were trained in.

Whoever loads an archive runs the code in it.
"""

from __future__ import annotations

import hashlib
import importlib
import io
import json
import pickle
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common import vec_env

from ..controllers.errors import InvalidValueError, MissingExtraError
from ..controllers.files import read_file
from ..controllers.policies.interface import Policy, as_policy
from ..controllers.policies.learned import LearnedPolicy, PolicyDescription, read_residual
from ..controllers.policies.residual import Below
from ..controllers.validation import differences
from ..envs.episode.gym_env import HOLD, RESIDUAL, Meaning, noted
from .builders import layers_of

# Settings that the algorithm of a name alone has, the first that fits
SETTING_OF = {"PPO": "clip_range", "TD3": "target_policy_noise", "SAC": "target_entropy", "A2C": "vf_coef"}
STATISTICS = "vecnormalize.pkl"  # beside the archive, where it was trained on normalised observations
HARMLESS = (  # normalisation is taken along
    vec_env.VecMonitor, vec_env.VecNormalize, vec_env.VecCheckNan, vec_env.VecVideoRecorder
)  # fmt: skip
# Beside `ObservationWrapper` and `ActionWrapper`, by name: what steps or stacks more than it is told to
CHANGING = {"MaxAndSkipEnv", "MaxAndSkipObservation", "FrameStackObservation", "StickyActionEnv"}


@dataclass(frozen=True)
class ArchivePolicy:
    """A policy that acts as the model of an archive, without exploration; workers load it for themselves.

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
        """The state for workers: not the model."""
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
    name = next((name for name, key in SETTING_OF.items() if key in settings), None)
    if name is None:
        raise InvalidValueError(f"{path!r} is of none of the algorithms {', '.join(SETTING_OF)}")
    return name


def _contents(path: str) -> list[bytes]:
    """The archive, and the statistics beside it where there are any."""
    beside = Path(path).with_name(STATISTICS)
    try:
        return [read_file(place) for place in (Path(path), *([beside] if beside.is_file() else []))]
    except OSError as error:
        raise InvalidValueError(f"can't read the policy {path!r}: {error.strerror or error}") from error


class Trained(NamedTuple):
    """All that is known of the environment that a model was trained in."""

    name: str  # of the model, for errors
    model: Any
    seen: gym.Space[Any]  # its observations
    action: gym.Space[Any]
    statistics: Any = None  # of its observations: a VecNormalize
    changed_by: tuple[str, ...] = ()  # wrappers that change observations or actions in a way of their own
    has_env: bool = False  # whether it has the environments of its training still
    path: str = ""  # of its archive


class ModelPolicy(LearnedPolicy):
    """A model's own actions, its observations normalised as in training, held, and added to the planner's."""

    def __init__(self, trained: Trained, description: PolicyDescription):
        self._model, self._statistics = trained.model, trained.statistics
        self.observation_size, self.action_size = *trained.seen.shape, *trained.action.shape  # type: ignore[misc]
        super().__init__(description)

    def _learned(self, rows: NDArray[np.float64], below: Below | None) -> NDArray[np.float32]:
        seen = rows if self._statistics is None else self._statistics.normalize_obs(rows)
        action, _ = self._model.predict(seen, deterministic=True)
        return np.clip(action, np.float32(-1), np.float32(1))


def model_policy(model: Any, env: gym.Env) -> Policy:
    """A model as a policy that does in `env` what it does in the environment of its training.

    Args:
        model: of Stable-Baselines3, or an `ArchivePolicy`.
        env: that it is to act in: like that of the training, or the one below its residual and hold.

    Raises:
        InvalidValueError: the two differ in more, or nothing says what the model was trained in.
    """
    trained = _of_archive(model) if isinstance(model, ArchivePolicy) else _in_memory(model)
    _check_shapes(trained, env)
    _check_wrappers(trained, env)
    _check_normalisation(trained)
    theirs, here = _meanings(trained, env)
    residual, hold = _correction(trained, theirs, here, env)
    if residual is None and hold == 1 and trained.statistics is None:
        return as_policy(trained.model)
    if hasattr(getattr(trained.model, "policy", trained.model), "lstm_actor"):
        raise InvalidValueError(
            f"{trained.name} remembers (it is recurrent), so that its actions can't be held, corrected or "
            f"normalised for {_id_of(env)}: score it in {_words(theirs)} by "
            "push_recovery.rollout(model, scenario, env)"
        )
    unwrapped: Any = env.unwrapped
    base = None if residual is None else read_residual(residual)
    about = PolicyDescription(_id_of(env), unwrapped.robot, unwrapped.limits, base, hold)
    return ModelPolicy(trained, about)


def _in_memory(model: Any) -> Trained:
    """All that is known of a model, which its network alone (its `policy`) would not say."""
    name = f"the model {type(model).__name__}"
    if not hasattr(model, "get_env"):
        raise InvalidValueError(
            f"{name} is the network of a model alone, which does not say what it was trained in: hand over "
            "the model itself, not its policy"
        )
    venv = model.get_env()
    if venv is None:
        return Trained(name, model, model.observation_space, model.action_space)
    statistics, changed_by, seen, action = None, [], venv.observation_space, venv.action_space
    while isinstance(venv, vec_env.VecEnvWrapper):
        if isinstance(venv, vec_env.VecNormalize):
            statistics = venv if venv.norm_obs else None
        elif not isinstance(venv, HARMLESS):
            changed_by.append(type(venv).__name__)
        venv = venv.venv
    changed_by += [name for env in list(getattr(venv, "envs", ()))[:1] for name in _changing(env)]
    return Trained(name, model, seen, action, statistics, tuple(changed_by), has_env=True)


def _of_archive(archive: ArchivePolicy) -> Trained:
    """All that an archive and the statistics beside it say."""
    model, statistics = archive.loaded
    name = f"the archive {archive.path!r}"
    found = None if statistics is None or not statistics.norm_obs else statistics
    return Trained(name, model, model.observation_space, model.action_space, found, path=archive.path)


def _changing(env: gym.Env) -> Iterator[str]:
    """Wrappers that change what is seen or done, from the outermost on, each with what it was made with."""
    for layer in layers_of(env):
        if isinstance(layer, gym.ObservationWrapper | gym.ActionWrapper) or type(layer).__name__ in CHANGING:
            settings = getattr(layer, "_saved_kwargs", {})
            statistics = getattr(layer, "obs_rms", None)
            known = {} if statistics is None else {"mean": statistics.mean, "variance": statistics.var}
            written = ", ".join(f"{key}={value}" for key, value in {**settings, **known}.items())
            yield f"{type(layer).__name__}({written})"


def _check_shapes(trained: Trained, env: gym.Env) -> None:
    pairs = (trained.seen, env.observation_space), (trained.action, env.action_space)
    if all(isinstance(mine, gym.spaces.Box) and mine.shape == here.shape for mine, here in pairs):
        return
    raise InvalidValueError(
        f"{trained.name} takes observations {_shape(trained.seen)} and gives actions "
        f"{_shape(trained.action)}, and {_id_of(env)} has {_shape(env.observation_space)} and "
        f"{_shape(env.action_space)}: score it in the environment of its training, evaluate(..., env=ID)"
    )


def _check_wrappers(trained: Trained, env: gym.Env) -> None:
    here = tuple(_changing(env))
    if not trained.has_env or trained.changed_by == here:
        return
    theirs, ours = (
        ", ".join(made.partition("(")[0] for made in each) or "none" for each in (trained.changed_by, here)
    )
    raise InvalidValueError(
        f"{trained.name} was trained within {theirs}, which changes observations or actions, and "
        f"{_id_of(env)} has {ours} of these wrappers: score it by push_recovery.rollout(model, "
        "scenario, env), env wrapped like that of its training; of running means only those of VecNormalize "
        "are taken along"
    )


def _check_normalisation(trained: Trained) -> None:
    """Raise InvalidValueError where a model without its environment lacks its statistics, or has another's.

    Observations of this project are doubles, and normalised ones single; a model keeps its last one.
    """
    last = getattr(trained.model, "_last_obs", None)
    if trained.has_env or last is None or trained.seen.dtype != np.float64:
        return
    normalised = last.dtype == np.float32
    if normalised == (trained.statistics is not None):
        return
    if not normalised:
        raise InvalidValueError(
            f"{trained.name} was trained on observations as they are, so that {STATISTICS} beside it is "
            "another model's: move one of them"
        )
    beside = f"put {STATISTICS} (of VecNormalize.save) beside it, or " if trained.path else ""
    raise InvalidValueError(
        f"{trained.name} was trained on observations that VecNormalize normalised, and their statistics are "
        f"not here: {beside}load it with them, PPO.load(FILE, env=VecNormalize.load(STATISTICS, venv))"
    )


def _meanings(trained: Trained, env: gym.Env) -> tuple[Meaning, Meaning]:
    """Meaning of actions in the training, and here."""
    theirs, here = noted(trained.action), noted(env.action_space)
    if noted(trained.seen) is None and noted(env.observation_space) is not None:  # it was made anew
        theirs = None
    if theirs is None and here is not None:
        raise InvalidValueError(
            f"{trained.name} does not say what environment it was trained in, and to its spaces "
            f"{_id_of(env)} and one whose actions correct a planner are alike: load it with that of its "
            'training, PPO.load(FILE, env=gym.make("push_recovery:PushRecovery/BipedResidual-v0", hold=2)), '
            "or make it a policy file, push_recovery.training.from_sb3.from_sb3(model, env).save(NAME)"
        )
    return theirs or {}, here or {}


def _correction(trained: Trained, theirs: Meaning, here: Meaning, env: gym.Env) -> tuple[Meaning | None, int]:
    """The residual and the hold that an environment lacks of what a model was trained in, and no more."""
    held, residual = theirs.get(HOLD, 1), theirs.get(RESIDUAL)
    held_here, residual_here = here.get(HOLD, 1), here.get(RESIDUAL)
    mine, other = (
        {key: value for key, value in one.items() if key not in {HOLD, RESIDUAL}} for one in (theirs, here)
    )
    if mine != other:
        flat = ({**one, **one.get("robot", {}), **one.get("limits", {})} for one in (mine, other))
        why = differences(*({k: v for k, v in one.items() if not isinstance(v, dict)} for one in flat))
    elif residual == residual_here and held % held_here == 0:
        return None, held // held_here
    elif residual is None or residual_here is not None or held_here > 1:
        why = "actions mean different things there"
    elif residual["policy"] is None:
        why = "what its actions correct has no name"
    else:
        return residual, held
    raise InvalidValueError(
        f"{trained.name} was trained in {_words(theirs)}, and {_id_of(env)} is {_words(here)}: "
        f"{why}; score it in its own, by evaluate(..., env=ID) or push_recovery.rollout(model, scenario, env)"
    )


def _words(meaning: Meaning) -> str:
    """A meaning in the words of errors."""
    words, residual = str(meaning.get("environment", "an environment of others")), meaning.get(RESIDUAL)
    if residual is not None:
        gate = "no gate" if residual["gate"] is None else f"gate {residual['gate']}"
        words += f" with corrections of {residual['policy'] or 'a policy'} ({gate})"
    return f"{words} (hold {meaning.get(HOLD, 1)})"


def _shape(space: gym.Space[Any]) -> str:
    return str(space.shape) if isinstance(space, gym.spaces.Box) else str(space)


def _id_of(env: gym.Env) -> str:
    return env.spec.id if env.spec is not None else type(env.unwrapped).__name__
