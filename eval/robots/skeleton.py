"""The joints of a model that nobody has described, and where they are in its reference posture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...envs.biped.robots.adapted.adapt import add_root
from ...envs.biped.robots.adapted.bare import drop_shapes
from ...envs.biped.robots.adapted.joints import largest_torques
from ...envs.biped.robots.adapted.model_place import read_model

Chain = tuple[int, ...]


@dataclass(frozen=True)
class Skeleton:
    """A model without shapes, upright with all joints at 0."""

    name: str  # where the model lies
    model: mujoco.MjModel
    data: mujoco.MjData
    torques: dict[str, float]  # joint -> largest torque [N m]
    posture: dict[str, float]  # joint -> angle in the model's first keyframe [rad]

    @cached_property
    def root(self) -> int:
        """Body with the free joint."""
        return int(self.model.jnt_bodyid[self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE][0])

    @cached_property
    def hinges(self) -> list[int]:
        """Numbers of all hinges."""
        return np.flatnonzero(self.model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).tolist()

    def joint_name(self, joint: int) -> str:
        """Name of a joint."""
        return str(self.model.joint(joint).name)

    def body_name(self, body: int) -> str:
        """Name of a body."""
        return str(self.model.body(body).name)

    def axis(self, joint: int) -> NDArray[np.float64]:
        """Of a hinge, in the world, (3,)."""
        return self.data.xaxis[joint]

    def chain(self, joint: int) -> Chain:
        """Hinges from the root to a joint, itself included."""
        model, found = self.model, []
        dof = int(model.jnt_dofadr[joint])
        while dof >= 0:
            owner = int(model.dof_jntid[dof])
            if model.jnt_type[owner] == mujoco.mjtJoint.mjJNT_HINGE:
                found.append(owner)
            dof = int(model.dof_parentid[dof])
        return tuple(reversed(found))

    def children(self, body: int) -> Iterator[int]:
        """Bodies that hang from a body."""
        return (
            other
            for other in range(1, self.model.nbody)
            if self.model.body_parentid[other] == body and other != body
        )

    def moved_mass(self, joint: int) -> float:
        """Mass that a joint carries [kg]."""
        return float(self.model.body_subtreemass[self.model.jnt_bodyid[joint]])


def read_skeleton(model: str) -> Skeleton:
    """The skeleton of a model, MJCF or URDF.

    Raises:
        InvalidValueError: no such model, one that MuJoCo cannot read, or one without a robot in it.
    """
    spec = read_model(model)
    torques, posture = largest_torques(spec), _keyframe(spec)
    followers = [joint.name for joint in spec.joints]  # joints that follow others are none of the legs
    drop_shapes(spec, fixed=followers)
    roots = [body for body in spec.worldbody.bodies if list(body.bodies)]
    if not roots:
        raise InvalidValueError(
            f"there is no robot in the model {model!r}: no body has others hanging from it"
        )
    add_root(spec, roots[0].name)
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qpos[3] = 0.0, 1.0
    mujoco.mj_kinematics(compiled, data)
    mujoco.mj_comPos(compiled, data)
    return Skeleton(model, compiled, data, torques, posture)


def _keyframe(spec: mujoco.MjSpec) -> dict[str, float]:
    """Angles of the first keyframe of a model; none where it has no keyframe."""
    keys = list(spec.keys)
    if not keys:
        return {}
    angles, place, found = np.array(keys[0].qpos), 0, {}
    for joint in spec.joints:
        free = joint.type == mujoco.mjtJoint.mjJNT_FREE
        if not free and place < len(angles):
            found[joint.name] = float(angles[place])
        place += 7 if free else 1
    return found
