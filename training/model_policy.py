"""Models of Stable-Baselines3 as they are, in memory or in an archive, by what they were trained in.

Whoever loads an archive runs the code in it.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import io
import json
import pickle
import zipfile
from abc import ABC
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import wrappers
from numpy.typing import NDArray
from stable_baselines3.common import monitor, vec_env

from ..controllers.errors import InvalidValueError, MissingExtraError, PushRecoveryError
from ..controllers.files import read_file
from ..controllers.policies.interface import Policy, as_policy
from ..controllers.policies.learned import LearnedPolicy, PolicyDescription, read_residual
from ..controllers.policies.residual import Below
from ..controllers.validation import differences
from ..envs.episode.gym_env import HOLD, RESIDUAL, Meaning, noted
from ..envs.episode.vector_env import GaitVectorEnv
from ..envs.wrappers import ActionHold, ResidualAction
from ..eval.rollout.environments import make_env
from .builders import layers_of
from .settings import env_of_kind

# Settings that the algorithm of a name alone has, the first that fits
SETTING_OF = {"PPO": "clip_range", "TD3": "target_policy_noise", "SAC": "target_entropy", "A2C": "vf_coef"}
STATISTICS = "vecnormalize.pkl"  # beside the archive, where it was trained on normalised observations
# What hands on observations and actions as they are, or what a note or the statistics tell of
HARMLESS = (
    gym.Wrapper, gym.RewardWrapper, gym.vector.VectorWrapper, gym.vector.VectorRewardWrapper,
    wrappers.OrderEnforcing, wrappers.PassiveEnvChecker, wrappers.TimeLimit, wrappers.NormalizeReward,
    wrappers.RecordEpisodeStatistics, wrappers.RecordVideo, wrappers.RenderCollection,
    wrappers.HumanRendering, wrappers.vector.RecordEpisodeStatistics, wrappers.vector.NormalizeReward,
    monitor.Monitor, ActionHold, ResidualAction,
    vec_env.VecMonitor, vec_env.VecNormalize, vec_env.VecCheckNan, vec_env.VecVideoRecorder,
)  # fmt: skip
ACTING = (  # methods by which a wrapper changes observations or actions
    "reset", "step", "step_async", "step_wait", "observation", "observations", "action", "actions",
    "normalize_obs",
)  # fmt: skip
PLAIN = (bool, int, float, complex, str, tuple, list, np.ndarray, np.generic)  # compared by value
HIDDEN = "what can't be looked at"


class Changing(ABC):  # noqa: B024  # asked about classes, of which none inherits
    """Any wrapper that may change observations or actions: all but `HARMLESS` ones and what acts as they do.

    `isinstance` says so, also in the worker processes of a vector environment, by its `env_is_wrapped`.
    """

    @classmethod
    def __subclasshook__(cls, kind: type) -> bool:
        """Whether a class of wrappers acts in a way of its own."""
        return not any(
            issubclass(kind, known)
            and all(getattr(kind, name, None) is getattr(known, name, None) for name in ACTING)
            for known in HARMLESS
        )


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
    within: tuple[str, ...] = ()  # vector wrappers that change observations or actions
    changed_by: tuple[tuple[str, ...], ...] = ((),)  # such wrappers of each of its environments
    has_env: bool = False  # whether it has the environments of its training still
    path: str = ""  # of its archive
    env_id: str = ""  # where it has environments that say theirs


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
    trained = _of_archive(model) if isinstance(model, ArchivePolicy) else in_memory(model)
    check_wrappers(trained, env)
    _check_shapes(trained, env)
    check_normalisation(trained)
    theirs, here = _meanings(trained, env)
    residual, hold = _correction(trained, theirs, here, env)
    if residual is None and hold == 1 and trained.statistics is None:
        return as_policy(trained.model)
    if hasattr(getattr(trained.model, "policy", trained.model), "lstm_actor"):
        raise InvalidValueError(
            f"{trained.name} remembers (it is recurrent), so that its actions can't be held, corrected or "
            f"normalised for {id_of(env)}: score it in {words(theirs, trained.env_id)} by "
            "push_recovery.rollout(model, scenario, env)"
        )
    unwrapped: Any = env.unwrapped
    base = None if residual is None else read_residual(residual)
    about = PolicyDescription(id_of(env), unwrapped.robot, unwrapped.limits, base, hold)
    return ModelPolicy(trained, about)


def in_memory(model: Any) -> Trained:
    """All that is known of a model, which its network alone (its `policy`) would not say.

    Raises:
        InvalidValueError: it is no model, or was trained on observations that were normalised twice.
    """
    name = f"the model {type(model).__name__}"
    if not hasattr(model, "get_env"):
        raise InvalidValueError(
            f"{name} is the network of a model alone, which does not say what it was trained in: hand over "
            "the model itself, not its policy"
        )
    venv = model.get_env()
    if venv is None:
        return Trained(name, model, model.observation_space, model.action_space)
    seen, action, statistics, within = venv.observation_space, venv.action_space, normaliser(venv), []
    while isinstance(venv, vec_env.VecEnvWrapper):
        within += [type(venv).__name__] * isinstance(venv, Changing)
        venv = venv.venv
    env = (getattr(venv, "envs", None) or [getattr(venv, "env", None)])[0]
    env_id = getattr(getattr(env, "spec", None), "id", "")
    known = statistics, tuple(within), _changing_each(venv)
    return Trained(name, model, seen, action, *known, has_env=True, env_id=env_id)


def normaliser(venv: vec_env.VecEnv | None) -> vec_env.VecNormalize | None:
    """The one layer of a vector environment that normalises observations, or None.

    Raises:
        InvalidValueError: there are several.
    """
    found = []
    while isinstance(venv, vec_env.VecEnvWrapper):
        found += [venv] * (isinstance(venv, vec_env.VecNormalize) and venv.norm_obs)
        venv = vars(venv).get("venv")  # which pickled statistics lack
    if len(found) > 1:
        raise InvalidValueError(
            f"{len(found)} layers of VecNormalize normalise the observations one after the other, and a "
            "policy takes one along: train with norm_obs=False in all others"
        )
    return found[0] if found else None


def _changing_each(venv: Any) -> tuple[tuple[str, ...], ...]:
    """Of each environment of a vector environment, the wrappers that change what is seen or done."""
    if hasattr(venv, "envs"):
        return tuple(tuple(changing(env)) for env in venv.envs)
    shared = getattr(getattr(venv, "env", None), "unwrapped", None)  # a vector environment of Gymnasium
    hidden = isinstance(shared, gym.vector.VectorEnv) and not isinstance(shared, GaitVectorEnv)
    try:
        hidden = (hidden and not hasattr(shared, "envs")) or any(venv.env_is_wrapped(Changing))
    except (NotImplementedError, OSError, EOFError):  # it can't say, or its workers have ended
        hidden = True
    return ((HIDDEN,),) if hidden else ((),)


def _of_archive(archive: ArchivePolicy) -> Trained:
    """All that an archive and the statistics beside it say."""
    model, statistics = archive.loaded
    name = f"the archive {archive.path!r}"
    found = None if statistics is None or not statistics.norm_obs else statistics
    return Trained(name, model, model.observation_space, model.action_space, found, path=archive.path)


def changing(env: gym.Env) -> Iterator[str]:
    """Wrappers that change what is seen or done, from the outermost on, each with what it was made with."""
    for layer in layers_of(env):
        if isinstance(layer, Changing):
            statistics = getattr(layer, "obs_rms", None)
            known = {} if statistics is None else {"mean": statistics.mean, "variance": statistics.var}
            made = {
                name: value.tolist() if isinstance(value, np.ndarray) else value
                for name, value in {**_made_with(layer), **known}.items()
            }
            yield f"{type(layer).__name__}({made})"


def _made_with(layer: gym.Wrapper) -> dict[str, Any]:
    """What a wrapper says that it was made with, or what it keeps of it under the same names."""
    asked, kept = inspect.signature(type(layer).__init__).parameters, vars(layer)
    found = {name: kept[name] for name in asked if isinstance(kept.get(name), PLAIN)}
    return getattr(layer, "_saved_kwargs", found)


def _check_shapes(trained: Trained, env: gym.Env) -> None:
    pairs = (trained.seen, env.observation_space), (trained.action, env.action_space)
    if all(isinstance(mine, gym.spaces.Box) and mine.shape == here.shape for mine, here in pairs):
        return
    raise InvalidValueError(
        f"{trained.name} takes observations {_shape(trained.seen)} and gives actions "
        f"{_shape(trained.action)}, and {id_of(env)} has {_shape(env.observation_space)} and "
        f"{_shape(env.action_space)}: {_way(trained)}"
    )


def check_wrappers(trained: Trained, env: gym.Env) -> None:
    """Raise InvalidValueError where a model was trained within other wrappers than those of `env`."""
    if not trained.has_env:
        return
    here, each = tuple(changing(env)), trained.changed_by
    theirs, ours = _names(each[0]), _names(here)
    may = "which may change observations or actions"
    if trained.within:
        raise InvalidValueError(
            f"{trained.name} was trained within {', '.join(trained.within)} around all its environments, "
            f"{may}, and one environment has no such wrapper: nothing scores it here, train it with a "
            "wrapper of each environment instead"
        )
    if HIDDEN in theirs:
        raise InvalidValueError(
            f"{trained.name} was trained in a vector environment with wrappers that can't be looked at from "
            f"here, {may}: load it with one environment like those of its training, PPO.load(FILE, env=env), "
            "and score it by push_recovery.rollout(model, scenario, env)"
        )
    if any(_names(one) != theirs for one in each):
        raise InvalidValueError(
            f"{trained.name} was trained in environments within unlike wrappers, {may}: load it with the one "
            "that it is to be scored in, PPO.load(FILE, env=env), and score it by "
            "push_recovery.rollout(model, scenario, env)"
        )
    if here in each:
        return
    found = f"{', '.join(ours) or 'none'} of these wrappers"
    found = "the same with other settings" if theirs == ours else found
    raise InvalidValueError(
        f"{trained.name} was trained within {', '.join(theirs) or 'no wrapper'}, {may}, and "
        f"{id_of(env)} has {found}: score it by push_recovery.rollout(model, scenario, env), env wrapped "
        "like that of its training; of running means only those of VecNormalize are taken along, and what "
        "changes rewards alone is to be a gymnasium.RewardWrapper"
    )


def _names(written: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(made.partition("(")[0] for made in written)


def check_normalisation(trained: Trained, remedy: str = "") -> None:
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
        beside = f"{STATISTICS} beside it is another model's: move one of them"
        raise InvalidValueError(
            f"{trained.name} was trained on observations as they are, so that "
            f"{beside if trained.path else 'these statistics are of another model: leave them out'}"
        )
    beside = f"put {STATISTICS} (of VecNormalize.save) beside it, or " if trained.path else remedy
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
            f"{id_of(env)} and one whose actions correct a planner are alike: load it with that of its "
            'training, PPO.load(FILE, env=gym.make("push_recovery:PushRecovery/BipedResidual-v0", hold=2)), '
            "or make it a policy file, push_recovery.training.from_sb3.from_sb3(model, env).save(NAME)"
        )
    return theirs or {}, here or {}


def _correction(trained: Trained, theirs: Meaning, here: Meaning, env: gym.Env) -> tuple[Meaning | None, int]:
    """The residual and the hold that an environment lacks of what a model was trained in, and no more."""
    lacks = lacking(theirs, here)
    if isinstance(lacks, tuple):
        return lacks
    raise InvalidValueError(
        f"{trained.name} was trained in {words(theirs, trained.env_id)}, and {id_of(env)} is "
        f"{words(here, id_of(env))}: {lacks}; {_way(trained, theirs)}"
    )


def lacking(theirs: Meaning, here: Meaning) -> tuple[Meaning | None, int] | str:
    """The residual and the hold that one meaning has and another lacks, or why they differ in more."""
    held, residual = theirs.get(HOLD, 1), theirs.get(RESIDUAL)
    held_here, residual_here = here.get(HOLD, 1), here.get(RESIDUAL)
    mine, other = (
        {key: value for key, value in one.items() if key not in {HOLD, RESIDUAL}} for one in (theirs, here)
    )
    if mine != other:
        return unlike(mine, other) if mine else "nothing says what stands below its hold"
    if residual == residual_here and held % held_here == 0:
        return None, held // held_here
    if residual is None or residual_here is not None or held_here > 1:
        return f"actions mean different things there ({unlike(theirs, here)})"
    return "what its actions correct has no name" if residual["policy"] is None else (residual, held)


def unlike(theirs: Meaning, here: Meaning) -> str:
    """Where two meanings differ, in words; what only one of them has is "none" in the other."""
    both: tuple[Meaning, Meaning] = {}, {}

    def compare(one: Meaning, other: Meaning) -> None:
        for key in one | other:
            pair = one.get(key), other.get(key)
            if pair[0] != pair[1] and all(isinstance(value, dict) for value in pair):
                compare(*pair)  # type: ignore[arg-type]
            elif pair[0] != pair[1]:
                for values, value in zip(both, pair, strict=True):
                    values[key] = _brief(value)

    compare({HOLD: 1} | theirs, {HOLD: 1} | here)
    return differences(*both) or "numbers differ in their last digits"


def _brief(value: Any) -> Any:
    """A value of a meaning, in the words of errors."""
    if isinstance(value, dict):
        if "policy" in value:
            return value["policy"] or "a policy"
        return ", ".join(f"{key} {_brief(inner)}" for key, inner in value.items())
    return "none" if value is None else value


def _way(trained: Trained, theirs: Meaning | None = None) -> str:
    """The calls that score a model in what it was trained in; an id is named where it is found to do so."""
    theirs = theirs or noted(trained.action) or {}
    named = trained.env_id or theirs.get("environment", "")
    for env_id in dict.fromkeys((named, env_of_kind("residual", named))) if theirs and named else ():
        try:
            env = make_env(env_id)
        except (PushRecoveryError, TypeError):
            continue
        here = noted(env.action_space) or {}
        if env.observation_space.shape == trained.seen.shape and isinstance(lacking(theirs, here), tuple):
            return f'score it by evaluate(..., env="{env_id}") or push_recovery.rollout(model, scenario, env)'
    return "score it by push_recovery.rollout(model, scenario, env), env made like that of its training"


def words(meaning: Meaning, env_id: str = "") -> str:
    """A meaning in the words of errors; a note has no id, but the kind of its robots."""
    residual, kind = meaning.get(RESIDUAL), meaning.get("environment")
    said = "an environment of others" if kind is None else f"an environment of the kind of {kind}"
    if env_id:
        said = env_id if residual is None else env_of_kind("residual", env_id)
    if residual is not None:
        gate = "no gate" if residual["gate"] is None else f"gate {residual['gate']}"
        said += f" with corrections of {residual['policy'] or 'a policy'} ({gate})"
    return f"{said} (hold {meaning.get(HOLD, 1)})"


def _shape(space: gym.Space[Any]) -> str:
    return str(space.shape) if isinstance(space, gym.spaces.Box) else str(space)


def id_of(env: gym.Env) -> str:
    """The id of an environment, or the class of one without."""
    return env.spec.id if env.spec is not None else type(env.unwrapped).__name__
