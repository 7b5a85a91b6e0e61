"""Robot files: what has to be known of somebody else's model before it can walk here.

    {"format": "push-recovery robot", "format_version": 1,
     "name": "g1",
     "model": "PACKAGE/PATH/g1.xml",                       in a Python package, or a path from this file
     "written_in": "/home/me/robots",                      folder of such paths where none is beside this file
     "pelvis": "pelvis", "trunk": "torso_link",            bodies
     "legs": [["left_hip_pitch_joint", ...], [...]],       from hip to sole, the fourth is the knee
     "bend": [-0.3, 0, 0, 0.6, -0.3, 0],                   of the left leg, near which postures lie [rad]
     "waist": ["waist_pitch_joint", "waist_roll_joint"],   or null
     "held": {"waist_yaw_joint": 0.0},                     servos keep these angles [rad]
     "fixed": {"left_wrist_roll_joint": 0.0},              these are no joints here at all
     "soles": [{"centre": [0.04, 0, -0.03], "size": [0.17, 0.06], "turn": [1, 0, 0, 0]}, {...}],
     "motors": {"*_hip_pitch_joint": {"torque": 88, "speed": 32, "armature": 0.01}},
     "com_height": 0.6, "preset": "g1", "about": "where the motors' numbers come from"}

A sole lies in the body of its leg's last joint: its centre there [m], its length and width [m] and, where its
axes (x forward, z up) are not the body's, the quaternion that turns them. Names of motors may have wildcards;
the first that fits counts, and what it leaves out is the model's.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError, UnknownNameError, is_finite_number
from ...controllers.files import is_file, read_file, write_text
from ...controllers.model.robot import LEG_JOINTS, BodyPlan
from ...controllers.validation import parse_json
from .model_files import PACKAGES

FORMAT, FORMAT_VERSION = "push-recovery robot", 1
SIDES = ("left", "right")
KEYS = ("format", "format_version", "name", "model", "pelvis", "trunk", "legs", "bend", "waist", "held",
        "fixed", "soles", "motors", "com_height", "preset", "about", "written_in")  # fmt: skip
Angles = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Sole:
    """Rectangle under a foot, in the axes of the foot's body."""

    centre: tuple[float, ...]  # (3,) [m]
    size: tuple[float, ...]  # length, width [m]
    turn: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)  # quaternion of the sole's axes: x forward, z up


@dataclass(frozen=True)
class Motor:
    """A joint's motor; what is None is taken from the model."""

    torque: float | None = None  # largest, both ways [N m]
    speed: float | None = None  # without load [rad/s]; without a number the motor has no such limit
    armature: float | None = None  # [kg m^2]


@dataclass(frozen=True)
class RobotFile:
    """The content of a robot file."""

    name: str
    model: str  # in a package or, from a file of one's own, an absolute path
    plan: BodyPlan
    soles: tuple[Sole, Sole]
    motors: tuple[tuple[str, Motor], ...]
    fixed: Angles
    com_height: float  # at which it walks [m]
    preset: str
    about: str = ""

    def unfixed(self, kept: Collection[str] = ()) -> RobotFile:
        """The same robot, whose fixed joints are held ones, but for some that are `kept` as they are."""
        held = tuple((name, angle) for name, angle in self.fixed if name not in kept)
        fixed = tuple((name, angle) for name, angle in self.fixed if name in kept)
        return replace(self, plan=replace(self.plan, held=(*self.plan.held, *held)), fixed=fixed)


def make_plan(
    pelvis: str, trunk: str, legs: Any, waist: Any = (None, None), bend: Any = (0.0,) * 6, held: Any = ()
) -> BodyPlan:
    """The body plan of an adapted robot, whose soles have this package's names."""
    return BodyPlan(
        pelvis, trunk, (tuple(legs[0]), tuple(legs[1])), soles=("left_sole", "right_sole"),
        loads=("left_load", "right_load"), sole_boxes=("left_foot_sole", "right_foot_sole"),
        waist=(waist[0], waist[1]), bend=tuple(float(angle) for angle in bend), held=tuple(held),
    )  # fmt: skip


def read_robot_file(path: str | Path) -> RobotFile:
    """The robot of a file.

    Raises:
        InvalidValueError: a file that cannot be read, of another format, or with an impossible value.
        UnknownNameError: a key that robot files do not have.
    """
    what = f"robot file {str(path)!r}"
    try:
        content = parse_json(what, read_file(path))
    except OSError as error:
        raise InvalidValueError(f"cannot read {what}: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InvalidValueError(f"{what} is none: its 'format' is not {FORMAT!r}")
    if content.get("format_version") != FORMAT_VERSION:
        raise InvalidValueError(
            f"{what} has format_version {content.get('format_version')!r}; this version reads "
            f"{FORMAT_VERSION}"
        )
    for key in content:
        if key not in KEYS:
            raise UnknownNameError(f"key of {what}", key, KEYS)
    try:
        return _parsed(content, [Path(path).absolute().parent, Path(path).resolve().parent])
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InvalidValueError(
            f"{what} is not complete or has a value of another kind: {error!r}"
        ) from error


def _parsed(content: dict[str, Any], folders: list[Path]) -> RobotFile:
    """The robot of a file's content; of two folders the first has the file, the other what it links to."""
    left, right = (_sole(sole) for sole in content["soles"])
    preset = _name(content["preset"])
    if "written_in" in content:
        folders.insert(1, Path(_name(content["written_in"])))
    legs = [[_name(joint) for joint in leg] for leg in content["legs"]]
    waist = [None if joint is None else _name(joint) for joint in content["waist"]]
    plan = make_plan(
        _name(content["pelvis"]), _name(content["trunk"]), legs, waist,
        _numbers(content["bend"], LEG_JOINTS), _angles(content.get("held", {})),
    )  # fmt: skip
    return RobotFile(
        name=_name(content["name"]),
        model=_place(_name(content["model"]), folders),
        plan=plan,
        soles=(left, right),
        motors=tuple((name, Motor(**_motor(motor))) for name, motor in content["motors"].items()),
        fixed=_angles(content.get("fixed", {})),
        com_height=_positive(content["com_height"]),
        preset=_place(preset, folders) if preset.endswith(".json") else preset,
        about=str(content.get("about", "")),
    )


def _sole(content: dict[str, Any]) -> Sole:
    """A sole; raises an error where it has no area or no attitude."""
    turn = _numbers(content.get("turn", Sole.turn), 4)
    if not any(turn):
        raise ValueError("the quaternion 'turn' of a sole must not be 0")
    length, width = map(_positive, content["size"])
    if unknown := set(content) - {"centre", "size", "turn"}:
        raise ValueError(f"a sole has centre, size and turn, got {sorted(unknown)}")
    return Sole(_numbers(content["centre"], 3), (length, width), turn)


def _name(value: object) -> str:
    """A name; raises TypeError for another thing."""
    if not (isinstance(value, str) and value):
        raise TypeError(f"a name must be text, got {value!r:.60}")
    return value


def _numbers(values: Any, n: int) -> tuple[float, ...]:
    """Finite numbers; raises ValueError for others, or another count of them."""
    if not (isinstance(values, list | tuple) and len(values) == n and all(map(is_finite_number, values))):
        raise ValueError(f"{n} finite numbers are needed, got {values!r:.60}")
    return tuple(map(float, values))


def _positive(value: Any) -> float:
    """A finite number above 0; raises ValueError for another one."""
    if not (is_finite_number(value) and value > 0.0):
        raise ValueError(f"a number above 0 is needed, got {value!r:.60}")
    return float(value)


def _motor(content: dict[str, Any]) -> dict[str, float]:
    """Fields of a motor; raises ValueError for a number that is not above 0."""
    return {field: _positive(value) for field, value in content.items() if value is not None}


def _angles(content: dict[str, Any]) -> Angles:
    """Angles by joint."""
    return tuple((name, _numbers([angle], 1)[0]) for name, angle in content.items())


def _place(name: str, folders: Sequence[Path]) -> str:
    """The absolute path of a file, from the first of some folders where it lies; PACKAGE/PATH as it is.

    Links are not resolved, since what a model names lies beside the link. A step back, `..`, is one in the
    text of the path and, where there is no such file, one from where a link leads.
    """
    if name.partition("/")[0] in PACKAGES:
        return name
    paths = [os.path.join(folder, name) for folder in folders]
    found = (path for way in paths for path in (os.path.normpath(way), way) if is_file(path))
    return next(found, paths[0])


def write_robot_file(path: Path, robot: RobotFile, preset: str) -> None:
    """Write the robot whole or not at all; `preset` is what the file calls its preset."""
    plan, folder = robot.plan, path.absolute().parent
    inside = robot.model.partition("/")[0] in PACKAGES
    model = robot.model if inside else os.path.relpath(robot.model, folder)  # folders may move together
    content = {
        "format": FORMAT, "format_version": FORMAT_VERSION, "name": robot.name, "model": model,
        **({} if inside else {"written_in": str(folder)}),
        "pelvis": plan.pelvis, "trunk": plan.trunk, "legs": plan.legs, "bend": plan.bend,
        "waist": plan.waist, "held": dict(plan.held), "fixed": dict(robot.fixed),
        "soles": [asdict(sole) for sole in robot.soles],
        "motors": {name: {key: value for key, value in asdict(motor).items() if value is not None}
                   for name, motor in robot.motors},
        "com_height": robot.com_height, "preset": preset, "about": robot.about,
    }  # fmt: skip
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
