"""`push-recovery robot new`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from ....controllers.errors import InvalidValueError
from ..options import JsonOption

MODEL_TEXT = "MJCF or URDF of the robot: a file, or PACKAGE/PATH in a package of the extra robots."


@dataclass(frozen=True, kw_only=True)
class RobotCommand(JsonOption):
    """Write a robot file and a preset from a model; --env NAME.robot.json of other commands takes it."""

    action: Positional[Literal["new"]]
    """new: guess the parts of a robot and derive its sizes."""
    model: Annotated[Positional[str], arg(metavar="FILE.xml", help=MODEL_TEXT)]
    name: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: that of the model)")] = None
    """Name of the robot and of its files."""
    out: Annotated[str, arg(metavar="DIR")] = "."
    """Folder that NAME.robot.json and NAME.preset.json are written to."""

    def run(self) -> None:
        """Guess, derive, write and tell."""
        from ...robots.new_robot import new_robot, save, summary

        name = self.name or Path(self.model).stem
        if not name.replace("-", "").replace("_", "").isalnum():
            raise InvalidValueError(f"--name has letters, digits, - and _ only, got {name!r:.200}")
        robot = new_robot(self.model, name)
        paths = save(robot, Path(self.out))
        about = summary(robot)
        if self.json:
            self.print_json({**about, "files": [str(path) for path in paths]})
        else:
            _tell(about)
            print(f"\nRead {paths[0]} and change what is wrong; then")
            print(f"  push-recovery evaluate --env {paths[0]} --policies two-stage --suite quick")


def _tell(about: dict[str, Any]) -> None:
    """Print what was guessed, for review."""
    robot, limits = about["robot"], about["limits"]
    rows = {
        "pelvis, trunk": f"{about['pelvis']}, {about['trunk']}",
        "left leg": ", ".join(about["left_leg"]),
        "right leg": ", ".join(about["right_leg"]),
        "waist pitch, roll": ", ".join(str(joint or "none") for joint in about["waist"]),
        "held at [rad]": ", ".join(f"{joint} {angle:g}" for joint, angle in about["held"].items()) or "none",
        "no joints here": ", ".join(about["fixed"]) or "none",
        "soles [m]": " and ".join(
            f"{size[0]:g} x {size[1]:g}" for size in (s["size"] for s in about["soles"])
        ),
        "mass [kg]": f"{robot['mass']:.1f}",
        "CoM height [m]": f"{robot['com_height']:.3f}",
        "trunk about the waist": f"{robot['trunk_inertia']:.2f} kg m^2, {robot['trunk_torque_max']:g} N m"
        if any(about["waist"])
        else "no flywheel",
        "steps [m]": f"{limits['length_min']:.2f} to {limits['length_max']:.2f} long, "
        f"{limits['width_min']:.2f} to {limits['width_max']:.2f} wide",
        "F* [N], 0.1 s, every 45 degrees": ", ".join(f"{force:.0f}" for force in about["limit_N"]),
    }
    for name, text in rows.items():
        print(f"{name:32}{text}")
