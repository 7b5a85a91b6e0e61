"""The posture of a robot for a given CoM and two footholds, in closed form or by Newton's method.

In a six-joint leg (hip yaw-roll-pitch, knee, ankle pitch-roll) whose three hip axes meet in one point and
whose two ankle axes meet in another, the position of the hip seen from the foot fixes knee, ankle pitch and
ankle roll, and the rest of the rotation the three hip joints (Kajita et al., Introduction to Humanoid
Robotics, section 2.5.2). Another leg is found by Newton's method.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.jit import njit
from ...controllers.whole_body.kinematics import YAW_ROLL_PITCH_AXES, Array
from ..robots.compiled_robot import CompiledRobot, put_held
from ..robots.indices import Indices

SAME = 1e-12  # largest difference of lengths or axes that count as equal [m]


class LegGeometry(NamedTuple):
    """Lengths of such a leg [m], the left one as the right one."""

    thigh: float  # hip to knee
    shank: float  # knee to ankle
    ankle_height: float  # ankle above the sole
    hip_drop: float  # hip below the pelvis' origin
    hip_offset: float  # hip beside it


def leg_geometry(model: mujoco.MjModel, indices: Indices) -> LegGeometry | None:
    """The lengths of a robot's legs; None where the closed form does not hold for them.

    In the reference posture hip, knee, ankle and sole of such a leg are plumb below one another, and the sole
    is level and straight ahead.
    """
    data, found = mujoco.MjData(model), []
    data.qpos[list(indices.qpos[:7])] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    mujoco.mj_kinematics(model, data)
    for side, joints, sole in zip((1.0, -1.0), indices.legs, indices.soles, strict=True):
        anchors, axes = data.xanchor[list(joints)], data.xaxis[list(joints)]
        hip, knee, ankle, end = anchors[0], anchors[3], anchors[4], data.site_xpos[sole]
        plumb = (knee - hip)[:2], (ankle - knee)[:2], (end - ankle)[:2]
        beside = *(anchors[1:3] - hip).ravel(), *(anchors[5] - ankle), *np.ravel(plumb), hip[0]
        lean = np.abs(data.site_xmat[sole].reshape(3, 3) - np.eye(3)).max()
        turned = max(np.abs(axes - YAW_ROLL_PITCH_AXES).max(), lean)
        first = model.jnt_qposadr[joints[0]]
        in_a_row = [int(model.jnt_qposadr[joint]) for joint in joints] == list(range(first, first + 6))
        if max(np.abs(beside).max(), turned) > SAME or not in_a_row:
            return None
        found.append((hip[2] - knee[2], knee[2] - ankle[2], ankle[2] - end[2], -hip[2], side * hip[1]))
    if np.abs(np.subtract(*found)).max() > SAME:
        return None
    return LegGeometry(*np.round(found[0], 12).tolist())


@njit(cache=True)
def ankle_joints(x, y, z, leg):  # pragma: no cover
    """Knee, ankle pitch and ankle roll [rad] that put the hip at (x, y, z) [m], seen from foot and ankle."""
    distance = min(math.sqrt(x * x + y * y + z * z), leg.thigh + leg.shank)
    cosine = (leg.thigh**2 + leg.shank**2 - distance**2) / (2 * leg.thigh * leg.shank)
    knee = math.pi - math.acos(max(-1.0, min(1.0, cosine)))
    lean = math.atan2(x, math.hypot(y, z))
    thigh_share = math.asin(max(-1.0, min(1.0, leg.thigh * math.sin(knee) / distance)))
    return knee, -lean - thigh_share, math.atan2(y, z)


@njit(cache=True)
def level_leg(pelvis, side, sole, leg, out):  # pragma: no cover
    """Write the joints (6,) of a leg that put its sole level at heading 0, the pelvis upright [rad].

    They are hip yaw, roll, pitch, knee, ankle pitch and roll; out of reach, the leg is straight. The foot is
    Rz(yaw) Rx(roll) Ry(pitch + knee + ankle_pitch) Rx(ankle_roll) seen from the pelvis, so hips need no yaw.

    Args:
        pelvis: origin of the pelvis, (3,) [m].
        side: 1 for the left leg, -1 for the right one.
        sole: centre of the sole, (3,) [m].
        leg: its lengths.
        out: written.
    """
    knee, pitch, roll = ankle_joints(
        pelvis[0] - sole[0],
        pelvis[1] + side * leg.hip_offset - sole[1],
        pelvis[2] - leg.hip_drop - sole[2] - leg.ankle_height,
        leg,
    )
    out[0], out[1], out[2] = 0.0, -roll, -knee - pitch
    out[3], out[4], out[5] = knee, pitch, roll


CONVERGED = 1e-13  # error of the CoM of a posture [m]
REACHED = 1e-9  # largest error of CoM and soles [m], [rad]
SUNK = 1e-10  # soles lie this deep in the floor, or rounding would say which corners touch it [m]
FOLLOWS = 0.9  # how far the CoM moves, about, where the pelvis is shifted by 1 and the soles stay
GUESS = (0.0, 0.0, 0.06)  # of the CoM over the pelvis' origin [m]
ROUNDS = 50
LARGEST_STEP = 0.3  # of a round of Newton's method [m], [rad]


@njit(cache=True)
def _place(pelvis, soles, leg, first, qpos):  # pragma: no cover
    """Put the pelvis (3,) and the legs, onto the soles (2, 3), into qpos; a leg begins at `first` (2,)."""
    qpos[:3] = pelvis
    for side in range(2):
        level_leg(pelvis, 1.0 - 2.0 * side, soles[side], leg, qpos[first[side] : first[side] + 6])


@njit(cache=True)
def _correct(com, found, soles, leg, first, pelvis, qpos):  # pragma: no cover
    """Shift the pelvis (3,) where the CoM `found` (3,) is off `com` (3,); returns the error before [m]."""
    error = 0.0
    for i in range(3):
        error = max(error, abs(com[i] - found[i]))
    if not error < CONVERGED:
        for i in range(3):
            pelvis[i] += (com[i] - found[i]) / FOLLOWS
        _place(pelvis, soles, leg, first, qpos)
    return error


UPRIGHT = 0.0, 0.0  # lean [rad]


def leaning(lean: tuple[float, float]) -> Array:
    """Quaternion (4,) of a body that leans forward and to the left [rad], a turn about (-left, forward)."""
    quat, forward, left = np.empty(4), *lean
    angle = math.hypot(forward, left)
    axis = np.array([-left, forward, 0.0]) / angle if angle else np.zeros(3)
    mujoco.mju_axisAngle2Quat(quat, axis, angle)
    return quat


def posture(
    robot: CompiledRobot,
    com: Array,
    com_velocity: Array,
    soles: NDArray[np.float64],
    lean: tuple[float, float] = UPRIGHT,
) -> tuple[Array, Array]:
    """Joint coordinates and velocities of a robot on two soles at rest.

    Args:
        robot: whose posture it is.
        com: CoM in the world, (3,) [m].
        com_velocity: (3,) [m/s].
        soles: centres of the left and right sole, (2, 3) [m], both level and at heading 0.
        lean: of pelvis and trunk, forward and to the left [rad].

    Returns:
        qpos and qvel as MuJoCo has them: pelvis and trunk upright or leaning, not turning, the soles at rest.

    Raises:
        InvalidValueError: the legs do not reach.
    """
    data, indices = robot.scratch(), robot.indices
    com, soles = (np.array(value, dtype=np.float64) for value in (com, soles))
    soles[:, 2] -= SUNK
    geometry = leg_geometry_of(robot) if lean == UPRIGHT else None
    data.qpos[:] = 0.0
    data.qpos[list(indices.qpos[:7])] = *(com - GUESS), *leaning(lean)
    put_held(robot.model, robot.plan, data)
    if geometry is None:
        _bend(robot, data)
        error = _newton(robot, data, com, soles)
    else:
        error = _closed_form(robot, data, com, soles, geometry)
    reached = data.site_xpos[list(indices.soles)]
    if not max(error, np.abs(reached - soles).max()) <= REACHED:
        raise InvalidValueError(f"no posture puts the CoM at {com.tolist()} m over soles {soles.tolist()}")
    return data.qpos.copy(), _velocity(robot, data, com_velocity)


def leg_geometry_of(robot: CompiledRobot) -> LegGeometry | None:
    """Lengths of a robot's legs where the closed form holds for them; found once."""
    if "leg_geometry" not in robot.found:
        robot.found["leg_geometry"] = leg_geometry(robot.model, robot.indices)
    return robot.found["leg_geometry"]


def _closed_form(
    robot: CompiledRobot, data: mujoco.MjData, com: Array, soles: Array, leg: LegGeometry
) -> float:
    """Put `data` into the posture; returns the error of the CoM [m].

    The CoM moves almost as the pelvis does, so shifting the pelvis by what the CoM is off converges, by a
    factor of about 20 each time, and MuJoCo says where it is.
    """
    first = np.array([coordinates[0] for coordinates in robot.indices.legs_qpos])
    qpos, found, pelvis, error = data.qpos, data.subtree_com[0], com - GUESS, np.inf
    _place(pelvis, soles, leg, first, qpos)
    for _ in range(ROUNDS):
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        error = _correct(com, found, soles, leg, first, pelvis, qpos)
        if error < CONVERGED:
            break
    return error


def _bend(robot: CompiledRobot, data: mujoco.MjData) -> None:
    """Begin with the legs bent as the plan says, the right one as the left one in a mirror."""
    for leg, coordinates in enumerate(robot.indices.legs_qpos):
        mirror = robot.mirror[8:] if leg else np.ones(6)
        data.qpos[list(coordinates)] = mirror * np.array(robot.plan.bend)


def _newton(robot: CompiledRobot, data: mujoco.MjData, com: Array, soles: Array) -> float:
    """Put `data` into the posture by Newton's method; returns the largest error of CoM and soles [m], [rad].

    Unknowns are the pelvis' place and the twelve joints of the legs, conditions the CoM and the poses of the
    soles. The model's joint ranges keep knees from bending backwards.
    """
    indices, error = robot.indices, np.inf
    moving = [*indices.qpos[:3], *indices.legs_qpos[0], *indices.legs_qpos[1]]
    for _ in range(ROUNDS):
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        residual = _residual(robot, data, com, soles)
        error = float(np.abs(residual).max())
        if error < CONVERGED:
            break
        jacobian = jacobian_of_com_and_soles(robot, data)[:, indices.moving_dof]
        step = np.linalg.lstsq(jacobian, residual)[0]
        data.qpos[moving] += step * min(1.0, LARGEST_STEP / np.abs(step).max())
    for joint in (*indices.legs[0], *indices.legs[1]):
        low, high = robot.model.jnt_range[joint]
        if robot.model.jnt_limited[joint] and not low <= data.qpos[robot.model.jnt_qposadr[joint]] <= high:
            return np.inf
    return error


def _residual(robot: CompiledRobot, data: mujoco.MjData, com: Array, soles: Array) -> Array:
    """How far CoM (3) and both soles, place (3) and rotation (3) each, are from their goal, (15,)."""
    residual, quat = np.zeros(15), np.empty(4)
    residual[:3] = com - data.subtree_com[0]
    for row, site, sole in zip((3, 9), robot.indices.soles, soles, strict=True):
        residual[row : row + 3] = sole - data.site_xpos[site]
        mujoco.mju_mat2Quat(quat, data.site_xmat[site])
        mujoco.mju_quat2Vel(residual[row + 3 : row + 6], quat, -1.0)
    return residual


def jacobian_of_com_and_soles(robot: CompiledRobot, data: mujoco.MjData) -> Array:
    """Velocities of the CoM (3) and of both soles (6 each) by qvel, (15, nv) [m/s], [rad/s]."""
    rows = np.zeros((15, robot.model.nv))
    mujoco.mj_jacSubtreeCom(robot.model, data, rows[:3], 0)
    for row, site in zip((3, 9), robot.indices.soles, strict=True):
        mujoco.mj_jacSite(robot.model, data, rows[row : row + 3], rows[row + 3 : row + 6], site)
    return rows


def _velocity(robot: CompiledRobot, data: mujoco.MjData, com_velocity: Array) -> Array:
    """Joint velocities for a velocity of the CoM; pelvis and trunk do not turn, the soles rest."""
    wanted, velocity = np.zeros(15), np.zeros(robot.model.nv)
    wanted[:3] = com_velocity
    moving = robot.indices.moving_dof
    velocity[moving] = np.linalg.solve(jacobian_of_com_and_soles(robot, data)[:, moving], wanted)
    return velocity
