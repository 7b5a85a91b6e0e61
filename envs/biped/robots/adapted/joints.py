"""Joints of an adapted model: torque motors on those that move, none where the robot is one piece."""

from __future__ import annotations

from fnmatch import fnmatchcase

import mujoco
import numpy as np

from .....controllers.errors import InvalidValueError, UnknownNameError
from .robot_file import Angles, Motor, RobotFile

NO_MOTOR = Motor()
LIGHT = 0.01  # armature of a joint whose model has none [kg m^2]


def fix_joints(spec: mujoco.MjSpec, fixed: Angles) -> None:
    """Take joints out of a model; their bodies keep the angles.

    Raises:
        UnknownNameError: a joint that the model does not have.
    """
    names = [joint.name for joint in spec.joints]
    for name, angle in fixed:
        if name not in names:
            raise UnknownNameError("fixed joint", name, names)
        joint = spec.joint(name)
        if angle:
            _turn(joint.parent, joint, angle)
        spec.delete(joint)


def _turn(body: mujoco.MjsBody, joint: mujoco.MjsJoint, angle: float) -> None:
    """Turn a body by an angle about a joint of its own, and the joints before that one back."""
    turn, back, quat = np.empty(4), np.empty(4), np.empty(4)
    mujoco.mju_axisAngle2Quat(turn, np.array(joint.axis) / np.linalg.norm(joint.axis), angle)
    mujoco.mju_negQuat(back, turn)
    anchor, own = np.array(joint.pos), np.array(body.quat)
    mujoco.mju_mulQuat(quat, own, turn)
    body.pos, body.quat = np.array(body.pos) + _turned(anchor - _turned(anchor, turn), own), quat
    for other in body.joints:
        if other.name == joint.name:
            break
        other.axis = _turned(np.array(other.axis), back)
        other.pos = anchor + _turned(np.array(other.pos) - anchor, back)


def _turned(vector: np.ndarray, quat: np.ndarray) -> np.ndarray:
    turned = np.empty(3)
    mujoco.mju_rotVecQuat(turned, vector, quat)
    return turned


def motor_for(robot: RobotFile, joint: str) -> Motor:
    """What a robot file says of a joint's motor."""
    return next((motor for name, motor in robot.motors if fnmatchcase(joint, name)), NO_MOTOR)


def add_motors(spec: mujoco.MjSpec, robot: RobotFile, torques: dict[str, float]) -> None:
    """Put a torque motor on every hinge, with neither friction nor damping, of which control knows nothing.

    Raises:
        InvalidValueError: a joint that is no hinge, or whose largest torque nobody tells.
    """
    spec.nuser_actuator = 1
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            continue
        if joint.type != mujoco.mjtJoint.mjJNT_HINGE:
            raise InvalidValueError(f"joint {joint.name!r} must be a hinge or be named in 'fixed'")
        motor = motor_for(robot, joint.name)
        torque = motor.torque if motor.torque is not None else torques.get(joint.name)
        if not torque or not torque > 0.0:
            raise InvalidValueError(f"joint {joint.name!r} has no largest torque: name it in 'motors'")
        joint.damping, joint.stiffness = np.zeros_like(joint.damping), np.zeros_like(joint.stiffness)
        joint.frictionloss = 0.0
        joint.actfrclimited = False
        joint.solref_limit = [0.01, 1.0]
        joint.armature = motor.armature if motor.armature is not None else joint.armature or LIGHT
        added = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        added.forcelimited, added.forcerange = True, [-torque, torque]
        added.ctrllimited = False
        added.userdata = [motor.speed or 0.0]


def largest_torques(spec: mujoco.MjSpec) -> dict[str, float]:
    """Largest torque of the joints as their model has it, of the joint's or its actuator's range [N m]."""
    found = {joint.name: float(joint.actfrcrange[1]) for joint in spec.joints if joint.actfrcrange[1] > 0.0}
    for actuator in spec.actuators:
        if actuator.trntype != mujoco.mjtTrn.mjTRN_JOINT or actuator.target in found:
            continue
        gear = abs(float(actuator.gear[0])) or 1.0
        is_motor = actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
        for bounded in (actuator.forcerange, actuator.ctrlrange if is_motor else (0.0, 0.0)):
            if float(bounded[1]) > 0.0:
                found[actuator.target] = float(bounded[1]) * gear
                break
    return found
