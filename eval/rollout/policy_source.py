"""Where a policy comes from: a name, a file, MODULE:ATTRIBUTE, or an object in memory."""

import hashlib
import inspect
import os
import pickle
import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym

from ...controllers.errors import InvalidValueError, PushRecoveryError, is_finite_number
from ...controllers.files import read_file
from ...controllers.policies.interface import Policy
from ...controllers.policies.learned import policy_paths
from ...controllers.settings import VARIANTS, read_preset
from ...envs.scenario.scenario import Scenario
from .. import sampling_mpc
from ..output import progress, rows
from .contract_files import contract_name, read_contract
from .environments import make_env, make_env_for
from .load_policy import (
    acting,
    import_attribute,
    is_attribute,
    is_policy_file,
    load_policy,
    source_of,
    training_note,
)


@dataclass(frozen=True)
class PolicySource:
    """A policy of an evaluation, before any environment is known."""

    label: str  # of its rows
    origin: Any  # name of an analytic policy, file, MODULE:ATTRIBUTE, or an object with `predict`

    @property
    def in_memory(self) -> bool:
        """Whether the policy is an object rather than something that can be named."""
        return not isinstance(self.origin, str)

    @property
    def pickles(self) -> bool:
        """Whether worker processes can be handed the policy."""
        return not self.in_memory or _pickled(self.origin) is not None

    def digest(self) -> str | None:
        """SHA-256 of the policy's content; None for a planner by its name, and where nothing can be pickled.

        Of a file: its weights and description. Of MODULE:ATTRIBUTE: the module's source. Of sampling MPC,
        which is not among the code of `code_digest`: its own. Of an object: its pickle and its class's
        source, so that rows of an object that has learned since are never mixed.
        """
        if (contract := contract_name(self.origin)) is not None:
            return read_contract(contract).digest()
        if self.in_memory:
            if (content := _pickled(self.origin)) is None:
                return None
            content += b"\0" + source_of(type(self.origin))
        elif is_policy_file(self.origin):
            content = b"".join(read_file(path) for path in policy_paths(self.origin))
        elif is_attribute(self.origin):
            content = self.origin.encode() + b"\0" + source_of(import_attribute(self.origin)[0])
        elif self.origin == sampling_mpc.NAME:
            content = sampling_mpc.sampling_mpc_source()
        elif self.origin == self.label:
            return None
        else:  # rows of a label don't say which planner it stands for
            content = b"name\0" + self.origin.encode()
        return hashlib.sha256(content).hexdigest()

    @property
    def cost(self) -> float:
        """How long an episode takes, about, as a multiple of the planner's."""
        return sampling_mpc.TIMES_THE_PLANNER if self.origin == sampling_mpc.NAME else 1.0

    def load(self, env: gym.Env) -> Policy:
        """The policy, for an environment."""
        return load_policy(self.origin, env)


Sources = Mapping[str, PolicySource]  # by label


def guessed_seconds(
    env_id: str, missing: Mapping[str, Iterable[Scenario]], sources: Sources, workers: int
) -> float:
    """Wall seconds for scenarios by label, about, where no robot falls."""
    running = sum(
        sources[name].cost * progress.episode_seconds(env_id, scenarios, workers)
        for name, scenarios in missing.items()
    )
    return running + (progress.BEGINNING if running > 0.0 and workers > 1 else 0.0)


def stated_trials(env_id: str) -> Mapping[str, Any]:
    """Trials by planner, as the preset of an environment states them in `found`; nothing if it does not."""
    with suppress(PushRecoveryError), closing(make_env(env_id)) as env:
        preset: str = env.unwrapped.preset  # type: ignore[attr-defined]
        trials = read_preset(preset).found.get("trials")
        if isinstance(trials, dict):
            return trials
    return {}


def _are_names(values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(value, str) for value in values)


def met_words(note: Mapping[str, Any]) -> str:
    """What a training met: kinds of suites, or bodies that were pushed; "" where its note says neither."""
    settings = note.get("settings")
    if not isinstance(settings, Mapping) or not settings:
        return ""
    if _are_names(like := settings.get("like")) and like:
        return ", ".join(dict.fromkeys(like))
    pushes = settings.get("pushes", {})
    bodies = pushes.get("bodies", ["pelvis"]) if isinstance(pushes, Mapping) else []
    bodies = dict.fromkeys(bodies) if _are_names(bodies) else {}
    return " and ".join(bodies) if len(bodies) <= 2 else f"{len(bodies)} bodies"


def search_words(policy: str, trials: Mapping[str, Any]) -> str:
    """How much search or training a policy is the result of; a dash where nothing is known.

    A training without actions is one by imitation; of any other its `met_words` follow.

    Args:
        policy: as rows have it: a name, or a policy file.
        trials: of `stated_trials`.
    """
    with suppress(PushRecoveryError):
        origin = acting(policy)
        if is_policy_file(origin):
            note = training_note(policy_paths(origin)[1])
            actions = note.get("timesteps") if isinstance(note, dict) else None
            if is_finite_number(actions):
                words = f"{actions / 1e6:.1f} M actions" if actions else "imitation"
                return f"{words}, {met}" if actions and (met := met_words(note)) else words
        elif origin in VARIANTS and isinstance(count := trials.get(origin), int):
            return f"{count} trials"
    return "-"


def policy_sources(policies: Any) -> dict[str, PolicySource]:
    """Sources by label of a policy, several, or a mapping of labels to policies.

    Raises:
        InvalidValueError: none is given, a label comes twice or is no name, or one can't act.
    """
    if isinstance(policies, str | os.PathLike) or not isinstance(policies, Iterable):
        policies = [policies]
    pairs: list[tuple[Any, Any]] = []
    for policy in [policies] if isinstance(policies, Mapping) else policies:
        pairs += policy.items() if isinstance(policy, Mapping) else [(_label(policy), policy)]
    found: dict[str, PolicySource] = {}
    for label, policy in pairs:
        if isinstance(policy, PolicySource):
            policy = policy.origin
        if not isinstance(label, str) or not label.isprintable() or not label.strip():
            raise InvalidValueError(f"a policy's label must be a printable name, got {label!r:.200}")
        if label in found:
            raise InvalidValueError(
                f"policy {label!r} is given more than once; tell policies apart by labels of their own: "
                "{'first': policy, 'second': policy}"
            )
        found[label] = PolicySource(label, acting(policy))
    if not found:
        raise InvalidValueError("no policy is given")
    return found


class PolicyEnv(NamedTuple):
    """A policy in an environment that it can act in."""

    env: gym.Env
    policy: Policy
    label: str  # of its outcomes


@contextmanager
def acting_in(
    env: gym.Env | str, policy: Any, label: str | None = None, **arguments: Any
) -> Iterator[PolicyEnv]:
    """A policy in an environment; one that is named by its id is made here and closed at the end.

    Raises:
        PushRecoveryError: unknown names, a policy that can't act.
    """
    ((name, source),) = policy_sources(policy if label is None else {label: policy}).items()
    made = make_env_for(source.origin, env, **arguments) if isinstance(env, str) else env
    try:
        yield PolicyEnv(made, source.load(made), name)
    finally:
        if made is not env:
            made.close()


def open_rows(
    label: str,
    config: dict[str, Any],
    sources: Sources,
    key: tuple[str, ...],
    fields: tuple[str, ...],
    directory: Path | None,
    overwrite: bool,
) -> tuple[rows.RowFile, dict[str, str | None]]:
    """The row file of a run of policies, and the digest of each; see `RowFile`.

    The label names the directory under runs/ where none is given.

    Raises:
        InvalidValueError: rows of another configuration, or of another content of a policy, or another run
            is writing there.
    """
    digests = {name: source.digest() for name, source in sources.items()}
    # An object without a digest gets a default directory that no other run has.
    objects = {name: digests[name] or secrets.token_hex(8) for name in sources if sources[name].in_memory}
    directory = directory or rows.default_directory(label, config | ({"objects": objects} if objects else {}))
    store = rows.RowFile(directory, config, key, overwrite, fields)
    try:
        store.check_policies(digests)
        for row in store.rows.values():
            name = row["policy"]
            if name in objects and digests[name] is None:
                raise InvalidValueError(
                    f"{str(store.path)!r} holds rows of policy {name!r}, an object that does not pickle, so "
                    "that nothing says whether it is the same: choose another directory, or overwrite"
                )
    except BaseException:
        store.close()
        raise
    return store, digests


def keep_rows(
    store: rows.RowFile,
    found: Iterable[dict[str, Any]],
    digests: Mapping[str, str | None],
    bars: progress.Bars,
    done: dict[str, int],
    note: Callable[[dict[str, Any]], str] = lambda row: "",
) -> None:
    """Write rows into a row file of `open_rows` as they are found, and show how far it is.

    Args:
        store: the row file.
        found: rows with their `policy`.
        digests: of the policies.
        bars: of the policies.
        done: rows so far by policy, counted on.
        note: what a row says, for its bar.
    """
    for row in found:
        name = row["policy"]
        store.append({**row, "policy_sha256": digests[name]})
        done[name] += 1
        bars.set(name, done[name], note(row))


def _label(policy: Any) -> str:
    if isinstance(policy, PolicySource):
        return policy.label
    if isinstance(policy, str | os.PathLike):
        return os.fspath(policy)
    return policy.__name__ if inspect.isclass(policy) or inspect.isfunction(policy) else type(policy).__name__


def _pickled(policy: Any) -> bytes | None:
    try:
        return pickle.dumps(policy)
    except Exception:  # a class decides for itself what it raises
        return None
