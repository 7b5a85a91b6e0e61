"""The compiled biped and its posture for a given CoM and two footholds."""

from __future__ import annotations

import threading
from functools import lru_cache
from importlib.resources import files

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit
from ...controllers.errors import InvalidValueError
from ...controllers.whole_body.kinematics import LEG_DOF, Array
from .leg_kinematics import level_leg

PHYSICS_DT = 0.002  # [s]
MOVING_DOF = np.r_[0:3, LEG_DOF[0] : LEG_DOF[0] + 6, LEG_DOF[1] : LEG_DOF[1] + 6]  # of a posture
LEG_QPOS = (9, 15)  # first joint coordinate of the left and the right leg
CONVERGED = 1e-13  # error of the CoM of a posture [m]
SUNK = (
    1e-10  # soles of a posture lie this deep in the floor, or rounding would say which corners touch it [m]
)
FOLLOWS = 0.9  # how far the CoM moves, about, where the pelvis is shifted by 1 and the soles stay
SOLES = ("left_sole", "right_sole")


@lru_cache(maxsize=1)
def biped_model() -> mujoco.MjModel:
    """The biped of Table II; one compiled copy per process, never modified."""
    text = files("push_recovery.envs.assets").joinpath("biped.xml").read_text(encoding="utf-8")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = PHYSICS_DT
    return model


def motor_limits(model: mujoco.MjModel) -> Array:
    """Largest torque [N m] and speed without load [rad/s] of every motor, (2, 14)."""
    return np.array([model.actuator_forcerange[:, 1], model.actuator_user[:, 0]])


class _Scratch(threading.local):
    """A simulation for `posture`, one a thread: making one takes several times as long as a posture."""

    data: mujoco.MjData | None = None


_scratch = _Scratch()


@njit(cache=True)
def _place(pelvis, soles, qpos):  # pragma: no cover
    """Put the pelvis (3,) into qpos (21,) and the legs onto the soles (2, 3)."""
    qpos[:3] = pelvis
    for leg in range(2):
        level_leg(pelvis, 1.0 - 2.0 * leg, soles[leg], qpos[LEG_QPOS[leg] : LEG_QPOS[leg] + 6])


@njit(cache=True)
def _correct(com, found, soles, pelvis, qpos):  # pragma: no cover
    """Shift the pelvis (3,) where the CoM `found` (3,) is off `com` (3,); returns the error before [m]."""
    error = 0.0
    for i in range(3):
        error = max(error, abs(com[i] - found[i]))
    if not error < CONVERGED:
        for i in range(3):
            pelvis[i] += (com[i] - found[i]) / FOLLOWS
        _place(pelvis, soles, qpos)
    return error


def posture(com: Array, com_velocity: Array, soles: NDArray[np.float64]) -> tuple[Array, Array]:
    """Joint coordinates and velocities of an upright robot on two soles at rest.

    The CoM moves almost as the pelvis does, so shifting the pelvis by what the CoM is off converges, by a
    factor of about 20 each time, and MuJoCo says where it is.

    Args:
        com: CoM in the world, (3,) [m].
        com_velocity: (3,) [m/s].
        soles: centres of the left and right sole, (2, 3) [m], both level and at heading 0.

    Returns:
        qpos (21,) and qvel (20,): pelvis and trunk upright and not turning, both soles at rest.
    """
    model = biped_model()
    data = _scratch.data = _scratch.data or mujoco.MjData(model)
    com, soles = (np.array(value, dtype=np.float64) for value in (com, soles))
    soles[:, 2] -= SUNK
    qpos, found, pelvis = data.qpos, data.subtree_com[0], com - [0.0, 0.0, 0.06]
    qpos[3:9] = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    _place(pelvis, soles, qpos)
    error = np.inf
    for _ in range(50):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        error = _correct(com, found, soles, pelvis, qpos)
        if error < CONVERGED:
            break
    reached = data.site_xpos[_sole_sites()]
    if not max(error, np.abs(reached - soles).max()) <= 1e-9:
        raise InvalidValueError(f"no posture puts the CoM at {com.tolist()} m over soles {soles.tolist()}")
    return qpos.copy(), _velocity(model, data, com_velocity)


@lru_cache(maxsize=1)
def _sole_sites() -> list[int]:
    return [biped_model().site(name).id for name in SOLES]


def _velocity(model: mujoco.MjModel, data: mujoco.MjData, com_velocity: Array) -> Array:
    """Joint velocities (20,) for a velocity of the CoM; pelvis and trunk do not turn, the soles rest.

    The rows below are CoM, left sole and right sole; the unknowns the pelvis' velocity and the legs' twelve.
    """
    rows, wanted, velocity = np.zeros((15, model.nv)), np.zeros(15), np.zeros(model.nv)
    mujoco.mj_jacSubtreeCom(model, data, rows[:3], 0)
    for row, site in zip((3, 9), _sole_sites(), strict=True):
        mujoco.mj_jacSite(model, data, rows[row : row + 3], rows[row + 3 : row + 6], site)
    wanted[:3] = com_velocity
    velocity[MOVING_DOF] = np.linalg.solve(rows[:, MOVING_DOF], wanted)
    return velocity
