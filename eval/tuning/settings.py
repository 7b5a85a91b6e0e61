"""`TuningSettings`: all that a study is, besides its number of trials."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.validation import require_choice, require_integer
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ..score.tuning_pushes import MOST, TUNING, TUNING_SUITES, VARIED
from .dimensions import planner_dimensions
from .scorer import PENDULUM, check_env, own_episodes

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
    suite: str = ""  # one of TUNING_SUITES; by default pushes of every kind where the robot takes them
    scenarios: int = 256  # of it
    held_out: int = 256  # of the one held out
    errors: ModelErrors = EXACT_MODEL  # of every second robot, see `tuning_suite`

    def __post_init__(self) -> None:
        object.__setattr__(self, "env_id", check_env(self.env_id))
        planner_dimensions(self.policy)  # knows the arms that can be tuned
        if self.space not in SPACES:
            raise UnknownNameError("space to tune", self.space, SPACES)
        if self.space != "planner" and self.env_id == PENDULUM:
            raise InvalidValueError(
                f"space {self.space!r} is that of robots; {PENDULUM} has the space 'planner' only"
            )
        require_integer("seed", self.seed)
        for name in ("scenarios", "held_out"):
            if not LEAST <= require_integer(name, getattr(self, name)) <= MOST:
                raise InvalidValueError(f"{name} must be in [{LEAST}, {MOST}], got {getattr(self, name)}")
        if not self.preset:
            object.__setattr__(self, "preset", own_episodes(self.env_id).preset)
        self._check_suite()

    def _check_suite(self) -> None:
        if not self.suite:
            plain = self.env_id == PENDULUM or self.errors != EXACT_MODEL
            object.__setattr__(self, "suite", TUNING if plain else VARIED)
        require_choice("tuning suite", self.suite, list(TUNING_SUITES))
        if self.suite != TUNING and self.env_id == PENDULUM:
            raise InvalidValueError(
                f"suite {self.suite!r} is that of robots; {PENDULUM} takes {TUNING!r} only"
            )
        if self.suite == VARIED and self.errors != EXACT_MODEL:
            raise InvalidValueError(
                f"every second robot of suite {VARIED!r} has the errors of the profile hardware already, "
                f"got {self.errors.to_dict()}: leave them out, or take suite {TUNING!r}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {**asdict(self), "only": list(self.only), "errors": self.errors.to_dict()}
