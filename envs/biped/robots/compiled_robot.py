"""A robot's compiled model with what control needs to know of it."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import Any

import mujoco
import numpy as np

from ....controllers.errors import InvalidValueError
from ....controllers.model.body_plan import BodyPlan
from ....controllers.model.robot import RobotModel
from ....controllers.whole_body.bounds import NEVER
from ....controllers.whole_body.kinematics import ANY_AXES, MEETING_AXES, Array, Ints
from ....controllers.whole_body.leg_inverse import KNEE
from ...scenario.physics_options import CONTROL_STEP
from ...scenario.push import BODIES, LINK
from .description import RobotDescription
from .held import hold_joints, put_held
from .indices import MISSING, TILT, Indices, find_indices
from .robot_model import robot_model

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
        self.indices: Indices = find_indices(self.model, self.plan)
        self._scratch = threading.local()
        self.found: dict[str, Any] = {}  # what others have worked out of the model once

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
        """The model of a spec of this robot, with the physics step of all robots and its held joints held."""
        model = spec.compile()
        model.opt.timestep = CONTROL_STEP
        hold_joints(model, self.plan)
        return model

    @cached_property
    def picture(self) -> mujoco.MjModel:
        """The model that is drawn: the same joints, and shapes that the physics leaves out."""
        looks = self.description.looks
        return self.model if looks is None else self.compiled(looks())

    @cached_property
    def robot(self) -> RobotModel:
        """What the planner knows of it."""
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
        """Of the joint above the last over a flat sole in the reference posture [m]."""
        data = self.in_reference_posture()
        height = data.xanchor[self.indices.legs[0][-2], 2] - data.site_xpos[self.indices.soles[0], 2]
        return round(float(height), 12)  # free of the rounding of the chain of bodies

    @cached_property
    def leg_form(self) -> int:
        """MEETING_AXES where the closed form of `leg_inverse` holds for both legs."""
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

        0 for a knee that stops before it is straight.
        """
        low, high = self.model.jnt_range[[leg[KNEE] for leg in self.indices.legs]].T
        return np.where(low * high > 0.0, 0.0, np.where(low + high < 0.0, -1.0, 1.0))

    def constants(self) -> tuple[Array, Array, Array, Ints, Array]:
        """What compiled control knows of the robot: the last fields of `Physics`."""
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
