"""A preset for a robot of another size: every number by its unit.

Two robots of which one is the other made larger move alike where lengths go with the CoM's height h, times
with sqrt(h / g) and forces with the mass m: then accelerations, friction and shares of the weight are the
same (Froude's similarity; Hof 1996, Scaling gait data to body size). Other lengths are a robot's own, those
of foot and leg. So is what leaning can do for it: to turn the trunk by 1 rad/s^2 moves the CoM by j / (m h)
m/s^2, which differs by a factor of ten between robots of one height, and whole-body control prices a
deviation by what the CoM is spared. And so is how soon a foot can be elsewhere: hips of the torque tau, whose
leg of length l has the inertia i about them, give the sole tau l / i m/s^2 at most, and a step takes as long
as the root of its length over that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from .planner_config import PlannerConfig
from .presets import NEUTRAL, PresetFile

Unit = tuple[tuple[str, float], ...]

LENGTH, TIME, MASS = (("length", 1.0),), (("time", 1.0),), (("mass", 1.0),)
FOOT_LENGTH, FOOT_WIDTH = (("foot_length", 1.0),), (("foot_width", 1.0),)
SWING, SWING_TIME = (("swing", 1.0),), (("length", 0.5), ("swing", -0.5))
PER_AREA, STIFFNESS, DAMPING = (("length", -2.0),), (("time", -2.0),), (("time", -1.0),)

# Unit of each number as powers of the ratios in `Scale`; what is not here is a pure number or a switch
UNITS: Mapping[str, Mapping[str, Unit]] = {
    "planner": {
        **dict.fromkeys(("alpha_step", "alpha_offset", "beta_cop", "beta_dcm"), PER_AREA),
        **dict.fromkeys(
            ("duration_margin", "freeze", "touchdown_delay", "double_support", "push_carry", "sampling_time",
             "tail_sampling_time", "mpc_step"), TIME),
        "push_threshold": LENGTH,
        "swing_acceleration": SWING,
        "beta_dcm_acceleration": (("length", -2.0), ("time", 4.0)),
        "beta_trunk": (("trunk_acceleration", -2.0),),
        "beta_trunk_rate": (("trunk_acceleration", -1.0), ("trunk_angle", -1.0)),
        "beta_trunk_angle": (("trunk_angle", -2.0),),
        "beta_trunk_limit": (("trunk_angle", -2.0),),
        "trunk_gravity": (("mass", 1.0), ("length", 1.0)),
        "cop_margin_x": FOOT_LENGTH,
        "cop_margin_y": FOOT_WIDTH,
        "mpc_velocity": (("time", 2.0),),
        "mpc_jerk": (("time", 6.0),),
        "upright_stiffness": STIFFNESS,
        "upright_damping": DAMPING,
    },
    "limits": {
        **dict.fromkeys(("length_min", "length_max", "width_max"), LENGTH),
        **dict.fromkeys(("duration_min", "duration_max"), SWING_TIME),
        "width_min": FOOT_WIDTH,
        "cop_x_max": FOOT_LENGTH,
        "cop_y_max": FOOT_WIDTH,
        "trunk_acceleration_max": (("trunk_acceleration", 1.0),),
    },
    "gait": {
        **dict.fromkeys(("apex", "height_drop"), LENGTH),
        **dict.fromkeys(("landing_delay", "commit", "early", "settled", "height_lead", "height_time"), TIME),
        **dict.fromkeys(("early_load", "forced_load"), MASS),
        "descent": (("length", 1.0), ("time", -1.0)),
        "reach": (("leg", 1.0),),
    },
    "gains": {
        "swing_max": SWING,
        **dict.fromkeys(("stance_kp", "swing_kp", "swing_turn_kp", "pelvis_kp", "heading_kp", "height_kp"),
                        STIFFNESS),
        **dict.fromkeys(("stance_kd", "swing_kd", "swing_turn_kd", "pelvis_kd", "heading_kd", "height_kd"),
                        DAMPING),
    },
    "bounds": {
        **dict.fromkeys(("cop_x_max", "yaw_friction"), FOOT_LENGTH),
        "cop_y_max": FOOT_WIDTH,
        "force_min": MASS,
        "waist_price": (("waist", 2.0),),
        "pelvis_price": (("lean", 2.0),),
        **dict.fromkeys(("heading_price", "swing_turn_price"), (("time", 4.0),)),
    },
}  # fmt: skip


@dataclass(frozen=True)
class Scale:
    """How many times as large a robot is as the one that a preset was made for."""

    length: float  # CoM height
    mass: float
    foot_length: float
    foot_width: float
    leg: float  # straight, hip to ankle
    trunk_acceleration: float = 1.0  # largest of the waist
    trunk_angle: float = 1.0  # largest of the waist
    waist: float = 1.0  # j / (m h) of all that the waist carries
    lean: float = 1.0  # the same of all that lies above the hips
    swing: float = 1.0  # acceleration that the hips can give a sole

    @property
    def time(self) -> float:
        """Of sqrt(h / g)."""
        return self.length**0.5

    def factor(self, unit: Unit) -> float:
        """What a number of a unit is multiplied by."""
        factor = 1.0
        for name, power in unit:
            factor *= getattr(self, name) ** power
        return factor


def scaled_preset(preset: PresetFile, scale: Scale, own: Mapping[str, Mapping[str, Any]]) -> PresetFile:
    """The preset of a robot that is larger or smaller; it stands on no other.

    Args:
        preset: of the robot that it was made for.
        scale: of the other robot.
        own: section -> field -> value of what is known of the other robot otherwise, which takes precedence.
    """
    config = preset.config()
    values = {field.name: getattr(config, field.name) for field in fields(PlannerConfig)}
    planner = {**_scaled(values, "planner", scale), **own.get("planner", {})}
    plain = {name: value for name, value in planner.items() if value != getattr(PlannerConfig(), name)}
    arms = {arm: _scaled_arm(values, scale) for arm, values in preset.arms.items()}
    robot = {
        name: {**_scaled(part, name, scale), **own.get(name, {})} for name, part in preset.robot().items()
    }
    return PresetFile(NEUTRAL, plain, arms, robot)


def _scaled_arm(values: Mapping[str, Any], scale: Scale) -> dict[str, Any]:
    """What is one arm's own, its robot's part included."""
    planner = {name: value for name, value in values.items() if name != "biped"}
    robot = {name: _scaled(part, name, scale) for name, part in values.get("biped", {}).items()}
    return {**_scaled(planner, "planner", scale), **({"biped": robot} if robot else {})}


def _scaled(values: Mapping[str, Any], section: str, scale: Scale) -> dict[str, Any]:
    """The values of a section; floats rounded to six digits, others as they are."""
    units = UNITS[section]
    return {
        name: float(f"{value * scale.factor(units[name]):.6g}") if name in units else value
        for name, value in values.items()
    }
