"""How far robot and floor are from what the planner believes, and how the physics is computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...controllers.errors import InvalidValueError, shown
from ...controllers.model.robot import Similarity
from ...controllers.validation import changed_fields, require_choice, require_number, require_vector
from .record import JsonRecord
from .terrain import TERRAINS, Slope, Terrain, Tiles

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
    "payload": "mass", "trunk_com": "length", "dcm_noise": "length",
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
    terrain: Terrain | None = None  # of a registered kind, on that slope and besides those tiles
    floor_known: bool = False  # control knows how high the floor is where the swing foot is to land

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
        for name in ("collisions", "floor_known"):
            if not isinstance(getattr(self, name), bool):
                raise InvalidValueError(
                    f"ModelErrors.{name} must be true or false, got {shown(getattr(self, name))}"
                )
        if self.terrain is not None and type(self.terrain) not in TERRAINS.by_name.values():
            raise InvalidValueError(
                f"ModelErrors.terrain must be a Terrain of a registered kind, got {shown(self.terrain)}"
            )
        if self.terrain is not None and self.terrain.collides and not self.collisions:
            raise InvalidValueError(
                f"ModelErrors.collisions must be true with a terrain that robots collide with, "
                f"{self.terrain.json_name}, got {self.collisions}"
            )

    @property
    def terrains(self) -> tuple[Terrain, ...]:
        """What the floor is made of; empty for a level plane."""
        own = Slope(self.slope_forward, self.slope_left), Tiles(self.floor_step), self.terrain
        return tuple(part for part in own if part not in (None, Slope(), Tiles()))

    @property
    def tilt(self) -> tuple[float, float]:
        """Angles by which the whole floor rises forward and to the left [rad]."""
        tilts = [part.tilt for part in self.terrains]
        return sum(forward for forward, _ in tilts), sum(left for _, left in tilts)

    def _with_terrain(self, change: Callable[[Any], Any]) -> ModelErrors:
        """These errors with every part of the floor changed."""
        slope, tiles = change(Slope(self.slope_forward, self.slope_left)), change(Tiles(self.floor_step))
        terrain = None if self.terrain is None else change(self.terrain)
        return replace(
            self, slope_forward=slope.forward, slope_left=slope.left, floor_step=tiles.step, terrain=terrain
        )

    @classmethod
    def _parsed(cls, name: str, value: Any) -> Any:
        if name == "terrain" and isinstance(value, Mapping):
            return TERRAINS.read(value)
        return super()._parsed(name, value)

    @property
    def names(self) -> tuple[str, ...]:
        """Fields that differ from their default."""
        return tuple(changed_fields(self))

    def scaled(self, scale: Similarity) -> ModelErrors:
        """The same errors of a robot of another size.

        Raises:
            InvalidValueError: one of them is then out of its bounds.
        """
        values = changed_fields(self._with_terrain(lambda part: part.scaled(scale)))
        for name in SCALES.keys() & values.keys():
            factor, value = getattr(scale, SCALES[name]), values[name]
            values[name] = tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
        return ModelErrors(**values)

    def mirrored(self) -> ModelErrors:
        """Reflection in the x-z plane; noise is mirrored with the stance side of the first step."""
        x, y, z = self.trunk_com
        return replace(self._with_terrain(lambda part: part.mirrored()), trunk_com=(x, -y, z))

    def require_only(self, robot: str, known: Sequence[str]) -> None:
        """Raise InvalidValueError where an error is set that this kind of robot cannot have."""
        if unknown := [name for name in self.names if name not in known]:
            raise InvalidValueError(
                f"{robot} has no model error {unknown[0]!r} (valid: {', '.join(known)}), "
                f"got {getattr(self, unknown[0])!r}"
            )


EXACT_MODEL = ModelErrors()
