"""What is varied: an arm with other weights, on another robot, at another rate, with a worse measurement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from ....controllers.model.gait_box import GaitLimits
from ....controllers.model.nominal_gait import NominalGait, nominal_gait
from ....controllers.model.robot import RobotModel
from ....controllers.policies.arms import make_policy
from ....controllers.policies.interface import Policy
from ....controllers.policies.two_stage import TwoStagePolicy
from ....controllers.settings.presets import preset_config
from .batch import Plant
from .sensor import Measurement

Pairs = tuple[tuple[str, Any], ...]


def pairs(values: Mapping[str, Any]) -> Pairs:
    """A mapping as sorted pairs, so that it can be part of a key."""
    return tuple(sorted(values.items()))


@dataclass(frozen=True)
class Variant:
    """A policy on a pendulum; equal variants give equal numbers, whatever they are called."""

    label: str  # for people
    policy: str = "two-stage"  # arm of `make_policy`
    planner: Pairs = ()  # fields of PlannerConfig that differ from the arm's
    robot: Pairs = ()  # fields of RobotModel that differ from the paper's
    control_hz: float = 100.0  # [Hz]
    preset: str = "default"
    dcm_noise: float = 0.0  # [m]
    delay: int = 0  # planning periods

    def identity(self) -> dict[str, Any]:
        """All that decides the numbers, as JSON."""
        return {
            "policy": self.policy,
            "planner": dict(self.planner),
            "robot": dict(self.robot),
            "control_hz": self.control_hz,
            "preset": self.preset,
            "dcm_noise": self.dcm_noise,
            "delay": self.delay,
        }

    @property
    def robot_model(self) -> RobotModel:
        """The paper's robot with what differs."""
        return replace(RobotModel(), **dict(self.robot))

    @property
    def measurement(self) -> Measurement:
        """Errors of what the policy sees."""
        return Measurement(self.dcm_noise, self.delay)

    @property
    def jerk_form(self) -> bool:
        """Whether stage 2 runs in the paper's form, which is solved one robot at a time and so costs most."""
        config = getattr(built(self)[0], "config", None)
        return config is not None and config.form == "jerk" and (config.use_cop or config.use_trunk)

    def gait(self, vx: float) -> NominalGait:
        """Nominal gait at a commanded speed [m/s]."""
        robot = self.robot_model
        delay = preset_config(self.preset).touchdown_delay
        return nominal_gait(robot, GaitLimits.of(robot), (vx, 0.0), delay)


@cache
def built(variant: Variant) -> tuple[Policy, Plant]:
    """Policy and pendulum of a variant, made once in a process."""
    robot = variant.robot_model
    limits = GaitLimits.of(robot)
    plant = Plant(robot, limits, variant.preset, variant.control_hz)
    arm = make_policy(variant.policy, robot, limits, variant.preset)
    if not isinstance(arm, TwoStagePolicy):
        return arm, plant
    config = replace(arm.config, first_interval_min=1.0 / variant.control_hz)
    config = replace(config, **dict(variant.planner))
    adapt = variant.policy != "passive"
    return TwoStagePolicy(robot, limits, config, adapt=adapt, name=variant.policy), plant
