"""The robot as the planner knows it: pendulum constants, roles of its joints, and its size beside others."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from itertools import chain

from ..errors import InvalidValueError, is_finite_number, shown
from ..validation import keep_python_numbers, require_kind

GRAVITY = 9.81  # [m/s^2]
SMALLEST, LARGEST = 1e-4, 1e6  # of any constant of a robot, in its unit


def natural_frequency(com_height: float) -> float:
    """Natural frequency sqrt(g / h) [1/s] of a pendulum of constant height h [m]."""
    if not com_height > 0:
        raise InvalidValueError(f"com_height must be positive [m], got {com_height}")
    return math.sqrt(GRAVITY / com_height)


@dataclass(frozen=True)
class RobotModel:
    """Pendulum with flywheel, the planner's model of a robot; the defaults are the paper's Table II.

    The paper leaves the foot's size and the pelvis width open; 0.20 x 0.10 m and 0.20 m are plausible and
    its claims hold with them. Where the waist lacks an axis there is no flywheel about it; inertia, torque
    and angle of a trunk without any axis have no meaning and may be any numbers in range.
    """

    mass: float = 60.0  # [kg]
    com_height: float = 0.8  # [m]
    trunk_inertia: float = 8.0  # j [kg m^2]
    trunk_torque_max: float = 150.0  # [N m]
    trunk_angle_max: float = math.pi / 3  # [rad], both ways
    foot_length: float = 0.20  # [m]
    foot_width: float = 0.10  # [m]
    pelvis_width: float = 0.20  # l_p [m], lateral distance of the feet when standing
    trunk_pitch: bool = True  # whether the waist can swing the trunk forward and back
    trunk_roll: bool = True  # whether it can swing it aside

    def __post_init__(self) -> None:
        keep_python_numbers(self)
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(field.default, bool):
                require_kind(f"RobotModel.{field.name}", value, bool)
                continue
            if not (is_finite_number(value) and value > 0):
                raise InvalidValueError(
                    f"RobotModel.{field.name} must be positive and finite, got {shown(value)}"
                )
            if not SMALLEST <= value <= LARGEST:
                raise InvalidValueError(
                    f"RobotModel.{field.name} must lie in [{SMALLEST:g}, {LARGEST:g}], got {value:g}"
                )

    @property
    def omega(self) -> float:
        """Natural frequency sqrt(g / h) [1/s]."""
        return natural_frequency(self.com_height)

    @property
    def weight(self) -> float:
        """Weight m g [N]."""
        return self.mass * GRAVITY

    @property
    def cmp_per_trunk_acceleration(self) -> float:
        """Gain j / (m g) [m s^2]: CMP = CoP + this x trunk acceleration (eqs. 5, 9)."""
        return self.trunk_inertia / self.weight


LEG_JOINTS = 6  # from hip to sole; the fourth is the knee
Pair = tuple[str, str]


@dataclass(frozen=True)
class BodyPlan:
    """The roles that gait machine and whole-body control know, and the names that have them.

    Control knows a floating base, a waist of at most two axes and two legs of six joints each. Order and axes
    of the hip's three joints and of the ankle's two are free. Joints named in `held` keep their angle, as
    those of arms or of a waist that yaws; they may lie between the pelvis and the legs or the waist, too.
    """

    pelvis: str  # body with the free joint, which both legs hang from; x forward, z up where it is upright
    trunk: str  # body above the waist; without a waist it may be the pelvis
    legs: tuple[tuple[str, ...], tuple[str, ...]]  # left, right: from hip to sole, the fourth is the knee
    soles: Pair  # sites in the centres of the soles, x forward, z up
    loads: Pair  # sensors of the normal force under each sole [N]
    sole_boxes: Pair  # geoms that touch the floor, boxes as large as the soles
    waist: tuple[str | None, str | None] = (None, None)  # joints about y (pitch) and x (roll), if any
    bend: tuple[float, ...] = (0.0,) * LEG_JOINTS  # left leg's angles, near which postures are sought [rad]
    held: tuple[tuple[str, float], ...] = ()  # other joints and the angles that they keep [rad]

    def __post_init__(self) -> None:
        for side, leg in zip(("left", "right"), self.legs, strict=True):
            if len(leg) != LEG_JOINTS:
                raise InvalidValueError(
                    f"the {side} leg of a BodyPlan has {LEG_JOINTS} joints from hip to sole, got {leg!r}"
                )
        if len(self.bend) != LEG_JOINTS:
            raise InvalidValueError(f"BodyPlan.bend has {LEG_JOINTS} angles [rad], got {self.bend!r}")
        if self.trunk == self.pelvis and any(self.waist):
            raise InvalidValueError(
                f"trunk and pelvis of a BodyPlan with a waist are two bodies, got {self.trunk!r} twice"
            )
        names = [*chain(*self.legs), *(name for name in self.waist if name), *(name for name, _ in self.held)]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InvalidValueError(f"a joint has one role in a BodyPlan, got {', '.join(twice)} twice")


REFERENCE = RobotModel()  # whose pushes all suites, profiles and training settings are written for


@dataclass(frozen=True)
class Similarity:
    """Ratios of a robot's quantities to another one's: what a push of one is to the other.

    Two robots of which one is the other made larger move alike where lengths go with the CoM's height h,
    times with sqrt(h / g) and forces with the mass m: then accelerations, friction and shares of the weight
    are the same (Froude's similarity; Hof 1996, Scaling gait data to body size).
    """

    mass: float = 1.0
    length: float = 1.0

    @classmethod
    def of(cls, robot: RobotModel, other: RobotModel = REFERENCE) -> Similarity:
        """The ratios of a robot to another one, by their masses and CoM heights."""
        return cls(robot.mass / other.mass, robot.com_height / other.com_height)

    @property
    def time(self) -> float:
        """Ratio of sqrt(h / g), and so of a velocity in m/s."""
        return self.length**0.5

    velocity = time

    @property
    def rate(self) -> float:
        """Ratio of a number in rad/s."""
        return 1.0 / self.time

    @property
    def angular_acceleration(self) -> float:
        """Ratio of a number in rad/s^2."""
        return 1.0 / self.length

    @property
    def impulse(self) -> float:
        """Ratio of a number in N s; a force goes with the mass."""
        return self.mass * self.time

    @property
    def torque(self) -> float:
        """Ratio of a number in N m."""
        return self.mass * self.length

    @property
    def damping(self) -> float:
        """Ratio of a number in N m s/rad."""
        return self.torque * self.time

    @property
    def stiffness(self) -> float:
        """Ratio of a number in N/m."""
        return self.mass / self.length

    @property
    def viscosity(self) -> float:
        """Ratio of a number in N s/m."""
        return self.mass / self.time

    @property
    def inertia(self) -> float:
        """Ratio of a number in kg m^2."""
        return self.mass * self.length**2

    @property
    def power(self) -> float:
        """Ratio of a number in W."""
        return self.mass * self.velocity


SAME = Similarity()
