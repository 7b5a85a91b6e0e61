"""Dimensions of a search with bounds and units, points in them, and the fields of planner and biped.

Left out are weights that only scale a whole cost (alpha_step, beta_cop, com_price), what another field
implies (freeze, which is the gait machine's commit), hardware, numerical constants and switches.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.policies.two_stage import POLICY_NAMES, TwoStagePolicy, make_policy
from ...controllers.settings import PlannerConfig
from ...controllers.validation import require_choice

DIGITS = 6  # significant digits of a value: short in a file, far finer than what matters
Settings = dict[str, dict[str, float]]  # group -> field -> value


@dataclass(frozen=True)
class Dimension:
    """One field; a point's coordinate counts units from where the search starts.

    The unit is one standard deviation of the first generation: a factor on the logarithmic scale, a
    difference on the linear one.
    """

    group: str
    name: str
    low: float
    high: float
    unit: float
    scale: Literal["linear", "log"] = "linear"

    @property
    def label(self) -> str:
        """Group and name, as options and tables call it."""
        return f"{self.group}.{self.name}"

    def times(self, factor: float) -> Self:
        """The same dimension of a robot whose value is so many times as large; the unit of a factor stays."""
        unit = self.unit if self.scale == "log" else self.unit * factor
        return replace(self, low=self.low * factor, high=self.high * factor, unit=unit)

    def coordinate(self, value: float, start: float) -> float:
        """Units from `start` to `value`."""
        if self.scale == "log":
            return math.log(value / start) / math.log(self.unit)
        return (value - start) / self.unit

    def value(self, coordinate: float, start: float) -> float:
        """Inverse of `coordinate`, within the bounds and rounded to DIGITS."""
        exact = start * self.unit**coordinate if self.scale == "log" else start + self.unit * coordinate
        return float(f"{min(max(exact, self.low), self.high):.{DIGITS}g}")


@dataclass(frozen=True)
class Space:
    """Dimensions and the values at which the search starts, which are the origin."""

    dimensions: tuple[Dimension, ...]
    start: tuple[float, ...]

    def __post_init__(self) -> None:
        for dimension, value in zip(self.dimensions, self.start, strict=True):
            if not dimension.low <= value <= dimension.high:
                raise InvalidValueError(
                    f"{dimension.label} must start in [{dimension.low:g}, {dimension.high:g}], got {value:g}"
                )

    @classmethod
    def at(cls, dimensions: Sequence[Dimension], start: Mapping[str, Mapping[str, float]]) -> Self:
        """A space that starts at some settings."""
        return cls(tuple(dimensions), tuple(float(start[d.group][d.name]) for d in dimensions))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Least and greatest coordinates, (n, 2)."""
        pairs = zip(self.dimensions, self.start, strict=True)
        return np.array([[d.coordinate(d.low, s), d.coordinate(d.high, s)] for d, s in pairs])

    def settings(self, point: Sequence[float] | NDArray[np.float64]) -> Settings:
        """The values of a point (n,), by group."""
        out: Settings = {}
        for dimension, start, coordinate in zip(self.dimensions, self.start, point, strict=True):
            out.setdefault(dimension.group, {})[dimension.name] = dimension.value(float(coordinate), start)
        return out

    def point(self, settings: Mapping[str, Mapping[str, float]]) -> NDArray[np.float64]:
        """Inverse of `settings`, (n,)."""
        pairs = zip(self.dimensions, self.start, strict=True)
        return np.array([d.coordinate(settings[d.group][d.name], s) for d, s in pairs])

    def to_dict(self) -> dict[str, dict[str, float | str]]:
        """Label -> start, bounds, unit and scale."""
        return {
            d.label: {"start": s, "low": d.low, "high": d.high, "unit": d.unit, "scale": d.scale}
            for d, s in zip(self.dimensions, self.start, strict=True)
        }


def select(dimensions: Sequence[Dimension], only: Sequence[str]) -> tuple[Dimension, ...]:
    """The dimensions whose label or group is named; all of them where nothing is."""
    labels = [dimension.label for dimension in dimensions]
    groups = sorted({dimension.group for dimension in dimensions})
    for name in only:
        if name not in labels and name not in groups:
            raise UnknownNameError("field to tune", name, [*groups, *labels])
    return tuple(d for d in dimensions if not only or d.label in only or d.group in only)


UNTUNED = ("passive", "stage-1-paper", "two-stage-paper", "random")  # nothing of theirs is free
TUNED = tuple(name for name in POLICY_NAMES if name not in UNTUNED)


_planner, _limit, _gait = (partial(Dimension, group) for group in ("planner", "limits", "gait"))


def _weight(name: str, unit: float = 2.0, low: float = 1e-6) -> Dimension:
    return Dimension("planner", name, low, 1e9, unit, "log")


def _gain(name: str, start: float) -> Dimension:
    return Dimension("gains", name, start / 8.0, start * 8.0, 1.2, "log")


def _price(name: str) -> Dimension:
    return Dimension("bounds", name, 1e-5, 10.0, 1.4, "log")


WEIGHTS = (_weight("alpha_duration", 1.5), _weight("alpha_offset"))  # of eq. 3; the former prices T
STAGE_1 = (
    _planner("duration_margin", 0.0, 0.1, 0.01),  # [s]
    _planner("push_carry", 0.0, 0.2, 0.03),  # [s]
    _planner("push_threshold", 0.0, 0.4, 0.03),  # [m]
)
STAGE_2 = (_weight("beta_dcm"), _planner("sampling_time", 0.04, 0.1, 0.005))  # [s]
COP = (
    _planner("cop_margin_x", 0.0, 0.06, 0.004),  # [m]
    _planner("cop_margin_y", 0.0, 0.03, 0.003),  # [m]
)
TRUNK = (
    *map(_weight, ("beta_trunk", "beta_trunk_rate", "beta_trunk_angle", "beta_trunk_limit")),
    _planner("trunk_gravity", 0.0, 150.0, 10.0),  # [N m]
    _planner("tail_sampling_time", 0.03, 0.12, 0.006),  # [s]
)
MPC = (_weight("mpc_velocity"), _weight("mpc_jerk", 4.0, 1e-12), _weight("mpc_step"))
UPRIGHT = (
    Dimension("planner", "upright_stiffness", 2.0, 200.0, 1.3, "log"),  # [1/s^2]
    Dimension("planner", "upright_damping", 1.0, 60.0, 1.3, "log"),  # [1/s]
)


ROBOT = (
    _planner("touchdown_delay", 0.0, 0.03, 0.003),  # the robot's timing [s]
    Dimension("planner", "swing_acceleration", 40.0, 1000.0, 1.1, "log"),  # likewise [m/s^2]
    _limit("length_min", -0.55, -0.25, 0.02),  # [m]
    _limit("length_max", 0.25, 0.55, 0.02),
    _limit("width_min", 0.104, 0.16, 0.006),  # the feet are 0.1 m wide
    _limit("width_max", 0.3, 0.7, 0.02),
    _limit("duration_min", 0.08, 0.35, 0.015),  # [s]
    _limit("duration_max", 0.4, 0.9, 0.03),
    _gait("apex", 0.02, 0.12, 0.006),  # [m]
    _gait("landing_delay", 0.0, 0.03, 0.003),  # [s]
    _gait("commit", 0.0, 0.12, 0.01),
    _gait("early", 0.0, 0.03, 0.003),
    Dimension("gait", "early_load", 5.0, 100.0, 1.3, "log"),  # [N]
    Dimension("gait", "forced_load", 50.0, 500.0, 1.3, "log"),
    _gait("forced_phase", 0.3, 0.95, 0.06),
    Dimension("gait", "descent", 0.1, 1.0, 1.3, "log"),  # [m/s]
    _gait("reach", 0.62, 0.705, 0.008),  # thigh and shank are 0.72 m [m]
    _gait("height_drop", 0.0, 0.25, 0.02),
    _gait("height_lead", 0.0, 0.1, 0.01),  # [s]
    _gait("height_time", 0.02, 0.2, 0.01),
    _gain("stance_kp", 300.0), _gain("stance_kd", 35.0), _gain("swing_kp", 329.0), _gain("swing_kd", 36.3),
    _gain("swing_max", 120.0), _gain("swing_turn_kp", 400.0), _gain("swing_turn_kd", 40.0),
    _gain("pelvis_kp", 108.0), _gain("pelvis_kd", 20.8), _gain("heading_kp", 205.0),
    _gain("heading_kd", 28.6), _gain("height_kp", 900.0), _gain("height_kd", 60.0),
    Dimension("bounds", "cop_x_max", 0.05, 0.1, 0.004),  # [m]
    Dimension("bounds", "cop_y_max", 0.02, 0.05, 0.002),
    Dimension("bounds", "yaw_friction", 0.01, 0.06, 0.003),
    Dimension("bounds", "friction", 0.5, 0.9, 0.03),
    Dimension("bounds", "force_min", 10.0, 300.0, 1.3, "log"),  # [N]
    _price("height_price"), _price("pelvis_price"), _price("heading_price"), _price("swing_price"),
    _price("swing_turn_price"), _price("waist_price"),
)  # fmt: skip

# Of a variant that never changes its step time, which is the middle of the box: 5 ms above the least [s]
FIXED_DURATION = _limit("duration_max", 0.12, 0.9, 0.01)


def robot_dimensions(policy: str) -> tuple[Dimension, ...]:
    """Fields of gait box, gait machine and whole-body control; a step time that is fixed is one field."""
    config = _planner_config(policy)
    if config.adapt_duration and config.foothold == "optimal":
        return ROBOT
    return *(d for d in ROBOT if d.name not in ("duration_min", "duration_max")), FIXED_DURATION


def _planner_config(policy: str) -> PlannerConfig:
    require_choice("policy to tune", policy, TUNED)
    planner = make_policy(policy)
    assert isinstance(planner, TwoStagePolicy)  # noqa: S101
    return planner.config


OF_TRUNK = {*(dimension.name for dimension in TRUNK), "waist_price"}


def planner_dimensions(policy: str) -> tuple[Dimension, ...]:
    """The fields of PlannerConfig that a variant of the planner uses; other policies are refused."""
    config = _planner_config(policy)
    mpc = config.foothold == "linear_mpc"
    weights = WEIGHTS if config.adapt_duration else WEIGHTS[1:]
    return (
        (weights if config.foothold == "optimal" else MPC if mpc else ())
        + STAGE_1
        + (STAGE_2 if config.use_cop or config.use_trunk else ())
        + (COP if config.use_cop or mpc else ())
        + (TRUNK if config.use_trunk else UPRIGHT)
    )
