"""What a learned policy was made for, and what a residual corrects."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InvalidValueError
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..policies.arms import make_policy
from ..policies.interface import Policy
from ..policies.residual import check_residual_scale
from ..policies.residual_gate import check_gate
from ..policies.two_stage import TwoStagePolicy
from ..settings.planner_config import PlannerConfig
from .inputs import OBSERVATION, check_inputs


@dataclass(frozen=True)
class ResidualBase:
    """What a residual policy corrects."""

    policy: str  # name for make_policy
    preset: str  # planner preset
    scale: tuple[float, ...]  # (7,) in action units
    config: PlannerConfig | None = None  # the planner's weights in training, whatever the preset says today
    gate: tuple[float, float] | None = None  # (shut, open) of `ResidualGate` [m]; None: always open

    def __post_init__(self) -> None:
        if not (isinstance(self.policy, str) and isinstance(self.preset, str)):
            raise InvalidValueError(
                f"a residual's policy and preset must be names, got {self.policy!r}, {self.preset!r}"
            )
        object.__setattr__(self, "scale", tuple(check_residual_scale(self.scale).tolist()))
        object.__setattr__(self, "gate", None if self.gate is None else check_gate(self.gate))

    def make(self, robot: RobotModel, limits: GaitLimits) -> Policy:
        """The policy below, with the weights that it had in training."""
        policy = make_policy(self.policy, robot, limits, self.preset)
        if isinstance(policy, TwoStagePolicy) and self.config is not None:
            return TwoStagePolicy(
                robot, limits, self.config, adapt=self.policy != "passive", name=self.policy
            )
        return policy


@dataclass(frozen=True)
class PolicyDescription:
    """What a policy was made for; stored beside its weights."""

    env_id: str
    robot: RobotModel
    limits: GaitLimits
    residual: ResidualBase | None = None  # None: the network's output is the action
    hold: int = 1  # planning periods for which a learned action is held
    inputs: tuple[str, ...] = (OBSERVATION,)  # of the network, see `NetworkInputs`

    def __post_init__(self) -> None:
        if not isinstance(self.env_id, str):
            raise InvalidValueError(f"env_id must be a name, got {self.env_id!r}")
        if isinstance(self.hold, bool) or not isinstance(self.hold, int) or self.hold < 1:
            raise InvalidValueError(
                f"hold must be a whole number of planning periods >= 1, got {self.hold!r}"
            )
        object.__setattr__(self, "inputs", check_inputs(self.inputs, self.residual is not None))
