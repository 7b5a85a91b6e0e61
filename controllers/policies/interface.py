"""What everything that acts has in common."""

from __future__ import annotations

from typing import Any, Protocol


class Policy(Protocol):
    """Whatever acts: the signature of Stable-Baselines3's predict."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Actions for one observation or a batch, and the state to hand in next time."""
        ...
