"""The compiled biped and its posture for a given CoM and two footholds."""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..controllers.errors import InvalidValueError
from .biped_kinematics import LEG_DOF, Array, Ints
from .leg_kinematics import HIP_DROP, HIP_OFFSET, leg_joints

PHYSICS_DT = 0.002  # [s]
LEG_QPOS = (9, 15)  # first joint coordinate of the left and the right leg
SOLES = ("left_sole", "right_sole")


@lru_cache(maxsize=1)
def biped_model() -> mujoco.MjModel:
    """The biped of Table II; one compiled copy per process, never modified."""
    text = files("push_recovery.envs.assets").joinpath("biped.xml").read_text(encoding="utf-8")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = PHYSICS_DT
    return model


@lru_cache(maxsize=1)
def mass_matrix_index() -> Ints:
    """Row and column of every stored entry of the sparse mass matrix, (nM, 2)."""
    model = biped_model()
    rows = np.repeat(np.arange(model.nv), model.M_rownnz)
    return np.stack([rows, model.M_colind], axis=1).astype(np.int64)


def posture(com: Array, com_velocity: Array, soles: NDArray[np.float64]) -> tuple[Array, Array]:
    """Joint coordinates and velocities of an upright robot on two soles at rest.

    Args:
        com: CoM in the world, (3,) [m].
        com_velocity: (3,) [m/s].
        soles: centres of the left and right sole, (2, 3) [m], both level and at heading 0.

    Returns:
        qpos (21,) and qvel (20,): pelvis and trunk upright and not turning, both soles at rest.
    """
    model, data = biped_model(), mujoco.MjData(biped_model())
    pelvis = np.array([com[0], com[1], com[2] - 0.06])
    error = np.full(3, np.inf)
    for _ in range(50):
        data.qpos[:3], data.qpos[3:7], data.qpos[7:9] = pelvis, (1, 0, 0, 0), 0
        for leg, side in enumerate((1.0, -1.0)):
            hip = pelvis + np.array([0.0, side * HIP_OFFSET, -HIP_DROP])
            joints = leg_joints(hip, np.eye(3), soles[leg], np.eye(3))
            data.qpos[LEG_QPOS[leg] : LEG_QPOS[leg] + 6] = joints
        mujoco.mj_fwdPosition(model, data)
        error = com - data.subtree_com[0]
        pelvis = pelvis + error
        if np.abs(error).max() < 1e-13:
            break
    reached = np.array([data.site(name).xpos for name in SOLES])
    if max(np.abs(error).max(), np.abs(reached - soles).max()) > 1e-9:
        raise InvalidValueError(f"no posture puts the CoM at {com.tolist()} m over soles {soles.tolist()}")
    # qvel = J v, v the velocity of the pelvis: base rows are the identity, leg rows keep the soles at rest
    J = np.zeros((model.nv, 3))
    J[:3] = np.eye(3)
    for leg in range(2):
        sole = np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, data, sole[:3], sole[3:], model.site(SOLES[leg]).id)
        joints = slice(LEG_DOF[leg], LEG_DOF[leg] + 6)
        J[joints] = -np.linalg.solve(sole[:, joints], sole[:, :3])
    com_jacobian = np.zeros((3, model.nv))
    mujoco.mj_jacSubtreeCom(model, data, com_jacobian, 0)
    velocity = J @ np.linalg.solve(com_jacobian @ J, np.asarray(com_velocity, dtype=np.float64))
    return data.qpos.copy(), velocity
