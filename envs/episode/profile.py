"""Profiles: how real the simulated robot is, as one name for model errors, physics and sensing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from ...controllers.json_text import changed_fields
from ...controllers.model.similarity import Similarity
from ...controllers.validation import require_choice
from ..scenario.model_errors import EXACT_MODEL, ModelErrors
from ..scenario.physics_options import PLAIN_PHYSICS, PhysicsOptions
from ..scenario.scenario import EXACT_SENSING, ONBOARD, Scenario


@dataclass(frozen=True)
class Profile:
    """Model errors, physics and sensing of every robot that it is applied to."""

    name: str
    errors: ModelErrors = EXACT_MODEL
    physics: PhysicsOptions = PLAIN_PHYSICS
    sensing: str = EXACT_SENSING

    def applied(self, scenario: Scenario) -> Scenario:
        """The scenario on such a robot, of the same id and noise seed; what it says itself stands."""
        return replace(
            scenario,
            errors=_completed(scenario.errors, self.errors),
            physics=_completed(scenario.physics, self.physics),
            sensing=self.sensing if scenario.sensing == EXACT_SENSING else scenario.sensing,
        )

    def scaled(self, scale: Similarity) -> Profile:
        """The same profile for a robot of another size."""
        return replace(self, errors=self.errors.scaled(scale))


def _completed(own: Any, common: Any) -> Any:
    """A dataclass with the fields of `common` where its own are at their default."""
    return replace(common, **changed_fields(own))


EXACT = Profile("exact")
HARDWARE = Profile(
    "hardware",
    ModelErrors(
        friction=0.7,
        delay=0.004,
        joint_friction=1.0,
        armature=0.03,
        collisions=True,
        motor_power=2000.0,
        bus_power=3000.0,
        continuous_torque=0.4,
    ),
    PhysicsOptions(time_step=0.001, cone="elliptic", impratio=10.0),
    ONBOARD,
)
PROFILES: Mapping[str, Profile] = MappingProxyType({profile.name: profile for profile in (EXACT, HARDWARE)})


def get_profile(name: str) -> Profile:
    """A profile by name; raises UnknownNameError listing the valid ones."""
    require_choice("profile", name, list(PROFILES))
    return PROFILES[name]
