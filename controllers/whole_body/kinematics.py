"""Live arrays of n simulated bipeds; motion of pelvis, soles and CoM."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.array_table import Floats1, Floats2, Floats3, Ints1
from ..compiled.kernels import njit
from ..compiled.vector_3 import ZERO, Vector, add, cross, scaled, subtract, to_world, vector_at, vector_of

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# What control knows of any robot: a floating base, a waist of two axes, two legs of six joints. A robot's own
# numbers are found from the names in its body plan, and its values are put into these places.
NV, NU = 20, 14
BODIES, JOINTS = 9, 15  # places for bodies, the first of which is not in use, and for joints
LEG_DOF = (8, 14)  # first degree of freedom of the left and the right leg
LEG_JOINT = (3, 9)  # first joint (0 is the free joint, 1-2 the waist)
LEG_QPOS = (9, 15)  # first joint coordinate of the left and the right leg
WAIST_JOINT, WAIST_DOF = 1, 6
PELVIS, TRUNK = 1, 2  # bodies
FOOT_BODY = (5, 8)
PUSHED_BODY = (PELVIS, TRUNK, 3, 4, 5, 6, 7, 8)  # with thigh, shank and foot, in the order of push.BODIES
MEETING_AXES, ANY_AXES = 1, 0  # hip axes meet in a point, the ankle's too, and hip pitch, knee, ankle pitch
# are parallel, in the order yaw, roll, pitch, knee, pitch, roll: see `leg_inverse`
Heading = tuple[float, float]  # cosine and sine of a heading


class Physics(NamedTuple):
    """Live arrays of n simulations (`stepping`) and constants of their robot, in world axes and SI units."""

    qpos: Floats2  # (n, 21)
    qvel: Floats2  # (n, 20)
    xpos: Floats3  # (n, bodies, 3)
    xmat: Floats3  # (n, bodies, 9)
    xanchor: Floats3  # (n, joints, 3)
    xaxis: Floats3  # (n, joints, 3)
    com: Floats3  # (n, bodies, 3) CoM of each body's subtree
    mass_matrix: Floats2  # (n, nM) sparse; rows and columns in a table of their own
    bias: Floats2  # (n, 20) h(q, qd), gravity included
    load: Floats2  # (n, 2) normal force under the left and the right sole [N]
    ctrl: Floats2  # (n, 14) torques [N m], written by the controller
    xfrc: Floats3  # (n, bodies, 6) external force and torque at the body's CoM, written by the pushes
    soles: Floats2  # (2, 3) centre of each sole in the axes of its foot's body, from its origin [m]
    ankle_height: Floats1  # (1,) ankle above a flat sole [m]
    mirror: Floats1  # (14,) sign of each joint's coordinate in the mirrored robot
    leg_form: Ints1  # (1,) MEETING_AXES or ANY_AXES
    knee_bend: Floats1  # (2,) sign of a bent knee's coordinate; 0 for one that stops before it is straight


class SoleMotion(NamedTuple):
    """Where a sole is and how it moves, in world axes."""

    position: Vector  # [m]
    velocity: Vector  # [m/s]
    omega: Vector  # [rad/s]
    drift: Vector  # acceleration at qdd = 0, linear part of Jdot qd [m/s^2]
    turn_drift: Vector  # angular part of it [rad/s^2]


@njit(cache=True, forceinline=True)
def base_angular_velocity(phys: Physics, k: int) -> Vector:
    """Angular velocity of the pelvis in world axes [rad/s]."""
    return to_world(phys.xmat, k, PELVIS, (phys.qvel[k, 3], phys.qvel[k, 4], phys.qvel[k, 5]))


@njit(cache=True, forceinline=True)
def sole_position(phys: Physics, k: int, leg: int) -> Vector:
    """Centre of a sole in the world [m]."""
    body = FOOT_BODY[leg]
    return add(vector_at(phys.xpos, k, body), to_world(phys.xmat, k, body, vector_of(phys.soles[leg], 0)))


@njit(cache=True, forceinline=True)
def sole_motion(phys: Physics, k: int, leg: int, omega: Vector) -> SoleMotion:
    """Position, twist and drift of a sole by one pass from the pelvis, turning at omega, down the leg.

    A point d further along: velocity += omega x d, acceleration += alpha x d + omega x (omega x d); a joint:
    alpha += omega x axis rate, omega += axis rate.
    """
    joint, dof, meeting = LEG_JOINT[leg], LEG_DOF[leg], phys.leg_form[0] == MEETING_AXES
    point, sole = vector_at(phys.xpos, k, PELVIS), sole_position(phys, k, leg)
    velocity, drift, alpha = (phys.qvel[k, 0], phys.qvel[k, 1], phys.qvel[k, 2]), ZERO, ZERO
    for j in range(7):
        # where the three hip axes meet in a point, and the two of the ankle, four places are enough
        if not meeting or j == 0 or j == 3 or j == 4 or j == 6:
            end = vector_at(phys.xanchor, k, joint + j) if j < 6 else sole
            d = subtract(end, point)
            turn = cross(omega, d)
            velocity = add(velocity, turn)
            drift = add(drift, add(cross(alpha, d), cross(omega, turn)))
            point = end
        if j < 6:
            spin = scaled(vector_at(phys.xaxis, k, joint + j), phys.qvel[k, dof + j])
            alpha = add(alpha, cross(omega, spin))
            omega = add(omega, spin)
    return SoleMotion(sole, velocity, omega, drift, alpha)


@njit(cache=True, forceinline=True)
def upright_error(xmat: Array, k: int, body: int, facing: Heading) -> Vector:
    """Rotation that turns a body's axes upright and to the heading [rad], small angles."""
    cos, sin = facing
    x, y = xmat[k, body, 0], xmat[k, body, 3]
    return xmat[k, body, 5], -xmat[k, body, 2], math.atan2(sin * x - cos * y, cos * x + sin * y)
