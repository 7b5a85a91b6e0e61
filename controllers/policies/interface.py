"""What everything that acts has in common."""

from __future__ import annotations

from typing import Any, Protocol

from ..errors import InvalidValueError, shown


class Policy(Protocol):
    """Whatever acts: the signature of Stable-Baselines3's predict."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Actions for one observation or a batch, and the state to hand in next time."""
        ...


def check_policy(policy: object) -> Any:
    """The policy as it is.

    Raises:
        InvalidValueError: It has no method `predict`.
    """
    if not callable(getattr(policy, "predict", None)):
        raise InvalidValueError(f"a policy needs a method predict(observation, ...), got {shown(policy)}")
    return policy
