"""The interface of everything that acts, and how a policy that knows less of it is called."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, Protocol

from ..errors import InvalidValueError, shown

OPTIONAL = ("state", "episode_start", "deterministic")  # of `predict`, beside the observation


class Policy(Protocol):
    """Whatever acts: the signature of Stable-Baselines3's predict.

    Two class attributes are optional, see `declares`. `batchable`: `predict` takes n observations as well as
    one, each row of its actions and of its state (a tuple of arrays) hangs on that robot alone, and it needs
    no `reset` and no `begin_scenario`; such a policy acts for many robots at once. `memoryless`: it has no
    state.
    """

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Actions for one observation or a batch, and the state to hand in next time."""
        ...


def declares(policy: object, name: str) -> bool:
    """Whether the class of a policy says by a true attribute of its own that a property holds.

    It is not inherited: a subclass may act in another way, and has to say so itself.
    """
    return name in vars(type(policy)) and bool(getattr(policy, name))


def action_and_state(found: Any) -> tuple[Any, Any]:
    """What `predict` gave: (action, state) where it is a tuple of two, else an action alone."""
    return found if isinstance(found, tuple) and len(found) == 2 else (found, None)


class PlainPolicy:
    """A policy whose `predict` takes less than Stable-Baselines3's, or whose `reset` takes no seed.

    Args:
        policy: anything with a method predict(observation).

    Raises:
        InvalidValueError: it has none.
    """

    def __init__(self, policy: Any):
        self.policy = policy
        self._predict = _method(policy)
        self._taken = _taken(self._predict, OPTIONAL)
        reset = getattr(policy, "reset", None)
        self._reset = reset if callable(reset) else None
        self._seeded = self._reset is not None and bool(_taken(self._reset, ("seed",)))
        if callable(begin := getattr(policy, "begin_scenario", None)):
            self.begin_scenario: Callable[[Any], object] = begin

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """The policy's action and state; it is handed what its signature takes."""
        known = {"state": state, "episode_start": episode_start, "deterministic": deterministic}
        return action_and_state(self._predict(observation, **{name: known[name] for name in self._taken}))

    def reset(self, seed: int | None = None) -> None:
        """Begin an episode, where the policy has such a method; the seed only where it takes one."""
        if self._reset is not None:
            self._reset(**({"seed": seed} if self._seeded else {}))

    @property
    def batchable(self) -> bool:
        """Whether the policy says that it is."""
        return declares(self.policy, "batchable")

    @property
    def config(self) -> Any:
        """The policy's PlannerConfig, whose touchdown delay a residual's gate takes; None for one without."""
        return getattr(self.policy, "config", None)

    @property
    def statuses(self) -> Any:
        """Statuses of stage 2's solver, see `TwoStagePolicy.statuses`; empty for a policy without one."""
        return getattr(self.policy, "statuses", ())


def as_policy(policy: Any) -> Policy:
    """The policy itself where it has the whole signature, else a `PlainPolicy` around it.

    Raises:
        InvalidValueError: it has no method `predict`.
    """
    whole = _taken(_method(policy), OPTIONAL) == OPTIONAL
    reset = getattr(policy, "reset", None)
    if whole and (not callable(reset) or _taken(reset, ("seed",))):
        return policy
    return PlainPolicy(policy)


def _method(policy: Any) -> Callable[..., Any]:
    predict = getattr(policy, "predict", None)
    if not callable(predict) or isinstance(policy, type):
        raise InvalidValueError(f"a policy needs a method predict(observation, ...), got {shown(policy)}")
    return predict


def _taken(function: Callable[..., Any], names: tuple[str, ...]) -> tuple[str, ...]:
    """Names, of those given, that a function takes as keywords."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # some functions written in C have no signature
        return ()
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return names
    positional = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.VAR_POSITIONAL
    given = {parameter.name for parameter in parameters if parameter.kind not in positional}
    return tuple(name for name in names if name in given)
