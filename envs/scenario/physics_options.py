"""How finely and with which contacts the physics is computed: `PhysicsOptions`, a part of a scenario."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.json_text import changed_fields
from ...controllers.validation import require_choice, require_keys, require_number

CONTROL_STEP = 0.002  # control acts this often, whatever the time step [s]
FINEST = 20  # physics steps in one step of control, at most
CHOICES = {
    "integrator": ("euler", "rk4", "implicit", "implicitfast"),
    "solver": ("newton", "cg", "pgs"),
    "cone": ("pyramidal", "elliptic"),
}
NUMBERS = {"impratio": ("", 0.1, 1000.0), "contact_time": (" [s]", 1e-4, 0.2)}  # unit, least, largest


@dataclass(frozen=True)
class PhysicsOptions:
    """Numerical options of MuJoCo, of which no result should hang; None: what the robot's model says.

    Torques and pushes are held, and the mean force of contact is measured, over the steps between two of
    control.
    """

    time_step: float = CONTROL_STEP  # 2 ms over a whole number [s]
    integrator: str | None = None  # see CHOICES
    solver: str | None = None  # of the contacts' problem
    cone: str | None = None  # of friction
    impratio: float | None = None  # impedance of friction over that of the normal force
    contact_time: float | None = None  # time constant of the contacts' springs, the first of solref [s]

    def __post_init__(self) -> None:
        time_step = require_number("PhysicsOptions.time_step [s]", self.time_step, CONTROL_STEP / FINEST)
        steps = CONTROL_STEP / time_step
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
            raise InvalidValueError(
                f"PhysicsOptions.time_step [s] must be {CONTROL_STEP:g} over a whole number up to {FINEST}, "
                f"such as 0.001, got {time_step:g}"
            )
        object.__setattr__(self, "time_step", time_step)
        for name, valid in CHOICES.items():
            if (value := getattr(self, name)) is not None:
                require_choice(name, value, valid)
        for name, (unit, low, high) in NUMBERS.items():
            if (value := getattr(self, name)) is not None:
                number = require_number(f"PhysicsOptions.{name}{unit}", value, low, high)
                object.__setattr__(self, name, number)

    @property
    def steps(self) -> int:
        """Physics steps in one step of control."""
        return round(CONTROL_STEP / self.time_step)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types; options at their default are left out."""
        return changed_fields(self)

    @classmethod
    def from_dict(cls, data: object) -> PhysicsOptions:
        """Inverse of `to_dict`."""
        return cls(**require_keys("physics options", data, set(), {f.name for f in fields(cls)}))


PLAIN_PHYSICS = PhysicsOptions()
