"""Feet of an adapted robot: a box as sole, its site and load sensor, and what can touch what."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from .robot_file import SIDES, RobotFile, Sole

THICKNESS = 0.02  # of the box [m]
MARGIN = 0.02  # by which the region of the load sensor is larger than the sole [m]
SHANK_RADIUS = 0.08  # of the capsule in a shank over its length
FRICTION, HARDNESS = [0.9, 0.9, 0.005, 0.0001, 0.0001], [0.01, 1.0]  # as the biped's
STRAIGHT = (1.0, 0.0, 0.0, 0.0)


def add_feet(spec: mujoco.MjSpec, robot: RobotFile) -> None:
    """Give both legs a sole that touches floor and other foot, and a shank that touches the other leg."""
    for side, leg, sole in zip(SIDES, robot.plan.legs, robot.soles, strict=True):
        foot, shank, ankle = (spec.joint(leg[joint]).parent for joint in (5, 3, 4))
        turn_body(foot, sole.turn)
        _add_sole(spec, foot, side, sole)
        _add_shank(shank, ankle, side)
    feet, shanks = robot.plan.sole_boxes, tuple(f"{side}_shank_capsule" for side in SIDES)
    touching = [
        ("floor", feet[0]),
        ("floor", feet[1]),
        feet,
        shanks,
        (feet[0], shanks[1]),
        (shanks[0], feet[1]),
    ]
    for first, second in touching:
        spec.add_pair(geomname1=first, geomname2=second, condim=3, friction=FRICTION, solref=HARDNESS)


def _add_sole(spec: mujoco.MjSpec, foot: mujoco.MjsBody, side: str, sole: Sole) -> None:
    """The box, whose lower face is the sole, with site and sensor."""
    centre = _turned_back(sole.turn, sole.centre)
    length, width = sole.size
    foot.add_geom(
        name=f"{side}_foot_sole", type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre + [0.0, 0.0, 0.5 * THICKNESS],
        size=[0.5 * length, 0.5 * width, 0.5 * THICKNESS], contype=0, conaffinity=0, mass=0.0, group=1,
        material=f"pr_{side}",
    )  # fmt: skip
    foot.add_site(
        name=f"{side}_sole", type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, group=4,
        size=[0.5 * length + MARGIN, 0.5 * width + MARGIN, THICKNESS + MARGIN],
    )  # fmt: skip
    spec.add_sensor(
        name=f"{side}_load", type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=f"{side}_sole",
    )  # fmt: skip


def _add_shank(shank: mujoco.MjsBody, ankle: mujoco.MjsBody, side: str) -> None:
    """A capsule from knee to ankle, nine tenths as long as the way between them."""
    end = np.array(ankle.pos)
    shank.add_geom(
        name=f"{side}_shank_capsule", type=mujoco.mjtGeom.mjGEOM_CAPSULE, contype=0, conaffinity=0, mass=0.0,
        fromto=[*(0.1 * end), *(0.9 * end)], size=[SHANK_RADIUS * np.linalg.norm(end), 0.0, 0.0], group=1,
        material="pr_shell",
    )  # fmt: skip


def turn_body(body: mujoco.MjsBody, turn: Sequence[float]) -> None:
    """Turn the axes of a body by a quaternion, in place; all that it holds stays where it is."""
    if tuple(turn) == STRAIGHT:
        return
    quat = np.array(turn) / np.linalg.norm(turn)
    body.quat = _product(np.array(body.quat), quat)
    body.ipos, body.iquat = _turned_back(quat, body.ipos), _product(_conjugate(quat), np.array(body.iquat))
    for joint in body.joints:
        joint.pos, joint.axis = _turned_back(quat, joint.pos), _turned_back(quat, joint.axis)
    for part in (*body.geoms, *body.sites, *body.bodies):
        part.pos, part.quat = _turned_back(quat, part.pos), _product(_conjugate(quat), np.array(part.quat))


def _product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    product = np.empty(4)
    mujoco.mju_mulQuat(product, first, second)
    return product


def _conjugate(quat: np.ndarray) -> np.ndarray:
    return quat * [1.0, -1.0, -1.0, -1.0]


def _turned_back(turn: ArrayLike, vector: ArrayLike) -> np.ndarray:
    """A vector of a body in the axes that `turn` makes of the body's."""
    turned = np.empty(3)
    quat = np.array(turn) / np.linalg.norm(turn)
    mujoco.mju_rotVecQuat(turned, np.array(vector, dtype=np.float64), _conjugate(quat))
    return turned
