"""Push recovery for bipeds: Gymnasium environments, a two-stage planner, and a fair score.

Importing registers the environments, loads nothing but Gymnasium, and changes nothing else in the process;
each name below is loaded when it is first used.
"""
# The packages lie beside src and are mapped by package-dir, which pyright does not read:
# pyright: reportMissingImports=false

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register

if TYPE_CHECKING:
    from .controllers.model.robot import BodyPlan, RobotModel
    from .controllers.settings import PlannerConfig
    from .envs.robots.description import RobotDescription, register_robot
    from .envs.scenario.distribution import PushDistribution
    from .envs.scenario.model_errors import ModelErrors
    from .envs.scenario.push import GaitEvent, Kick, Push
    from .envs.scenario.scenario import Command, CommandChange, Scenario
    from .envs.wrappers import ActionHold, ResidualAction
    from .eval.api import compare, evaluate, frontier, rollout
    from .eval.output.processes import ray_workers
    from .eval.record.record import record
    from .eval.record.words import describe
    from .eval.rollout.load_policy import load_policy, make_policy
    from .eval.score.suites import get_suite

__version__ = "0.1.0"

__all__ = [
    "ActionHold", "BodyPlan", "Command", "CommandChange", "GaitEvent", "Kick", "ModelErrors", "PlannerConfig",
    "Push", "PushDistribution", "ResidualAction", "RobotDescription", "RobotModel", "Scenario", "__version__",
    "compare", "describe", "evaluate", "frontier", "get_suite", "load_policy", "make_policy", "ray_workers",
    "record", "register_robot", "rollout",
]  # fmt: skip

_MODULES = {
    "ActionHold": "envs.wrappers",
    "BodyPlan": "controllers.model.robot",
    "Command": "envs.scenario.scenario",
    "CommandChange": "envs.scenario.scenario",
    "GaitEvent": "envs.scenario.push",
    "Kick": "envs.scenario.push",
    "ModelErrors": "envs.scenario.model_errors",
    "PlannerConfig": "controllers.settings",
    "Push": "envs.scenario.push",
    "PushDistribution": "envs.scenario.distribution",
    "ResidualAction": "envs.wrappers",
    "RobotDescription": "envs.robots.description",
    "RobotModel": "controllers.model.robot",
    "Scenario": "envs.scenario.scenario",
    "compare": "eval.api",
    "describe": "eval.record.words",
    "evaluate": "eval.api",
    "frontier": "eval.api",
    "get_suite": "eval.score.suites",
    "load_policy": "eval.rollout.load_policy",
    "make_policy": "eval.rollout.load_policy",
    "ray_workers": "eval.output.processes",
    "record": "eval.record.record",
    "register_robot": "envs.robots.description",
    "rollout": "eval.api",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_MODULES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


register(
    id="PushRecovery/Pendulum-v0",
    entry_point="push_recovery.envs.pendulum.env:PendulumEnv",
    vector_entry_point="push_recovery.envs.pendulum.env:make_pendulum_vector",
)
_FORMS = {  # of a robot's environment: what follows its name -> one robot, n robots
    "": ("biped.env:BipedEnv", "biped.env:make_biped_vector"),
    "Residual": ("wrappers:make_biped_residual", "wrappers:make_biped_residual_vector"),
    "Joint": ("joint.env:BipedJointEnv", "joint.env:make_biped_joint_vector"),
    "FullBody": ("joint.full_body:FullBodyEnv", "joint.full_body:make_full_body_vector"),
    "JointResidual": ("joint.env:BipedJointResidualEnv", "joint.env:make_biped_joint_residual_vector"),
}
_ROBOTS = ("Biped", "G1", "T1", "JVRC1", "Apollo", "Berkeley", "OP3")
for _name in _ROBOTS:  # the models of all but the first come with the extra `robots`
    for _form, (_single, _vector) in _FORMS.items():
        register(
            id=f"PushRecovery/{_name}{_form}-v0",
            entry_point=f"push_recovery.envs.{_single}",
            vector_entry_point=f"push_recovery.envs.{_vector}",
            kwargs={} if _name == "Biped" else {"robot": _name.lower()},
        )
