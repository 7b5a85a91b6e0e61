"""How far robot and floor are from what the planner believes, and how the physics is computed.

These and all other parts of a scenario are a `JsonRecord`: a frozen dataclass, read from JSON and written.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from typing import Any, ClassVar, Self

from ...controllers.errors import InvalidValueError, shown
from ...controllers.model.robot import Similarity
from ...controllers.validation import (
    changed_fields,
    parse_json,
    require_choice,
    require_keys,
    require_number,
    require_vector,
)


class JsonRecord:
    """Base of a frozen dataclass whose fields are the keys of a JSON object, in their order."""

    json_name: ClassVar[str]  # what errors call such an object
    left_out: ClassVar[tuple[str, ...] | None] = ()  # keys not written at their default; None: all of them

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types: a tuple is a list, another record an object."""
        values = {}
        for name, default in _defaults(type(self)):
            value = getattr(self, name)
            if default is MISSING or value != default:
                values[name] = _plain(value)
        return values

    @classmethod
    def from_dict(cls, data: object) -> Self:
        """Inverse of `to_dict`; fields with a default may be left out.

        Raises:
            InvalidValueError: no object, a missing key, or an impossible value.
            UnknownNameError: an unknown key.
        """
        entries = fields(cls)  # type: ignore[arg-type]
        required = {entry.name for entry in entries if entry.default is MISSING}
        values = require_keys(cls.json_name, data, required, {entry.name for entry in entries} - required)
        return cls(**{name: cls._parsed(name, value) for name, value in values.items()})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The record of a JSON text; raises InvalidValueError on text that is no JSON."""
        return cls.from_dict(parse_json(f"text of {cls.json_name}", text))

    @classmethod
    def _parsed(cls, name: str, value: Any) -> Any:
        """The value of a field, from its JSON; a list is a tuple, so that the record can be hashed."""
        return tuple(value) if isinstance(value, list) else value

    def _set(self, **values: Any) -> None:
        """Replace fields of the frozen record, from within its `__post_init__`."""
        for name, value in values.items():
            object.__setattr__(self, name, value)


def object_of(kind: type[JsonRecord], value: Any) -> Any:
    """The record of a JSON object; any other value as it is, for the constructor to judge."""
    return kind.from_dict(value) if isinstance(value, Mapping) else value


@cache
def _defaults(kind: type[JsonRecord]) -> tuple[tuple[str, Any], ...]:
    """Fields of a kind of record, each with the default at which it is left out; MISSING: never."""
    return tuple(
        (field.name, field.default if kind.left_out is None or field.name in kind.left_out else MISSING)
        for field in fields(kind)  # type: ignore[arg-type]
    )


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    return value.to_dict() if isinstance(value, JsonRecord) else value


CONTROL_STEP = 0.002  # control acts this often, whatever the time step [s]
FINEST = 20  # physics steps in one step of control, at most
CHOICES = {
    "integrator": ("euler", "rk4", "implicit", "implicitfast"),
    "solver": ("newton", "cg", "pgs"),
    "cone": ("pyramidal", "elliptic"),
}
NUMBERS = {"impratio": ("", 0.1, 1000.0), "contact_time": (" [s]", 1e-4, 0.2)}  # unit, least, largest


@dataclass(frozen=True)
class PhysicsOptions(JsonRecord):
    """Numerical options of MuJoCo, of which no result should hang; None: what the robot's model says.

    Torques and pushes are held, and the mean force of contact is measured, over the steps between two of
    control.
    """

    json_name, left_out = "physics options", None

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
        self._set(time_step=time_step)
        for name, valid in CHOICES.items():
            if (value := getattr(self, name)) is not None:
                require_choice(name, value, valid)
        for name, (unit, low, high) in NUMBERS.items():
            if (value := getattr(self, name)) is not None:
                self._set(**{name: require_number(f"PhysicsOptions.{name}{unit}", value, low, high)})

    @property
    def steps(self) -> int:
        """Physics steps in one step of control."""
        return round(CONTROL_STEP / self.time_step)


PLAIN_PHYSICS = PhysicsOptions()

STEEPEST_SLOPE = math.radians(5.0)  # [rad]
TRUNK_COM_MAX = 0.1  # [m]

# field: unit, smallest, largest
BOUNDS: dict[str, tuple[str, float, float]] = {
    "mass": ("", -0.5, 0.5),
    "payload": (" [kg]", 0.0, 30.0),
    "friction": ("", 0.2, 2.0),
    "slope_forward": (" [rad]", -STEEPEST_SLOPE, STEEPEST_SLOPE),
    "slope_left": (" [rad]", -STEEPEST_SLOPE, STEEPEST_SLOPE),
    "delay": (" [s]", 0.0, 0.05),
    "dcm_noise": (" [m]", 0.0, 0.1),
    "joint_noise": (" [rad]", 0.0, 0.05),
    "floor_step": (" [m]", 0.0, 0.05),
    "joint_friction": (" [N m]", 0.0, 20.0),
    "joint_damping": (" [N m s/rad]", 0.0, 20.0),
    "armature": (" [kg m^2]", 0.0, 1.0),
    "motor_power": (" [W]", 1.0, 1e6),
    "bus_power": (" [W]", 1.0, 1e6),
    "continuous_torque": ("", 0.1, 1.0),
}
OPEN = ("friction", "motor_power", "bus_power", "continuous_torque")  # that may be None
SCALES = {  # field -> what of `Similarity` it goes with; times, angles and shares are any robot's
    "payload": "mass", "trunk_com": "length", "dcm_noise": "length", "floor_step": "length",
    "joint_friction": "torque", "joint_damping": "damping", "armature": "inertia",
    "motor_power": "power", "bus_power": "power",
}  # fmt: skip


@dataclass(frozen=True)
class ModelErrors(JsonRecord):
    """Properties of the robot and its floor that planner and whole-body control do not know.

    Both go on believing the nominal robot of 60 kg on a level floor. The defaults are no errors.
    """

    json_name, left_out = "model errors", None

    mass: float = 0.0  # relative, of every body, its inertia and the rotors': 0.1 is 10 % heavier
    payload: float = 0.0  # a point mass at the trunk's CoM [kg]
    trunk_com: tuple[float, float, float] = (0.0, 0.0, 0.0)  # how far the trunk's CoM is off, body axes [m]
    friction: float | None = None  # coefficient between soles and floor; None: the model's
    slope_forward: float = 0.0  # the floor rises forward by this angle [rad]
    slope_left: float = 0.0  # and to the left [rad]
    delay: float = 0.0  # between computing an actuator's command and its action [s]
    dcm_noise: float = 0.0  # standard deviation of the observed DCM, each axis and period [m]
    joint_noise: float = 0.0  # standard deviation of a measured joint angle, each physics step [rad]
    floor_step: float = 0.0  # tiles of the floor are up to this much higher than others [m]
    joint_friction: float = 0.0  # dry friction of every joint of waist and legs [N m]
    joint_damping: float = 0.0  # viscous friction of the same joints [N m s/rad]
    armature: float = 0.0  # inertia of every such joint's rotor beyond the model's [kg m^2]
    collisions: bool = False  # legs, arms and trunk collide with each other and with the floor
    motor_power: float | None = None  # most that one motor gives [W]; None: as torque and speed allow
    bus_power: float | None = None  # most that all motors together take from the battery [W]; None: any
    continuous_torque: float | None = None  # share of its torque that a motor gives for ever; None: all

    def __post_init__(self) -> None:
        for name, (unit, low, high) in BOUNDS.items():
            value = getattr(self, name)
            if name in OPEN and value is None:
                continue
            checked = require_number(f"ModelErrors.{name}{unit}", value, low, high)
            self._set(**{name: checked + 0.0})  # no -0.0
        trunk_com = require_vector("ModelErrors.trunk_com [m]", self.trunk_com)
        for axis, value in zip("xyz", trunk_com, strict=True):
            require_number(f"ModelErrors.trunk_com {axis} [m]", value, -TRUNK_COM_MAX, TRUNK_COM_MAX)
        self._set(trunk_com=tuple(value + 0.0 for value in trunk_com))
        if not isinstance(self.collisions, bool):
            raise InvalidValueError(
                f"ModelErrors.collisions must be true or false, got {shown(self.collisions)}"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Fields that differ from their default."""
        return tuple(changed_fields(self))

    def scaled(self, scale: Similarity) -> ModelErrors:
        """The same errors of a robot of another size.

        Raises:
            InvalidValueError: one of them is then out of its bounds.
        """
        values = {name: getattr(self, name) for name in self.names}
        for name in SCALES.keys() & values.keys():
            factor, value = getattr(scale, SCALES[name]), values[name]
            values[name] = tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
        return ModelErrors(**values)

    def mirrored(self) -> ModelErrors:
        """Reflection in the x-z plane; noise is mirrored with the stance side of the first step."""
        x, y, z = self.trunk_com
        return replace(self, trunk_com=(x, -y, z), slope_left=-self.slope_left)

    def require_only(self, robot: str, known: Sequence[str]) -> None:
        """Raise InvalidValueError where an error is set that this kind of robot cannot have."""
        if unknown := [name for name in self.names if name not in known]:
            raise InvalidValueError(
                f"{robot} has no model error {unknown[0]!r} (valid: {', '.join(known)}), "
                f"got {getattr(self, unknown[0])!r}"
            )


EXACT_MODEL = ModelErrors()
