"""The robots that come with the package; their models are in packages of the extra `robots`."""

from __future__ import annotations

from importlib.resources import files

from ..description import RobotDescription
from .adapt import load_robot

FOLDER = files("push_recovery.envs.biped.robots.adapted").joinpath("files")


def shipped_robot(name: str) -> RobotDescription:
    """The robot of a file of this package."""
    return load_robot(str(FOLDER.joinpath(f"{name}.json")))


G1 = shipped_robot("g1")  # Unitree G1
T1 = shipped_robot("t1")  # Booster T1
JVRC1 = shipped_robot("jvrc1")  # JVRC-1
