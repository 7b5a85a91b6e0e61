"""Settings of the planner: weights, the variants by name, and presets as JSON files.

    {"format": "push-recovery preset", "format_version": 1, "base": "biped",
     "planner": {"touchdown_delay": 0.004},           fields of PlannerConfig, for every variant
     "biped": {"gains": {"swing_kp": 350.0}},         limits, gait, gains, bounds of the MuJoCo biped
     "arms": {"two-stage": {"beta_dcm": 900.0,        both for one variant
                            "biped": {"gait": {"apex": 0.05}}}},
     "found": {...}}                                  for the reader

What a file leaves out is that of its base: a named preset, or "neutral", the defaults of `PlannerConfig`. The
named presets are files, too, in the folder `presets/` beside this module: all tuned numbers stand there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple

from .errors import InvalidValueError, UnknownNameError, is_finite_number, is_integer
from .files import read_file, write_atomically
from .validation import keep_python_numbers, parse_json

CHOICES = {
    "foothold": ("optimal", "capture_point", "linear_mpc"),
    "form": ("zoh", "jerk"),
    "solver": ("daqp", "osqp"),
    "jerk_cost": ("literal", "repaired"),
}
SHORTEST_SAMPLING = 1e-3  # [s]; the horizon has a table for each number of intervals up to the longest step
MOST_INTERVALS = 100  # of the braking tail


@dataclass(frozen=True)
class PlannerConfig:
    """Weights and margins of both stages; immutable. Tuned values are in the presets."""

    # Stage 1, eq. 3
    alpha_step: float = 1.0  # alpha_1 [1/m^2]
    alpha_duration: float = 1.0  # alpha_2 [-], on tau = exp(omega T)
    alpha_offset: float = 1e6  # alpha_3 [1/m^2]
    adapt_step: bool = True  # False keeps the nominal place
    adapt_duration: bool = True  # False keeps the nominal time
    foothold: Literal["optimal", "capture_point", "linear_mpc"] = "optimal"  # eq. 3, or a baseline's rule
    duration_margin: float = 0.0  # tau >= exp(omega (t + margin)) [s]
    swing_acceleration: float = 0.0  # T gives the foot time to swing with this peak; 0: any [m/s^2]
    freeze: float = 0.0  # the plan of both stages is held when less than this remains [s]
    touchdown_delay: float = 0.0  # the new foot carries load this long after T [s]
    double_support: float = 0.0  # d: both feet stand for this long from touchdown on, part of T [s]

    # Both stages
    push_carry: float = 0.0  # the push of the last period is expected to last this much longer [s]
    push_threshold: float = 0.0  # a smaller push estimate is taken for noise [m]
    trunk_debt: bool = False  # what stopping the trunk will cost belongs to the DCM

    # Stage 2, eq. 20
    use_cop: bool = True
    use_trunk: bool = True
    form: Literal["zoh", "jerk"] = "zoh"
    solver: Literal["daqp", "osqp"] = "daqp"
    sampling_time: float = 0.05  # horizon grid [s]
    tail_intervals: int = 6  # braking tail of the trunk after touchdown
    tail_sampling_time: float = 0.06  # [s]
    beta_cop: float = 1.0  # beta_1 [1/m^2]
    beta_dcm_acceleration: float = 1.0  # beta_2 [s^4/m^2], jerk form only
    beta_trunk: float = 1e-4  # beta_3: trunk acceleration (zoh) [s^4/rad^2] or jerk (jerk form) [s^6/rad^2]
    beta_trunk_rate: float = 1e-2  # beta_4 [s^2/rad^2]
    beta_dcm: float = 1e5  # beta_5 [1/m^2]
    beta_trunk_angle: float = 1.0  # [1/rad^2]
    cop_margin_x: float = 0.0  # kept from the edge of the sole [m]
    cop_margin_y: float = 0.0  # [m]
    trunk_gravity: float = 0.0  # of the leaning trunk per sin(lean), taken from the torque bound [N m]
    beta_trunk_limit: float = 1e4  # weight of the trunk angle beyond its limit [1/rad^2]
    standing_horizon: float = 0.6  # of stage 2 on two standing feet [s]
    standing_carry: float = 0.1  # `push_carry` of stage 2 on two standing feet [s]
    first_interval_min: float = 0.01  # the control period: shortest first interval of the horizon [s]
    jerk_cost: Literal["literal", "repaired"] = "repaired"  # jerk form: eq. 20, or about the free motion

    # Linear MPC, against |CoP - sole's centre|^2; all are deviations from the nominal gait
    mpc_velocity: float = 0.1  # of the CoM [s^2]
    mpc_jerk: float = 1e-8  # of the CoM [s^6]
    mpc_step: float = 1e-3  # of the footsteps, against the integral over the horizon [s]

    # Trunk law of the variants without momentum regulation
    upright_stiffness: float = 20.0  # [1/s^2]
    upright_damping: float = 9.0  # [1/s]

    def __post_init__(self) -> None:
        for name, valid in CHOICES.items():
            if getattr(self, name) not in valid:
                raise UnknownNameError(f"PlannerConfig.{name}", getattr(self, name), valid)
        keep_python_numbers(self)
        for own in fields(self):
            value = getattr(self, own.name)
            if isinstance(own.default, bool) and not isinstance(value, bool):
                raise InvalidValueError(f"PlannerConfig.{own.name} must be True or False, got {value!r}")
            if isinstance(own.default, float) and not (is_finite_number(value) and value >= 0):
                raise InvalidValueError(f"PlannerConfig.{own.name} must be finite and >= 0, got {value!r}")
        tail = self.tail_intervals
        if not (is_integer(tail) and 0 <= tail <= MOST_INTERVALS):
            raise InvalidValueError(
                f"PlannerConfig.tail_intervals must be an integer from 0 to {MOST_INTERVALS}, got {tail!r}"
            )
        for name in ("sampling_time", "tail_sampling_time", "standing_horizon"):
            if not getattr(self, name) >= SHORTEST_SAMPLING:
                raise InvalidValueError(
                    f"PlannerConfig.{name} must be at least {SHORTEST_SAMPLING} s, got {getattr(self, name)}"
                )
        if self.double_support > 0 and self.touchdown_delay > 0:
            raise InvalidValueError(
                "PlannerConfig.double_support and touchdown_delay exclude each other, "
                f"got {self.double_support} s and {self.touchdown_delay} s: set one of them to 0"
            )

    def replace(self, **changes: Any) -> PlannerConfig:
        """These settings with some fields changed.

        Raises:
            UnknownNameError: a field that does not exist; names the nearest one.
            InvalidValueError: an impossible value.
        """
        _check_fields("field of PlannerConfig", changes)
        return replace(self, **changes)

    def numbers(self, names: Iterable[str]) -> dict[str, float]:
        """Settings among the names, as floats for compiled code; switches are 1 or 0."""
        return {name: float(getattr(self, name)) for name in names if hasattr(self, name)}


def _check_fields(kind: str, names: Iterable[str]) -> None:
    valid = [field.name for field in fields(PlannerConfig)]
    for name in names:
        if name not in valid:
            raise UnknownNameError(kind, name, valid)


class Stages(NamedTuple):
    """Inputs that a variant of the planner may adapt, and its rule of the foothold."""

    use_cop: bool
    use_trunk: bool
    fixed_time: bool = False  # T stays nominal
    foothold: str = "optimal"  # of `PlannerConfig`; another one than this leaves T nominal

    @property
    def settings(self) -> dict[str, Any]:
        """Fields of `PlannerConfig` that turn a configuration into the variant's."""
        values: dict[str, Any] = {"use_cop": self.use_cop, "use_trunk": self.use_trunk}
        if self.fixed_time:
            values["adapt_duration"] = False
        if self.foothold != "optimal":
            values["foothold"] = self.foothold
        return values


VARIANTS: dict[str, Stages] = {
    "passive": Stages(False, False),  # walks the nominal gait, without reaction
    "raibert": Stages(False, False, foothold="capture_point"),
    "herdt": Stages(False, False, foothold="linear_mpc"),
    "fixed-time": Stages(False, False, fixed_time=True),
    "stage-1-paper": Stages(False, False),
    "stage-1": Stages(False, False),
    "stage-1+cop": Stages(True, False),
    "stage-1+momentum": Stages(False, True),
    "two-stage-paper": Stages(True, True),
    "two-stage": Stages(True, True),
}
PAPER_SUFFIX = "-paper"  # of variants with the paper's Table II
# Not in tables unless asked for: no parts of the planner
ON_REQUEST = ("passive", "raibert", "herdt", "fixed-time")


FORMAT = "push-recovery preset"
FORMAT_VERSION = 1
# Key of the files -> field of `PresetFile`: what belongs to one variant has the key `arms` there
SECTIONS = {"base": "base", "planner": "planner", "arms": "variants", "biped": "biped", "found": "found"}
NEUTRAL = "neutral"  # base of presets that stand on no other
FOLDER = files("push_recovery.controllers") / "presets"
Values = Mapping[str, Any]


@dataclass(frozen=True)
class PresetFile:
    """Content of a preset file; checked where it concerns the planner."""

    base: str = "default"
    planner: Values = field(default_factory=dict)  # field of PlannerConfig -> value
    variants: Mapping[str, Values] = field(default_factory=dict)  # policy -> the same, and its own `biped`
    biped: Mapping[str, Values] = field(default_factory=dict)  # section -> field -> value
    found: Values = field(default_factory=dict)

    def __post_init__(self) -> None:
        valid = (*preset_names(), NEUTRAL)
        if self.base not in valid:
            raise UnknownNameError("base of a preset file", self.base, valid)
        _check_objects("planner", self.planner)
        _check_objects("found", self.found)
        _check_objects("biped", self.biped, depth=1)
        for variant, part in _check_objects("arms", self.variants, depth=1).items():
            _check_objects(f"arms.{variant}.biped", part.get("biped", {}), depth=1)
        for variant in self.variants:
            if variant not in VARIANTS:
                raise UnknownNameError("variant of a preset file", variant, VARIANTS)
        for variant in ("", *self.variants):
            self.config(variant)

    def config(self, variant: str = "") -> PlannerConfig:
        """The planner's settings of a variant; the empty name gives those common to all.

        Raises:
            UnknownNameError: a field that PlannerConfig does not have.
            InvalidValueError: a value that it refuses.
        """
        own = {name: value for name, value in self.variants.get(variant, {}).items() if name != "biped"}
        values = {**self.planner, **own}
        _check_fields("planner field of a preset file", values)
        base = PlannerConfig() if self.base == NEUTRAL else named_preset(self.base).config(variant)
        return base.replace(**values)

    def robot(self, variant: str = "") -> dict[str, dict[str, Any]]:
        """Section -> field -> value of the robot that a variant walks: the base's, with this file's put in.

        For the empty name, and for variants that have none of their own, it is the robot common to all.
        """
        sections = {} if self.base == NEUTRAL else named_preset(self.base).robot(variant)
        for part in (self.biped, self.variants.get(variant, {}).get("biped", {})):
            for name, values in part.items():
                sections[name] = {**sections.get(name, {}), **values}
        return sections

    @property
    def made_for(self) -> Values | None:
        """Field of `RobotModel` -> value of the robot that it is for, by it or its base; None: for any."""
        if "robot" in self.found or self.base == NEUTRAL:
            return self.found.get("robot")
        return named_preset(self.base).made_for

    def has_own_robot(self, variant: str) -> bool:
        """Whether a variant walks another robot, or another timing of its touchdown, than the common one."""
        delays = self.config(variant).touchdown_delay, self.config().touchdown_delay
        return self.robot(variant) != self.robot() or delays[0] != delays[1]

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types, by the keys of the files."""
        values = asdict(self)
        content = {key: values[name] for key, name in SECTIONS.items()}
        return {"format": FORMAT, "format_version": FORMAT_VERSION, **content}

    def save(self, path: Path) -> None:
        """Write the file whole or not at all."""
        write_atomically(path, (json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n").encode())


@cache
def preset_names() -> tuple[str, ...]:
    """Names of the presets that come with the package."""
    return tuple(sorted(entry.name.removesuffix(".json") for entry in FOLDER.iterdir()))


@cache
def named_preset(name: str) -> PresetFile:
    """The file of a named preset.

    Raises:
        UnknownNameError: listing the valid names.
    """
    if name not in preset_names():
        raise UnknownNameError("preset", name, preset_names())
    return _parse((FOLDER / f"{name}.json").read_text(encoding="utf-8"), name)


def is_preset_file(preset: str) -> bool:
    """Whether a preset is given by a file rather than by its name."""
    return isinstance(preset, str) and preset.endswith(".json")


def load_preset(preset: str) -> PresetFile:
    """The preset of a file, or of a name as a file that changes nothing.

    Raises:
        UnknownNameError: no such name, section or field.
        InvalidValueError: a file that cannot be read, of another format, or with an impossible value.
    """
    if not is_preset_file(preset):
        if preset not in preset_names():
            raise UnknownNameError("preset", preset, [*preset_names(), "FILE.json"])
        return PresetFile(preset)
    try:
        text = read_file(preset)
    except (OSError, ValueError) as error:
        raise InvalidValueError(f"cannot read preset file {preset!r}: {error}") from error
    return _parse(text, preset)


def _parse(text: str | bytes, name: str) -> PresetFile:
    """The preset file with a content; `name` is for errors."""
    content = parse_json(f"preset file {name!r}", text)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InvalidValueError(f"{name!r} is no preset file: its 'format' is not {FORMAT!r}")
    if content.get("format_version") != FORMAT_VERSION:
        raise InvalidValueError(
            f"preset file {name!r} has format_version {content.get('format_version')!r}; "
            f"this version reads {FORMAT_VERSION}"
        )
    for section in content:
        if section not in {"format", "format_version", *SECTIONS}:
            raise UnknownNameError(f"section of preset file {name!r}", section, SECTIONS)
    return PresetFile(**{name: content[key] for key, name in SECTIONS.items() if key in content})


def read_preset(preset: str) -> PresetFile:
    """What a preset says, by name or file.

    Raises:
        UnknownNameError: listing the valid names.
        InvalidValueError: a file that cannot be read or has an impossible value.
    """
    return load_preset(preset) if is_preset_file(preset) else named_preset(preset)


def preset_config(preset: str, variant: str = "") -> PlannerConfig:
    """The planner's settings of a preset, see `read_preset`: of a variant, or those common to all."""
    return read_preset(preset).config(variant)


def _check_objects(name: str, section: Any, depth: int = 0) -> Values:
    """A section of a preset file, an object, and so are its entries to a depth."""
    if not isinstance(section, Mapping):
        raise InvalidValueError(f"{name} of a preset file must be an object, got {section!r}")
    for own, part in section.items() if depth else ():
        _check_objects(f"{name}.{own}", part, depth - 1)
    return section


Unit = tuple[tuple[str, float], ...]

LENGTH, TIME, MASS = (("length", 1.0),), (("time", 1.0),), (("mass", 1.0),)
FOOT_LENGTH, FOOT_WIDTH = (("foot_length", 1.0),), (("foot_width", 1.0),)
SWING, SWING_TIME = (("swing", 1.0),), (("length", 0.5), ("swing", -0.5))
PER_AREA, STIFFNESS, DAMPING = (("length", -2.0),), (("time", -2.0),), (("time", -1.0),)

# Numbers of each section by their unit, a product of powers of the ratios in `Scale`; what is not here is a
# pure number or a switch
_BY_UNIT: Mapping[str, Mapping[Unit, str]] = {
    "planner": {
        PER_AREA: "alpha_step alpha_offset beta_cop beta_dcm",
        TIME: "duration_margin freeze touchdown_delay double_support push_carry sampling_time "
        "tail_sampling_time mpc_step standing_carry standing_horizon",
        LENGTH: "push_threshold",
        SWING: "swing_acceleration",
        (("length", -2.0), ("time", 4.0)): "beta_dcm_acceleration",
        (("trunk_acceleration", -2.0),): "beta_trunk",
        (("trunk_acceleration", -1.0), ("trunk_angle", -1.0)): "beta_trunk_rate",
        (("trunk_angle", -2.0),): "beta_trunk_angle beta_trunk_limit",
        (("mass", 1.0), ("length", 1.0)): "trunk_gravity",
        FOOT_LENGTH: "cop_margin_x",
        FOOT_WIDTH: "cop_margin_y",
        (("time", 2.0),): "mpc_velocity",
        (("time", 6.0),): "mpc_jerk",
        STIFFNESS: "upright_stiffness",
        DAMPING: "upright_damping",
    },
    "limits": {
        LENGTH: "length_min length_max width_max",
        SWING_TIME: "duration_min duration_max",
        FOOT_LENGTH: "cop_x_max",
        FOOT_WIDTH: "width_min cop_y_max",
        (("trunk_acceleration", 1.0),): "trunk_acceleration_max",
    },
    "gait": {
        LENGTH: "apex height_drop",
        TIME: "landing_delay commit early settled height_lead height_time",
        MASS: "early_load forced_load",
        (("length", 1.0), ("time", -1.0)): "descent",
        (("leg", 1.0),): "reach",
    },
    "gains": {
        SWING: "swing_max",
        STIFFNESS: "stance_kp swing_kp swing_turn_kp pelvis_kp heading_kp height_kp",
        DAMPING: "stance_kd swing_kd swing_turn_kd pelvis_kd heading_kd height_kd",
    },
    "bounds": {
        FOOT_LENGTH: "cop_x_max yaw_friction",
        FOOT_WIDTH: "cop_y_max",
        MASS: "force_min",
        (("waist", 2.0),): "waist_price",
        (("lean", 2.0),): "pelvis_price",
        (("time", 4.0),): "heading_price swing_turn_price",
    },
}
UNITS: Mapping[str, Mapping[str, Unit]] = {
    section: {name: unit for unit, names in units.items() for name in names.split()}
    for section, units in _BY_UNIT.items()
}


@dataclass(frozen=True)
class Scale:
    """Ratios of a robot's quantities to those of the robot that a preset was made for.

    Two robots of which one is the other made larger move alike under Froude's similarity (`model/robot`).
    Other lengths are a robot's own, those of foot and leg. So is what leaning can do for it: to turn the
    trunk by 1 rad/s^2 moves the CoM by j / (m h) m/s^2, which differs by a factor of ten between robots of
    one height, and whole-body control prices a deviation by what the CoM is spared. And so is how soon a foot
    can be elsewhere: hips of the torque tau, whose leg of length l has the inertia i about them, give the
    sole tau l / i m/s^2 at most, and a step takes as long as the root of its length over that.
    """

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
        """Ratio of sqrt(h / g)."""
        return self.length**0.5

    def factor(self, unit: Unit) -> float:
        """The factor of a number of a unit."""
        return math.prod(getattr(self, name) ** power for name, power in unit)


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
    variants = {}
    for variant, changed in preset.variants.items():
        parts = {name: _scaled(part, name, scale) for name, part in changed.get("biped", {}).items()}
        planner_own = {name: value for name, value in changed.items() if name != "biped"}
        variants[variant] = _scaled(planner_own, "planner", scale) | ({"biped": parts} if parts else {})
    robot = {
        name: {**_scaled(part, name, scale), **own.get(name, {})} for name, part in preset.robot().items()
    }
    return PresetFile(NEUTRAL, plain, variants, robot)


def _scaled(values: Mapping[str, Any], section: str, scale: Scale) -> dict[str, Any]:
    """The values of a section; floats rounded to six digits, others as they are."""
    units = UNITS[section]
    return {
        name: float(f"{value * scale.factor(units[name]):.6g}") if name in units else value
        for name, value in values.items()
    }
