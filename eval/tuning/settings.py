"""`TuningSettings`: all that a study is, besides its number of trials."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.validation import require_integer
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from .dimensions import planner_dimensions
from .scorer import BIPED, check_env
from .suite import MOST

SPACES = ("planner", "robot", "both")
LEAST = 8  # scenarios


@dataclass(frozen=True)
class TuningSettings:
    """What is tuned, from where, on how many pushes.

    Raises:
        UnknownNameError: an environment, a policy or a space that cannot be tuned.
        InvalidValueError: a space of another robot, or an impossible number.
    """

    env_id: str
    policy: str
    space: str = "planner"  # one of SPACES
    only: tuple[str, ...] = ()  # groups or fields of it; none: all of it
    preset: str = ""  # to start from, by name or file; the environment's own by default
    seed: int = 0
    scenarios: int = 256  # of the tuning suite, and as many of the one held out
    errors: ModelErrors = EXACT_MODEL  # of every second robot, see `tuning_suite`

    def __post_init__(self) -> None:
        object.__setattr__(self, "env_id", check_env(self.env_id))
        planner_dimensions(self.policy)  # knows the arms that can be tuned
        if self.space not in SPACES:
            raise UnknownNameError("space to tune", self.space, SPACES)
        if self.space != "planner" and self.env_id != BIPED:
            raise InvalidValueError(
                f"space {self.space!r} is that of {BIPED}; {self.env_id} has the space 'planner' only"
            )
        require_integer("seed", self.seed)
        if not LEAST <= require_integer("scenarios", self.scenarios) <= MOST:
            raise InvalidValueError(f"scenarios must be in [{LEAST}, {MOST}], got {self.scenarios}")
        if not self.preset:
            object.__setattr__(self, "preset", "biped" if self.env_id == BIPED else "default")

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {**asdict(self), "only": list(self.only), "errors": self.errors.to_dict()}
