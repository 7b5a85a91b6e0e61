"""A robot file and its preset from a model: guessed, derived, written, and told for review."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.model.capturability import max_recoverable_force
from ...controllers.settings.presets import PresetFile
from ...envs.biped.robots.adapted.adapt import description_of
from ...envs.biped.robots.adapted.joints import largest_torques
from ...envs.biped.robots.adapted.model_place import PACKAGES, read_model
from ...envs.biped.robots.adapted.robot_file import Motor, RobotFile, write_robot_file
from ...envs.biped.robots.adapted.size import scaled_settings
from ...envs.biped.robots.compiled_robot import CompiledRobot, compiled_robot
from ...envs.biped.settings import BipedSettings
from .guess_plan import guess_plan
from .guess_sole import guess_soles
from .reach import reachable_steps, standing_height
from .skeleton import read_skeleton

PUSH = 0.1  # of F* [s]
DIRECTIONS = 8
PROVISIONAL = 1.0  # CoM height before it is known [m]
STEPS = "length_min", "length_max", "width_max"


@dataclass(frozen=True)
class NewRobot:
    """A robot of a model."""

    file: RobotFile
    preset: PresetFile
    body: CompiledRobot

    @property
    def limits(self) -> list[float]:
        """F* of its own box of steps by direction, counter-clockwise from forward [N]."""
        box = BipedSettings().changed(self.preset.robot()).of_robot(self.body.robot).limits
        angles = [2.0 * math.pi * k / DIRECTIONS for k in range(DIRECTIONS)]
        return [max_recoverable_force(self.body.robot, psi, PUSH, limits=box) for psi in angles]


def new_robot(model: str, name: str) -> NewRobot:
    """The robot of a model, MJCF or URDF.

    Args:
        model: its file, or PACKAGE/PATH.
        name: of the robot.

    Raises:
        InvalidValueError: no two legs, no feet, or no posture to stand in; joints without a largest torque.
    """
    model = model if model.partition("/")[0] in PACKAGES else str(Path(model).resolve())
    guess = guess_plan(read_skeleton(model))
    soles = guess_soles(model, (guess.plan.legs[0][-1], guess.plan.legs[1][-1]))
    file = RobotFile(
        name, model, guess.plan, soles, _motors(model, [joint for joint, _ in guess.fixed]), guess.fixed,
        PROVISIONAL, "biped", "guessed by push-recovery robot new; no motor has a speed without load",
    )  # fmt: skip
    height = standing_height(description_of(file))
    file = replace(file, com_height=height)
    body = compiled_robot(description_of(file))
    scaled = scaled_settings(body).robot()["limits"]
    reach = reachable_steps(description_of(file), height)
    box = {step: min(scaled[step], reach[step], key=abs) for step in STEPS}
    preset = scaled_settings(body, {"limits": box})
    return NewRobot(
        file, replace(preset, found={"by": "push-recovery robot new", "robot": asdict(body.robot)}), body
    )


def _motors(model: str, fixed: list[str]) -> tuple[tuple[str, Motor], ...]:
    """Largest torques of all joints but the fixed ones.

    Raises:
        InvalidValueError: the model does not tell some.
    """
    spec = read_model(model)
    torques = largest_torques(spec)
    joints = [joint.name for joint in spec.joints if joint.name not in fixed]
    free = {joint.name for joint in spec.joints if joint.type.name == "mjJNT_FREE"}
    if unknown := [name for name in joints if name not in torques and name not in free]:
        raise InvalidValueError(
            f"the model {model!r} does not tell the largest torque of {', '.join(unknown)}: give its joints "
            "an actuatorfrcrange, or its actuators a forcerange"
        )
    return tuple((name, Motor(torque=torques[name])) for name in joints if name not in free)


def save(robot: NewRobot, out: Path) -> tuple[Path, Path]:
    """Write NAME.robot.json and NAME.preset.json into a folder; returns both."""
    paths = out / f"{robot.file.name}.robot.json", out / f"{robot.file.name}.preset.json"
    robot.preset.save(paths[1])
    write_robot_file(paths[0], robot.file, paths[1].name)
    return paths


def summary(robot: NewRobot) -> dict[str, Any]:
    """What was guessed and derived, in plain JSON types."""
    plan, model = robot.file.plan, robot.body.robot
    return {
        "name": robot.file.name, "pelvis": plan.pelvis, "trunk": plan.trunk, "left_leg": plan.legs[0],
        "right_leg": plan.legs[1], "waist": plan.waist, "held": dict(plan.held),
        "fixed": dict(robot.file.fixed), "soles": [asdict(sole) for sole in robot.file.soles],
        "robot": asdict(model), "limits": robot.preset.robot()["limits"], "limit_N": robot.limits,
    }  # fmt: skip
