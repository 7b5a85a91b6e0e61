"""A robot's compiled model with what control and planner need to know of it.

The joints that a plan holds keep their angle by servos, which MuJoCo evaluates in its own step. The torque of
a held joint is that of a critically damped spring about its angle,

    tau = I w^2 (q_held - q) - 2 I w qd,    clipped to the motor's forcerange,

with I the inertia that the joint moves in the held posture, the rest of the robot at rest, and w well above
what walking excites. Control takes the joint for rigid: it knows neither its coordinate nor its torque.
"""

from __future__ import annotations

import hashlib
import math
import threading
from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import Any

import mujoco
import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file
from ...controllers.model.robot import SMALLEST, BodyPlan, RobotModel
from ...controllers.settings import is_preset_file
from ...controllers.whole_body.kinematics import ANY_AXES, KNEE, MEETING_AXES, Array, Ints
from ...controllers.whole_body.limits import NEVER
from ..scenario.model_errors import CONTROL_STEP
from ..scenario.push import BODIES, LINK
from ..snapshot import model_digest
from .description import RobotDescription
from .indices import MISSING, TILT, Indices, find_indices, hinge, known, motor_of
from .model_files import in_a_line, unwarned

FREQUENCY = 60.0  # w [rad/s]


def hold_joints(model: mujoco.MjModel, plan: BodyPlan) -> None:
    """Turn the motors of a plan's held joints into servos, in place.

    Raises:
        UnknownNameError: a joint that the model does not have.
        InvalidValueError: no hinge, no motor, or an angle out of the joint's range.
    """
    if not plan.held:
        return
    data = mujoco.MjData(model)
    put_held(model, plan, data)
    inertia = moved_inertia(data)
    for name, angle in plan.held:
        joint = hinge(model, name)
        low, high = model.jnt_range[joint]
        if model.jnt_limited[joint] and not low <= angle <= high:
            raise InvalidValueError(
                f"held joint {name!r} must keep an angle in [{low:g}, {high:g}] rad, got {angle:g}"
            )
        motor, moved = motor_of(model, joint), inertia[model.jnt_dofadr[joint]]
        stiffness, damping = moved * FREQUENCY**2, 2.0 * moved * FREQUENCY
        model.actuator_biastype[motor] = mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_biasprm[motor, :3] = stiffness * angle, -stiffness, -damping


def moved_inertia(data: mujoco.MjData) -> Array:
    """Inertia that each degree of freedom moves in the posture of `data`, the others at rest, (nv,) [kg m^2].

    It is the diagonal of the mass matrix.
    """
    model = data.model
    mujoco.mj_forward(model, data)
    return data.M[model.M_rowadr + model.M_rownnz - 1].copy()


def put_held(model: mujoco.MjModel, plan: BodyPlan, data: mujoco.MjData) -> None:
    """Put the held joints of `data` at their angles."""
    for name, angle in plan.held:
        data.qpos[model.jnt_qposadr[hinge(model, name)]] = angle


def robot_model(data: mujoco.MjData, indices: Indices, com_height: float) -> RobotModel:
    """Mass, trunk, feet and pelvis width of a robot whose `data` is in its reference posture.

    The trunk's inertia j is that of all that the waist carries, about the pitch axis of the waist; torque and
    angle are the least of the waist's axes. Without a waist they do not count.
    """
    model = data.model
    soles = data.site_xpos[list(indices.soles)]
    length, width, _ = 2.0 * model.geom_size[indices.sole_boxes[0]]
    inertia, torque, angle = SMALLEST, SMALLEST, SMALLEST
    pitch, roll = (joint != MISSING for joint in indices.joints[1:3])
    waist = known(indices.joints[1:3])
    if waist:
        inertia = trunk_inertia(data, indices)
        torque = min(float(model.actuator_forcerange[indices.motors[axis], 1]) for axis, _ in waist)
        ranges = [np.abs(model.jnt_range[joint]).min() for _, joint in waist if model.jnt_limited[joint]]
        angle = float(min([*ranges, math.pi / 2.0]))
    return RobotModel(
        mass=float(model.body_subtreemass[indices.pelvis]),
        com_height=com_height,
        trunk_inertia=inertia,
        trunk_torque_max=torque,
        trunk_angle_max=angle,
        foot_length=float(length),
        foot_width=float(width),
        pelvis_width=float(abs(soles[0, 1] - soles[1, 1])),
        trunk_pitch=pitch,
        trunk_roll=roll,
    )


def trunk_inertia(data: mujoco.MjData, indices: Indices) -> float:
    """Inertia of all that the waist carries about its first axis [kg m^2], of a placed `data`."""
    model = data.model
    joint = next(joint for joint in indices.joints[1:3] if joint != MISSING)
    axis, anchor, total = data.xaxis[joint], data.xanchor[joint], 0.0
    for body in range(model.nbody):
        above = body
        while above not in {0, indices.trunk}:
            above = int(model.body_parentid[above])
        if above == 0:
            continue
        lever = data.xipos[body] - anchor
        own = data.ximat[body].reshape(3, 3).T @ axis
        total += float(model.body_inertia[body] @ own**2)
        total += float(model.body_mass[body] * (lever @ lever - (lever @ axis) ** 2))
    return total


SAME = 1e-9  # largest difference of points [m] and axes that count as one


class CompiledRobot:
    """A robot whose names have been found in its model; shared by all its simulations, never modified."""

    def __init__(self, description: RobotDescription):
        """Compile the model.

        Raises:
            PushRecoveryError: a name or a part that does not fit the body plan.
        """
        self.description = description
        self.model = self.compiled(description.spec())
        self.indices: Indices = find_indices(self.model, self.plan, description.driven)
        self._scratch = threading.local()
        self.found: dict[str, Any] = {}  # results that others have worked out of the model once

    @property
    def plan(self) -> BodyPlan:
        """Names of its parts."""
        return self.description.plan

    @cached_property
    def pushed(self) -> Mapping[str, int]:
        """Place in `indices.pushed` of every body that a push may name."""
        numbers, model = {name: i for i, name in enumerate(BODIES)}, self.model
        for joint, _ in self.plan.held:
            body = int(model.jnt_bodyid[model.joint(joint).id])
            numbers[f"{LINK}{joint}"] = self.indices.pushed.index(body)
        return numbers

    def compiled(self, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """The model of a spec of this robot, with the physics step of all robots and its held joints held.

        Those of a robot that is `driven` keep their motors.
        """
        try:
            with unwarned():
                model = spec.compile()
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            message = in_a_line(error)
            raise InvalidValueError(
                f"MuJoCo cannot compile robot {self.description.name!r}: {message}"
            ) from error
        model.opt.timestep = CONTROL_STEP
        if not self.description.driven:
            hold_joints(model, self.plan)
        return model

    @cached_property
    def picture(self) -> mujoco.MjModel:
        """The model that is drawn: the same joints, and shapes that the physics leaves out."""
        looks = self.description.looks
        return self.model if looks is None else self.compiled(looks())

    @cached_property
    def robot(self) -> RobotModel:
        """Physical constants that the planner knows."""
        if self.description.model is not None:
            return self.description.model
        return robot_model(self.in_reference_posture(), self.indices, self.description.com_height)

    @cached_property
    def motors(self) -> Array:
        """Largest torque [N m] and speed without load [rad/s] of every motor, (2, 14)."""
        model, motors = self.model, np.full((2, len(self.indices.motors)), NEVER)
        for i, motor in enumerate(self.indices.motors):
            if motor == MISSING:
                continue
            low, high = model.actuator_forcerange[motor]
            if not (model.actuator_forcelimited[motor] and high == -low):
                raise InvalidValueError(
                    f"motor {model.actuator(motor).name!r} must have a forcerange, as large both ways"
                )
            motors[0, i] = high
            if model.nuser_actuator and model.actuator_user[motor, 0] > 0.0:
                motors[1, i] = model.actuator_user[motor, 0]
        return motors

    @cached_property
    def soles(self) -> Array:
        """Centre of each sole in the axes of its foot's body, from its origin, (2, 3) [m].

        Raises:
            InvalidValueError: a sole that is turned in its foot.
        """
        model, sites = self.model, list(self.indices.soles)
        for site, foot in zip(sites, self.indices.feet, strict=True):
            if model.site_bodyid[site] != foot or abs(model.site_quat[site, 0]) < 1.0 - TILT:
                raise InvalidValueError(
                    f"sole {model.site(site).name!r} must lie in {model.body(foot).name!r}, the body of "
                    "its leg's last joint, and not be turned in it"
                )
        return model.site_pos[sites].copy()

    @cached_property
    def ankle_height(self) -> float:
        """Of the joint above the last over the sole, across it [m]."""
        data = self.in_reference_posture()
        sole, ankle = self.indices.soles[0], self.indices.legs[0][-2]
        up = data.site_xmat[sole].reshape(3, 3)[:, 2]  # a foot may lean in the reference posture
        height = up @ (data.xanchor[ankle] - data.site_xpos[sole])
        return round(float(height), 12)  # free of the rounding of the chain of bodies

    @cached_property
    def leg_form(self) -> int:
        """MEETING_AXES where the closed form of the inverse of a leg holds for both legs."""
        data = self.in_reference_posture()
        for joints in self.indices.legs:
            anchors, axes = data.xanchor[list(joints)], data.xaxis[list(joints)]
            apart = [anchors[1] - anchors[0], anchors[2] - anchors[0], anchors[5] - anchors[4]]
            skew = axes[3:5] - axes[2]
            if max(np.abs(apart).max(), np.abs(skew).max()) > SAME:
                return ANY_AXES
        return MEETING_AXES

    @cached_property
    def mirror(self) -> Array:
        """Sign of each joint's coordinate in the robot mirrored left to right, (14,).

        An axis a is mirrored into (-a_x, a_y, -a_z); a left joint's into that of its partner on the right.

        Raises:
            InvalidValueError: partners whose axes are no mirror images.
        """
        axes, signs = self.in_reference_posture().xaxis, np.array([1.0, -1.0] + 12 * [0.0])
        for i, (left, right) in enumerate(zip(*self.indices.legs, strict=True)):
            sign = float(axes[right] @ (axes[left] * [-1.0, 1.0, -1.0]))
            if abs(sign) < 1.0 - TILT:
                raise InvalidValueError(
                    f"joints {self.model.joint(left).name!r} and {self.model.joint(right).name!r} must "
                    "have axes that are mirror images"
                )
            signs[2 + i] = signs[8 + i] = np.sign(sign)
        return signs

    @cached_property
    def knee_bend(self) -> Array:
        """Sign of each knee's coordinate where it is bent, (2,): that of the farther end of its range.

        0 for a knee that stops before it is straight; of a knee without a range, or as free both ways, as the
        plan bends it.
        """
        knees = [leg[KNEE] for leg in self.indices.legs]
        low, high = self.model.jnt_range[knees].T
        planned = np.sign(self.plan.bend[KNEE]) * np.array([1.0, self.mirror[8 + KNEE]])
        bent = np.where(low + high == 0.0, np.where(planned == 0.0, 1.0, planned), np.sign(low + high))
        return np.where(low * high > 0.0, 0.0, bent)

    def constants(self) -> tuple[Array, Array, Array, Ints, Array]:
        """Constants of compiled control: the last fields of `Physics`."""
        form = np.array([self.leg_form])
        return self.soles, np.array([self.ankle_height]), self.mirror, form, self.knee_bend

    def in_reference_posture(self) -> mujoco.MjData:
        """The robot upright, all joints at 0 but the held ones, with the kinematics of that."""
        data = mujoco.MjData(self.model)
        data.qpos[list(self.indices.qpos[:7])] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
        put_held(self.model, self.plan, data)
        mujoco.mj_kinematics(self.model, data)
        return data

    @cached_property
    def half_sole(self) -> tuple[float, float]:
        """Half the length and the width of a sole [m]."""
        length, width, _ = self.model.geom_size[self.indices.sole_boxes[0]].tolist()
        return length, width

    def scratch(self) -> mujoco.MjData:
        """A simulation of this thread's own for anything that takes no longer than a call."""
        if not hasattr(self._scratch, "data"):
            self._scratch.data = mujoco.MjData(self.model)
        return self._scratch.data


@lru_cache(maxsize=16)
def compiled_robot(description: RobotDescription) -> CompiledRobot:
    """The robot of a description; one copy per process."""
    return CompiledRobot(description)


def robot_digest(description: RobotDescription) -> str:
    """SHA-256 of what a robot is: of its files, or of the compiled models of one that Python makes."""
    told = [description.files]
    if not description.files:
        body, solid = compiled_robot(description), description.solid
        models = [body.model] if solid is None else [body.model, body.compiled(solid())]
        told = [
            *map(model_digest, models),
            repr((description.plan, description.com_height, description.model)),
        ]
    if is_preset_file(description.preset):
        told.append(hashlib.sha256(read_file(description.preset)).hexdigest())
    return hashlib.sha256("\0".join(told).encode()).hexdigest()
