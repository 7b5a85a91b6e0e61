"""The analytic policies by name: the two-stage planner, its ablated arms, the paper's and the baselines."""

from __future__ import annotations

from ..errors import UnknownNameError
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..settings.arms import ARMS, PAPER_SUFFIX
from ..settings.presets import load_preset, named_preset
from .random import RandomPolicy
from .two_stage import TwoStagePolicy

POLICY_NAMES = (*ARMS, "random")


def make_policy(
    name: str,
    robot: RobotModel | None = None,
    limits: GaitLimits | None = None,
    preset: str = "default",
) -> TwoStagePolicy | RandomPolicy:
    """Build an analytic policy by name.

    The arms differ in what they may use. Their weights are the preset's, except for arms with gains of their
    own (`arms` of a preset), and the two `-paper` arms, which put the paper's Table II into it.

    Args:
        name: one of POLICY_NAMES.
        robot: physical constants; the paper's by default.
        limits: step box, CoP and trunk bounds; the paper's for the robot by default.
        preset: by name or file.

    Raises:
        UnknownNameError: for a name that is not in POLICY_NAMES or an unknown preset; lists the valid ones.
        InvalidValueError: a preset file that cannot be read.
    """
    if name not in POLICY_NAMES:
        raise UnknownNameError("policy", name, POLICY_NAMES)
    config = load_preset(preset).config(name)
    if name == "random":
        return RandomPolicy()
    if name.endswith(PAPER_SUFFIX):
        config = config.replace(**named_preset("paper").planner)
    config = config.replace(**ARMS[name].settings)
    return TwoStagePolicy(robot, limits, config, adapt=name != "passive", name=name)
