"""From the names of a body plan to the numbers of a compiled model, and to the fields that control reads.

Control knows a base, a waist of two axes and two legs of six joints (`controllers.whole_body.kinematics`).
Each entry of a robot's own fields is copied to the place that its part has there. What a robot does not have,
a waist axis, stays zero; its entry on the diagonal of the mass matrix is 1, so that it couples with nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.model.robot import BodyPlan, Pair
from ...controllers.whole_body import kinematics
from ..simulation import ONE, Field, picked, rows

MISSING = -1  # number of a joint that the robot does not have
TILT = 1e-6  # largest component of an axis or a frame off where it has to point
_KINDS = {"body": "nbody", "joint": "njnt", "site": "nsite", "geom": "ngeom", "sensor": "nsensor"}


@dataclass(frozen=True)
class Indices:
    """Numbers of a model's parts in the order of control: base, waist, left leg, right leg."""

    pelvis: int
    trunk: int
    links: tuple[tuple[int, int, int], tuple[int, int, int]]  # thigh, shank and foot of each leg, bodies
    joints: tuple[int, ...]  # (15,) free joint, waist, legs
    qpos: tuple[int, ...]  # (21,) joint coordinates
    dof: tuple[int, ...]  # (20,) degrees of freedom
    motors: tuple[int, ...]  # (14,) actuators
    soles: tuple[int, int]  # sites
    loads: tuple[int, int]  # entries of sensordata
    sole_boxes: tuple[int, int]  # geoms
    held_qpos: tuple[int, ...] = ()  # coordinates of the joints that keep their angle
    held_dof: tuple[int, ...] = ()  # and their degrees of freedom
    held_links: tuple[int, ...] = ()  # and the bodies that they move
    held_motors: tuple[int, ...] = ()  # actuators of these joints where actions drive them

    @property
    def pushed(self) -> tuple[int, ...]:
        """Bodies in the order of `push.BODIES`, then others that held joints move."""
        parts = self.pelvis, self.trunk, *self.links[0], *self.links[1]
        return *parts, *(body for body in dict.fromkeys(self.held_links) if body not in parts)

    @property
    def feet(self) -> tuple[int, int]:
        """Bodies of the left and the right foot."""
        return self.links[0][2], self.links[1][2]

    @property
    def legs(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Joints of the left and the right leg, from hip to sole."""
        return self.joints[3:9], self.joints[9:]

    @property
    def legs_qpos(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Joint coordinates of the left and the right leg, from hip to sole."""
        return self.qpos[9:15], self.qpos[15:]

    @property
    def moving_dof(self) -> list[int]:
        """Degrees of freedom of a posture: translation of the pelvis, the legs."""
        return [*self.dof[:3], *self.dof[8:]]


def number_of(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Number of a model's part.

    Raises:
        UnknownNameError: there is none of that name; lists those there are.
    """
    try:
        return getattr(model, kind)(name).id
    except KeyError:
        names = [getattr(model, kind)(i).name for i in range(getattr(model, _KINDS[kind]))]
        raise UnknownNameError(f"{kind} of the robot's model", name, [*filter(None, names)]) from None


def find_indices(model: mujoco.MjModel, plan: BodyPlan, driven: bool = False) -> Indices:
    """All numbers that a plan's names stand for; the motors of held joints only where they are `driven`.

    Raises:
        UnknownNameError: a name that the model does not have.
        InvalidValueError: a part that cannot play its role.
    """
    pelvis, trunk = number_of(model, "body", plan.pelvis), number_of(model, "body", plan.trunk)
    free = int(model.body_jntadr[pelvis])
    if free < 0 or model.jnt_type[free] != mujoco.mjtJoint.mjJNT_FREE:
        raise InvalidValueError(f"pelvis {plan.pelvis!r} must have the robot's free joint")
    waist = [MISSING if name is None else hinge(model, name) for name in plan.waist]
    legs = [[hinge(model, name) for name in leg] for leg in plan.legs]
    hinges = [*waist, *legs[0], *legs[1]]
    held = [hinge(model, name) for name, _ in plan.held]
    base_qpos, base_dof = int(model.jnt_qposadr[free]), int(model.jnt_dofadr[free])

    def address(addresses: np.ndarray, joint: int) -> int:
        return MISSING if joint == MISSING else int(addresses[joint])

    def two(kind: str, names: Pair) -> tuple[int, int]:
        return number_of(model, kind, names[0]), number_of(model, kind, names[1])

    def links(leg: list[int]) -> tuple[int, int, int]:
        """Bodies that the hip's last axis, the knee and the ankle's last axis move."""
        thigh, shank, foot = (int(model.jnt_bodyid[leg[joint]]) for joint in (2, 3, 5))
        return thigh, shank, foot

    left_load, right_load = map(int, model.sensor_adr[list(two("sensor", plan.loads))])
    indices = Indices(
        pelvis=pelvis,
        trunk=trunk,
        links=(links(legs[0]), links(legs[1])),
        joints=(free, *hinges),
        qpos=(*range(base_qpos, base_qpos + 7), *(address(model.jnt_qposadr, joint) for joint in hinges)),
        dof=(*range(base_dof, base_dof + 6), *(address(model.jnt_dofadr, joint) for joint in hinges)),
        motors=tuple(MISSING if joint == MISSING else motor_of(model, joint) for joint in hinges),
        soles=two("site", plan.soles),
        loads=(left_load, right_load),
        sole_boxes=two("geom", plan.sole_boxes),
        held_qpos=tuple(int(model.jnt_qposadr[joint]) for joint in held),
        held_dof=tuple(int(model.jnt_dofadr[joint]) for joint in held),
        held_links=tuple(int(model.jnt_bodyid[joint]) for joint in held),
        held_motors=tuple(motor_of(model, joint) for joint in held) if driven else (),
    )
    for geom, name in zip(indices.sole_boxes, plan.sole_boxes, strict=True):
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_BOX:
            kind = mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
            raise InvalidValueError(
                f"sole {name!r} must be a box, got a {kind}; `spec` may put one under each foot in its place"
            )
    for dof in range(model.nv):
        if dof not in {*indices.dof, *indices.held_dof}:
            raise InvalidValueError(
                f"joint {model.joint(model.dof_jntid[dof]).name!r} has no role in the BodyPlan; name it in "
                "`held` with the angle that it shall keep"
            )
    _check_tree(model, indices)
    _check_waist(model, indices)
    return indices


def _check_tree(model: mujoco.MjModel, indices: Indices) -> None:
    """Raise InvalidValueError where base, waist and legs are no chains, but for held degrees of freedom.

    The two axes of the waist may follow each other in either order.
    """
    waist = sorted(indices.joints[1:3], key=lambda joint: model.jnt_dofadr[joint])
    chains = {"waist": waist, "left leg": indices.legs[0], "right leg": indices.legs[1]}
    for chain, joints in chains.items():
        before = indices.dof[5]
        for joint in joints:
            if joint == MISSING:
                continue
            own = int(model.jnt_dofadr[joint])
            parent = int(model.dof_parentid[own])
            while parent in indices.held_dof:
                parent = int(model.dof_parentid[parent])
            if parent != before:
                raise InvalidValueError(
                    f"the {chain} must be a chain of joints from the pelvis outward, each in the BodyPlan "
                    f"in this order or held; {model.joint(joint).name!r} does not follow the one before it"
                )
            before = own


def _check_waist(model: mujoco.MjModel, indices: Indices) -> None:
    """Raise InvalidValueError where the waist does not pitch about y and roll about x."""
    data = mujoco.MjData(model)
    data.qpos[list(indices.qpos[:7])] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    mujoco.mj_kinematics(model, data)
    for joint, axis in zip(indices.joints[1:3], ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)), strict=True):
        if joint != MISSING and np.abs(data.xaxis[joint] - axis).max() > TILT:
            raise InvalidValueError(
                f"waist joint {model.joint(joint).name!r} must turn about {axis} (pitch y, roll x), "
                f"got {data.xaxis[joint].round(6).tolist()}"
            )


def hinge(model: mujoco.MjModel, name: str) -> int:
    """Number of a hinge.

    Raises:
        UnknownNameError: no joint of that name.
        InvalidValueError: one of another kind.
    """
    joint = number_of(model, "joint", name)
    if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        raise InvalidValueError(f"joint {name!r} must be a hinge")
    return joint


def motor_of(model: mujoco.MjModel, joint: int) -> int:
    """Number of the torque motor that drives a joint.

    Raises:
        InvalidValueError: none, more than one, or one that does not give the torque that is asked of it.
    """
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    motors = np.flatnonzero(on_joint & (model.actuator_trnid[:, 0] == joint))
    name = model.joint(joint).name
    if len(motors) != 1:
        raise InvalidValueError(f"joint {name!r} must have one motor, got {len(motors)}")
    motor = int(motors[0])
    gear, gain = model.actuator_gear[motor, 0], model.actuator_gainprm[motor, 0]
    if gear != 1.0 or gain != 1.0 or model.actuator_biasprm[motor].any():
        raise InvalidValueError(
            f"the motor of joint {name!r} must give the torque that is asked of it: gear 1, gain 1, no bias, "
            f"got gear {gear:g}, gain {gain:g}, bias {model.actuator_biasprm[motor, :3].tolist()}"
        )
    return motor


Pairs = list[tuple[int, int]]


def inputs(indices: Indices) -> tuple[Field, ...]:
    """Torques, at last those of held joints that are driven, and forces on the bodies that pushes act on."""
    count = 1 + max(row for row, _ in _pushed_rows(indices))
    motors = (*indices.motors, *indices.held_motors)
    return picked("ctrl", (len(motors),), known(motors)), rows("xfrc_applied", count, 6, pushed_rows(indices))


def outputs(model: mujoco.MjModel, indices: Indices) -> tuple[Field, ...]:
    """State, kinematics, mass matrix, bias, loads and contact forces, in the order of `Physics`."""
    places = kinematics.PELVIS, kinematics.TRUNK, *kinematics.FOOT_BODY
    bodies = [*zip(places, (indices.pelvis, indices.trunk, *indices.feet), strict=True)]
    turned = _pushed_rows(indices)
    count = 1 + max(row for row, _ in turned)
    joints = known(indices.joints)
    # of the state what control knows, then the held joints, which make nominal dynamics of the whole robot
    qpos, qvel = (*indices.qpos, *indices.held_qpos), (*indices.dof, *indices.held_dof)
    return (
        picked("qpos", (len(qpos),), known(qpos)),
        picked("qvel", (len(qvel),), known(qvel)),
        rows("xpos", kinematics.BODIES, 3, bodies),
        rows("xmat", count, 9, turned),
        rows("xanchor", len(indices.joints), 3, joints),
        rows("xaxis", len(indices.joints), 3, joints),
        rows("subtree_com", kinematics.BODIES, 3, [(0, 0)]),
        picked("M", (kinematics.ENTRIES,), mass_matrix_pairs(model, indices)),
        picked("qfrc_bias", (len(indices.dof),), known(indices.dof)),
        picked("sensordata", (len(indices.loads),), known(indices.loads)),
        picked("qfrc_constraint", (len(indices.dof),), known(indices.dof)),
    )


def pushed_rows(indices: Indices) -> Pairs:
    """(row of `Physics.xfrc`, body) of every body that forces are written for."""
    pushed = _pushed_rows(indices)
    if indices.trunk == indices.pelvis:  # `BipedCore.assign` turns its pushes into the pelvis'
        pushed.remove((kinematics.TRUNK, indices.trunk))
    return pushed


def _pushed_rows(indices: Indices) -> Pairs:
    """(row, body) of every body that is pushed: links of held joints after the rows that any robot has."""
    own, bodies = kinematics.PUSHED_BODY, kinematics.BODIES
    more = range(bodies, bodies + len(indices.pushed) - len(own))
    return [*zip((*own, *more), indices.pushed, strict=True)]


def known(numbers: tuple[int, ...]) -> Pairs:
    """(place, number) of every part that the robot has."""
    return [(place, number) for place, number in enumerate(numbers) if number != MISSING]


def mass_matrix_pairs(model: mujoco.MjModel, indices: Indices) -> Iterator[tuple[int, int]]:
    """(entry as control has it, entry of MuJoCo's sparse M) by rows, from the model's own structure."""
    for j, own in enumerate(indices.dof):
        if own == MISSING:
            yield int(kinematics.ROW[j]) + len(kinematics.columns(j)) - 1, ONE
            continue
        for place, i in enumerate(kinematics.columns(j)):
            if indices.dof[i] != MISSING:
                yield int(kinematics.ROW[j]) + place, entry(model, own, indices.dof[i])


def entry(model: mujoco.MjModel, i: int, j: int) -> int:
    """Entry of MuJoCo's sparse M for two degrees of freedom on one chain, in the outer one's row."""
    outer, inner = max(i, j), min(i, j)
    first = int(model.M_rowadr[outer])
    return first + model.M_colind[first : first + int(model.M_rownnz[outer])].tolist().index(inner)
