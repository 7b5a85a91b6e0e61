"""Live arrays of n simulated bipeds, and the motion of their soles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NV, NU = 20, 14
LEG_DOF = (8, 14)  # first degree of freedom of the left and the right leg
LEG_JOINT = (3, 9)  # first joint (0 is the free joint, 1-2 the waist)
WAIST_JOINT, WAIST_DOF = 1, 6
PELVIS, TRUNK = 1, 2  # bodies
FOOT_BODY = (5, 8)
ANKLE_HEIGHT = 0.06  # ankle above the sole [m]


class Physics(NamedTuple):
    """Live arrays of n simulations (`simulations`), in world axes and SI units."""

    qpos: Array  # (n, 21)
    qvel: Array  # (n, 20)
    xpos: Array  # (n, bodies, 3)
    xmat: Array  # (n, bodies, 9)
    xanchor: Array  # (n, joints, 3)
    xaxis: Array  # (n, joints, 3)
    com: Array  # (n, bodies, 3) CoM of each body's subtree
    mass_matrix: Array  # (n, nM) sparse; rows and columns in a table of their own
    bias: Array  # (n, 20) h(q, qd), gravity included
    load: Array  # (n, 2) normal force under the left and the right sole [N]
    ctrl: Array  # (n, 14) torques [N m], written by the controller
    xfrc: Array  # (n, bodies, 6) external force and torque at the body's CoM, written by the pushes


class SoleMotion(NamedTuple):
    """Where a sole is and how its leg moves it; twists have the linear part first."""

    position: Array  # (3,) [m]
    jacobian: Array  # (6, 6) of the six leg joints
    twist: Array  # (6,) [m/s, rad/s]
    drift: Array  # (6,) Jdot qd [m/s^2, rad/s^2]


@njit(cache=True)
def cross_into(a: Array, b: Array, out: Array) -> None:
    """Write a x b into out, (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def base_angular_velocity(phys: Physics, k: int) -> Array:
    """Angular velocity of the pelvis in world axes, (3,) [rad/s]."""
    out = np.zeros(3)
    for i in range(3):
        for j in range(3):
            out[i] += phys.xmat[k, PELVIS, 3 * i + j] * phys.qvel[k, 3 + j]
    return out


@njit(cache=True)
def sole_position(phys: Physics, k: int, leg: int) -> Array:
    """Centre of a sole in the world, (3,) [m]."""
    body = FOOT_BODY[leg]
    out = np.empty(3)
    for i in range(3):
        out[i] = phys.xpos[k, body, i] - ANKLE_HEIGHT * phys.xmat[k, body, 3 * i + 2]
    return out


@njit(cache=True)
def sole_motion(phys: Physics, k: int, leg: int, base_omega: Array) -> SoleMotion:
    """Position, Jacobian, twist and drift of a sole by one pass from the pelvis down the leg."""
    point = sole_position(phys, k, leg)
    J = np.empty((6, 6))
    twist, drift = np.zeros(6), np.zeros(6)
    twist[:3] = phys.qvel[k, :3]
    twist[3:] = base_omega
    velocity, omega, acc, alpha = twist[:3], twist[3:], drift[:3], drift[3:]
    d, wd, term = np.empty(3), np.empty(3), np.empty(3)
    for j in range(7):
        for i in range(3):
            end = phys.xanchor[k, LEG_JOINT[leg] + j, i] if j < 6 else point[i]
            start = phys.xanchor[k, LEG_JOINT[leg] + j - 1, i] if j > 0 else phys.xpos[k, PELVIS, i]
            d[i] = end - start
        cross_into(omega, d, wd)
        cross_into(alpha, d, term)
        acc += term
        cross_into(omega, wd, term)
        acc += term
        velocity += wd
        if j < 6:
            axis = phys.xaxis[k, LEG_JOINT[leg] + j]
            rate = phys.qvel[k, LEG_DOF[leg] + j]
            cross_into(omega, axis, term)
            for i in range(3):
                alpha[i] += term[i] * rate
                omega[i] += axis[i] * rate
                J[3 + i, j] = axis[i]
                d[i] = point[i] - phys.xanchor[k, LEG_JOINT[leg] + j, i]
            cross_into(axis, d, term)
            J[:3, j] = term
    return SoleMotion(point, J, twist, drift)


@njit(cache=True)
def com_velocity(phys: Physics, k: int, index: Ints) -> Array:
    """Velocity of the whole body's CoM, M[0:3] qd / m, (3,) [m/s]."""
    out = np.zeros(3)
    mass = 1.0
    for e in range(index.shape[0]):
        i, j = index[e, 0], index[e, 1]
        if i == 0 and j == 0:
            mass = phys.mass_matrix[k, e]
        if i < 3:
            out[i] += phys.mass_matrix[k, e] * phys.qvel[k, j]
        elif j < 3:
            out[j] += phys.mass_matrix[k, e] * phys.qvel[k, i]
    return out / mass


@njit(cache=True)
def upright_error(R: Array, heading: float, out: Array) -> None:
    """Write the rotation that turns the axes R (9,) upright and to the heading, (3,) [rad], small angles."""
    out[0] = R[5]
    out[1] = -R[2]
    yaw = np.arctan2(R[3], R[0])
    out[2] = np.arctan2(np.sin(heading - yaw), np.cos(heading - yaw))
