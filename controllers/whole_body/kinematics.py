"""Kinematics of the biped: live arrays, motion of pelvis, soles and CoM, inverse of a leg, mass matrix.

A leg whose three hip axes meet in one point and whose two ankle axes meet in another, with hip pitch, knee
and ankle pitch parallel, has an inverse in closed form. Seen from the pelvis, ankle and foot move by

    v = hip x r + knee s,    omega = hip + (knee + ankle_pitch) pitch + ankle_roll roll,

with hip the rotation that the three hip joints make together, r = ankle - hip and s the velocity of the ankle
per rate of the knee. The part of v along r is the knee's alone, what is across fixes the hip's rotation but
for that about r; what is left of omega divides between r and the two ankle axes.

A leg of other axes is solved with all six columns of its Jacobian. With the knee's column replaced by a
motion of the sole along r, the row of the inverse that belongs to it is n', the wrench that no other joint
feels, and c = n' J_knee the velocity along it per rate of the knee: the same c as above where the axes meet.

A knee that can go beyond straight counts as bent as much there: c keeps the sign that it has where the knee
is bent. With its true sign a leg that shall become shorter presses its knee into the stop.

Row j of the sparse mass matrix holds the columns of the base, 0 to 5, then those of its own chain (waist or
leg) up to the diagonal; the chains do not couple with each other.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numba.np.numpy_support import carray
from numpy.typing import NDArray

from .. import math3
from ..array_table import COMMON, Floats1, Floats2, Floats3, Ints1
from ..jit import njit
from ..math3 import ZERO, Vector, add, cross, dot, scaled, stack_floats, subtract, to_world, vector_at

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# What control knows of any robot: a floating base, a waist of two axes, two legs of six joints. A robot's own
# numbers are found from the names in its body plan, and its values are put into these places.
NV, NU = 20, 14
BODIES, JOINTS = 9, 15  # places for bodies, the first of which is not in use, and for joints
LEG_DOF = (8, 14)  # first degree of freedom of the left and the right leg
LEG_JOINT = (3, 9)  # first joint (0 is the free joint, 1-2 the waist)
WAIST_JOINT, WAIST_DOF = 1, 6
PELVIS, TRUNK = 1, 2  # bodies
FOOT_BODY = (5, 8)
PUSHED_BODY = (PELVIS, TRUNK, 3, 4, 5, 6, 7, 8)  # with thigh, shank and foot, in the order of push.BODIES
MEETING_AXES, ANY_AXES = 1, 0  # hip axes meet in a point, the ankle's too, and hip pitch, knee, ankle pitch
# are parallel, in the order yaw, roll, pitch, knee, pitch, roll: see `write_leg_inverse`
Heading = tuple[float, float]  # cosine and sine of a heading


class Physics(NamedTuple):
    """Live arrays of n simulations and constants of their robot, in world axes and SI units."""

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
    soles: Annotated[Floats2, COMMON]  # (2, 3) centre of each sole in its foot's axes, from their origin [m]
    ankle_height: Annotated[Floats1, COMMON]  # (1,) ankle above a flat sole [m]
    mirror: Annotated[Floats1, COMMON]  # (14,) sign of each joint's coordinate in the mirrored robot
    leg_form: Annotated[Ints1, COMMON]  # (1,) MEETING_AXES or ANY_AXES
    # (2,) sign of a bent knee's coordinate; 0 for one that stops before it is straight
    knee_bend: Annotated[Floats1, COMMON]


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
    return to_world(phys.xmat, k, PELVIS, math3.vector_in(phys.qvel, k, 3))


@njit(cache=True, forceinline=True)
def sole_position(phys: Physics, k: int, leg: int) -> Vector:
    """Centre of a sole in the world [m]."""
    body = FOOT_BODY[leg]
    return add(
        vector_at(phys.xpos, k, body), to_world(phys.xmat, k, body, math3.vector_of(phys.soles[leg], 0))
    )


@njit(cache=True, forceinline=True)
def sole_motion(phys: Physics, k: int, leg: int, omega: Vector) -> SoleMotion:
    """Position, twist and drift of a sole by one pass from the pelvis, turning at omega, down the leg.

    A point d further along: velocity += omega x d, acceleration += alpha x d + omega x (omega x d); a joint:
    alpha += omega x axis rate, omega += axis rate.
    """
    joint, dof, meeting = LEG_JOINT[leg], LEG_DOF[leg], phys.leg_form[0] == MEETING_AXES
    point, sole = vector_at(phys.xpos, k, PELVIS), sole_position(phys, k, leg)
    velocity, drift, alpha = math3.vector_in(phys.qvel, k, 0), ZERO, ZERO
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


class LegInverses(NamedTuple):
    """J^-1 of both legs: rate of joint i = velocity[leg, i] . v + omega[leg, i] . omega."""

    velocity: Array  # (2, 6, 3) [1/m]
    omega: Array  # (2, 6, 3)


YAW_ROLL_PITCH_AXES = (
    (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0),
)  # of a leg's joints in the reference posture, from hip to sole  # fmt: skip
SMALLEST = 1e-6  # pivot
YAW, ROLL, PITCH, KNEE, ANKLE_PITCH, ANKLE_ROLL = range(6)  # joints of a leg


@njit(cache=True, forceinline=True)
def _knee_rate(phys: Physics, leg: int, stretch: float, damping: float) -> float:
    """Rate of a knee per velocity along the leg, 1 / c with c = `stretch`, bounded near a straight one [1/m].

    A knee that can go beyond straight has the c of one that is bent.
    """
    bend = phys.knee_bend[leg]
    c = stretch if bend == 0.0 else -bend * abs(stretch)
    return c / (c * c + damping)


@njit(cache=True, forceinline=True)
def _across(y: Vector, along: Vector, s: Vector, knee: Vector, length: float) -> Vector:
    """Product with v that gives y . (along x (v - s knee . v)) / length, the rotation of r about y."""
    out = cross(y, along)
    return scaled(subtract(out, scaled(knee, dot(out, s))), 1.0 / length)


@njit(cache=True, forceinline=True)
def _write_row(inverses: LegInverses, leg: int, joint: int, v: Vector, omega: Vector, offset: Vector) -> None:
    """Write a row of J^-1 whose joint has the rate v . (velocity of the ankle) + omega . (rotation)."""
    turn = subtract(omega, cross(offset, v))
    for i in range(3):
        inverses.velocity[leg, joint, i] = v[i]
        inverses.omega[leg, joint, i] = turn[i]


@njit(cache=True, forceinline=True)
def write_leg_inverse(
    phys: Physics, k: int, leg: int, sole: Vector, damping: float, inverses: LegInverses
) -> None:
    """Write J^-1 of a leg: rates of its joints from the twist of its sole relative to the pelvis.

    1 / c becomes c / (c^2 + damping), c the velocity of the ankle along the leg per rate of the knee [m]:
    that bounds the rates near a straight knee.
    """
    if phys.leg_form[0] == MEETING_AXES:
        write_inverse_of_meeting_axes(phys, k, leg, sole, damping, inverses)
    else:
        write_inverse_of_any_axes(phys, k, leg, sole, damping, inverses)


@njit(cache=True, forceinline=True)
def write_inverse_of_meeting_axes(
    phys: Physics, k: int, leg: int, sole: Vector, damping: float, inverses: LegInverses
) -> None:
    """`write_leg_inverse` in closed form."""
    first = LEG_JOINT[leg]
    hip, shank = vector_at(phys.xanchor, k, first), vector_at(phys.xanchor, k, first + KNEE)
    ankle = vector_at(phys.xanchor, k, first + ANKLE_PITCH)
    yaw, roll = vector_at(phys.xaxis, k, first + YAW), vector_at(phys.xaxis, k, first + ROLL)
    pitch, foot = vector_at(phys.xaxis, k, first + PITCH), vector_at(phys.xaxis, k, first + ANKLE_ROLL)
    r, s, offset = subtract(ankle, hip), cross(pitch, subtract(ankle, shank)), subtract(sole, ankle)
    length = math.sqrt(dot(r, r))
    along = scaled(r, 1.0 / length)
    stretch = dot(along, s)
    knee = scaled(along, _knee_rate(phys, leg, stretch, damping))
    _write_row(inverses, leg, KNEE, knee, ZERO, offset)
    about_leg, about_pitch, about_foot = math3.dual_basis(along, pitch, foot)
    spin = _across(about_leg, along, s, knee, length)  # rotation about r is about_leg . omega - spin . v
    v = add(knee, _across(about_pitch, along, s, knee, length))
    _write_row(inverses, leg, ANKLE_PITCH, scaled(v, -1.0), about_pitch, offset)
    v = _across(about_foot, along, s, knee, length)
    _write_row(inverses, leg, ANKLE_ROLL, scaled(v, -1.0), about_foot, offset)
    rows = math3.dual_basis(yaw, roll, pitch)
    for i in range(3):
        share = dot(rows[i], along)
        v = subtract(_across(rows[i], along, s, knee, length), scaled(spin, share))
        _write_row(inverses, leg, YAW + i, v, scaled(about_leg, share), offset)


@njit(cache=True)
def write_inverse_of_any_axes(
    phys: Physics, k: int, leg: int, sole: Vector, damping: float, inverses: LegInverses
) -> None:
    """`write_leg_inverse` from the leg's whole Jacobian."""
    first = LEG_JOINT[leg]
    J, inverse = carray(stack_floats(36), (6, 6)), carray(stack_floats(36), (6, 6))
    for j in range(6):
        axis = vector_at(phys.xaxis, k, first + j)
        linear = cross(axis, subtract(sole, vector_at(phys.xanchor, k, first + j)))
        for i in range(3):
            J[i, j], J[3 + i, j] = linear[i], axis[i]
    knee_v, knee_omega = (J[0, KNEE], J[1, KNEE], J[2, KNEE]), (J[3, KNEE], J[4, KNEE], J[5, KNEE])
    hip, ankle = vector_at(phys.xanchor, k, first), vector_at(phys.xanchor, k, first + ANKLE_PITCH)
    r = subtract(ankle, hip)
    along = scaled(r, 1.0 / math.sqrt(dot(r, r)))
    for i in range(3):
        J[i, KNEE], J[3 + i, KNEE] = along[i], 0.0
    invert_6(J, inverse)
    n_v, n_omega = math3.vector_of(inverse[KNEE], 0), math3.vector_of(inverse[KNEE], 3)
    stretch = dot(n_v, knee_v) + dot(n_omega, knee_omega)
    gain = _knee_rate(phys, leg, stretch, damping)
    for j in range(6):
        v, omega = math3.vector_of(inverse[j], 0), math3.vector_of(inverse[j], 3)
        share = gain if j == KNEE else -gain * (dot(v, knee_v) + dot(omega, knee_omega))
        kept = 0.0 if j == KNEE else 1.0
        for i in range(3):
            inverses.velocity[leg, j, i] = kept * v[i] + share * n_v[i]
            inverses.omega[leg, j, i] = kept * omega[i] + share * n_omega[i]


@njit(cache=True)
def invert_6(A: Array, inverse: Array) -> None:
    """Write the inverse of A (6, 6), which is used up: Gauss-Jordan elimination, pivots by columns.

    A pivot below SMALLEST counts as SMALLEST: rates stay finite in a posture where the leg is singular.
    """
    for i in range(6):
        for j in range(6):
            inverse[i, j] = 1.0 if i == j else 0.0
    for c in range(6):
        best = c
        for i in range(c + 1, 6):
            if abs(A[i, c]) > abs(A[best, c]):
                best = i
        for j in range(6):
            A[c, j], A[best, j] = A[best, j], A[c, j]
            inverse[c, j], inverse[best, j] = inverse[best, j], inverse[c, j]
        pivot = A[c, c] if abs(A[c, c]) > SMALLEST else math.copysign(SMALLEST, A[c, c])
        for j in range(6):
            A[c, j] /= pivot
            inverse[c, j] /= pivot
        for i in range(6):
            if i != c:
                factor = A[i, c]
                for j in range(6):
                    A[i, j] -= factor * A[c, j]
                    inverse[i, j] -= factor * inverse[c, j]


@njit(cache=True, forceinline=True)
def subtract_leg_torques(phys: Physics, k: int, leg: int, sole: Vector, wrench: Array, torque: Array) -> None:
    """Subtract J' w from the torques (14,) for the wrench (6,) on a sole."""
    force, moment, at = math3.vector_of(wrench, 0), math3.vector_of(wrench, 3), 2 + 6 * leg
    for j in range(6):
        arm = subtract(sole, vector_at(phys.xanchor, k, LEG_JOINT[leg] + j))
        torque[at + j] -= dot(vector_at(phys.xaxis, k, LEG_JOINT[leg] + j), add(moment, cross(arm, force)))


BASE = 6  # degrees of freedom of the free joint
# Where a row's chain begins
CHAIN = np.array([0] * BASE + [WAIST_DOF] * 2 + [LEG_DOF[0]] * 6 + [LEG_DOF[1]] * 6)
_LENGTH = [j + 1 if j < BASE else BASE + 1 + j - CHAIN[j] for j in range(NV)]
ROW = np.concatenate([[0], np.cumsum(_LENGTH)[:-1]])  # first entry of every row
ENTRIES = int(sum(_LENGTH))
DIAGONAL = ROW + np.array(_LENGTH) - 1  # entry of M[j, j]


def columns(j: int) -> list[int]:
    """Columns of the entries in row j, the diagonal last."""
    return [*range(min(j, BASE)), *range(int(CHAIN[j]) if j >= BASE else j, j + 1)]


@njit(cache=True, forceinline=True)
def linear_entry(phys: Physics, k: int, j: int) -> Vector:
    """M[0:3, j], j >= 3: linear momentum per rate of degree of freedom j."""
    return math3.vector_in(phys.mass_matrix, k, ROW[j])


@njit(cache=True, forceinline=True)
def turning_momentum(phys: Physics, k: int, rates: Array) -> Vector:
    """Linear momentum at the rates (20,) less that of the pelvis' translation, M[0:3, 3:] rates[3:] [N s]."""
    total = ZERO
    for j in range(3, NV):
        total = add(total, scaled(linear_entry(phys, k, j), rates[j]))
    return total


@njit(cache=True, forceinline=True)
def com_velocity(phys: Physics, k: int) -> Vector:
    """Velocity of the whole body's CoM, M[0:3] qd / m [m/s]."""
    relative = scaled(turning_momentum(phys, k, phys.qvel[k]), 1.0 / phys.mass_matrix[k, 0])
    return add(math3.vector_in(phys.qvel, k, 0), relative)


@njit(cache=True, forceinline=True)
def com_compliance(phys: Physics, k: int, inverses: LegInverses) -> tuple[Vector, Vector, Vector]:
    """Rows of (m I - sum over legs M[0:3, leg] J^-1[:, 0:3])^-1, (3, 3) [1/kg].

    They give the acceleration of the pelvis per force on the CoM while the soles keep theirs.
    """
    mass = phys.mass_matrix[k, 0]
    x, y, z = (mass, 0.0, 0.0), (0.0, mass, 0.0), (0.0, 0.0, mass)
    for leg in range(2):
        for i in range(6):
            entry, rate = linear_entry(phys, k, LEG_DOF[leg] + i), vector_at(inverses.velocity, leg, i)
            x = subtract(x, scaled(entry, rate[0]))
            y = subtract(y, scaled(entry, rate[1]))
            z = subtract(z, scaled(entry, rate[2]))
    return math3.dual_basis(x, y, z)


@njit(cache=True, forceinline=True)
def write_generalised_force(phys: Physics, k: int, qdd: Array, out: Array) -> None:
    """Write M(q) qdd + h(q, qd), (20,)."""
    for j in range(NV):
        row, own, total = ROW[j], qdd[j], phys.bias[k, j]
        for c in range(min(j, BASE)):
            entry = phys.mass_matrix[k, row + c]
            total += entry * qdd[c]
            out[c] += entry * own
        if j >= BASE:
            first = CHAIN[j]
            row += BASE - first
            for c in range(first, j):
                entry = phys.mass_matrix[k, row + c]
                total += entry * qdd[c]
                out[c] += entry * own
        out[j] = total + phys.mass_matrix[k, row + j] * own


TASKS = 14  # com x, y, z; pelvis x, y, z; swing sole linear, angular; waist pitch, roll
PELVIS_TASK, SWING_TASK, WAIST_TASK = 3, 6, 12


class Legs(NamedTuple):
    """The legs of one robot as the tasks use them."""

    stance: int
    left: Vector  # positions of the soles [m]
    right: Vector
    inverses: LegInverses
    compliance: tuple[Vector, Vector, Vector]  # see `com_compliance`


@njit(cache=True, forceinline=True)
def write_rates(phys: Physics, k: int, legs: Legs, X: Array) -> None:
    """Write how qdd follows the deviation, (20, 14), the pelvis not accelerating."""
    X[:] = 0.0
    for i in range(3):
        for c in range(3):
            X[3 + i, PELVIS_TASK + c] = phys.xmat[k, PELVIS, 3 * c + i]
    base = vector_at(phys.xpos, k, PELVIS)
    for leg in range(2):
        arm = subtract(legs.left if leg == 0 else legs.right, base)
        for i in range(6):
            j = LEG_DOF[leg] + i
            v, omega = vector_at(legs.inverses.velocity, leg, i), vector_at(legs.inverses.omega, leg, i)
            turn = add(cross(arm, v), omega)
            for c in range(3):
                X[j, PELVIS_TASK + c] = -turn[c]
                if leg != legs.stance:
                    X[j, SWING_TASK + c], X[j, SWING_TASK + 3 + c] = v[c], omega[c]
    X[WAIST_DOF, WAIST_TASK] = X[WAIST_DOF + 1, WAIST_TASK + 1] = 1.0


@njit(cache=True, forceinline=True)
def accelerate_pelvis_for_tasks(phys: Physics, k: int, legs: Legs, X: Array) -> None:
    """Give every column of X (20, 14) the acceleration of the pelvis that the CoM's task asks for."""
    force = carray(stack_floats(42), (3, TASKS))  # on the CoM, what the column lacks of it
    force[:] = 0.0
    for i in range(3):
        force[i, i] = phys.mass_matrix[k, 0]
    for j in range(3, NV):
        entry = linear_entry(phys, k, j)
        for c in range(TASKS):
            force[0, c] -= entry[0] * X[j, c]
        for c in range(TASKS):
            force[1, c] -= entry[1] * X[j, c]
        for c in range(TASKS):
            force[2, c] -= entry[2] * X[j, c]
    for i in range(3):
        row = legs.compliance[i]
        for c in range(TASKS):
            X[i, c] = row[0] * force[0, c] + row[1] * force[1, c] + row[2] * force[2, c]
    for leg in range(2):
        for i in range(6):
            j, v = LEG_DOF[leg] + i, vector_at(legs.inverses.velocity, leg, i)
            for c in range(TASKS):
                X[j, c] -= v[0] * X[0, c] + v[1] * X[1, c] + v[2] * X[2, c]


@njit(cache=True, forceinline=True)
def mass_times(phys: Physics, k: int, X: Array, out: Array) -> None:
    """Write M X, (20, 14)."""
    for j in range(NV):
        row, first = ROW[j], CHAIN[j]
        before = j if j < BASE else BASE + j - first  # entries left of the diagonal
        diagonal = phys.mass_matrix[k, row + before]
        for c in range(TASKS):
            out[j, c] = diagonal * X[j, c]
        for e in range(before):
            i, entry = e if e < BASE else first + e - BASE, phys.mass_matrix[k, row + e]
            for c in range(TASKS):
                out[j, c] += entry * X[i, c]
            for c in range(TASKS):
                out[i, c] += entry * X[j, c]


@njit(cache=True, forceinline=True)
def write_force_maps(phys: Physics, k: int, sole: Vector, X: Array, wrench: Array, torque: Array) -> None:
    """Write M X as the total wrench at a sole (6, 14) and the forces on the joints (14, 14)."""
    total = carray(stack_floats(280), (NV, TASKS))
    mass_times(phys, k, X, total)
    arm = subtract(vector_at(phys.xpos, k, PELVIS), sole)
    for c in range(TASKS):
        force = total[0, c], total[1, c], total[2, c]
        turn = to_world(phys.xmat, k, PELVIS, (total[3, c], total[4, c], total[5, c]))
        moment = add(cross(arm, force), turn)
        wrench[0, c], wrench[1, c], wrench[2, c] = force
        wrench[3, c], wrench[4, c], wrench[5, c] = moment
    for i in range(NU):
        for c in range(TASKS):
            torque[i, c] = total[BASE + i, c]


@njit(cache=True, forceinline=True)
def subtract_leg_maps(phys: Physics, k: int, leg: int, sole: Vector, wrench: Array, torque: Array) -> None:
    """`subtract_leg_torques` for every column of wrenches (6, 14) and torques (14, 14)."""
    for i in range(6):
        joint, row = LEG_JOINT[leg] + i, LEG_DOF[leg] - BASE + i
        axis = vector_at(phys.xaxis, k, joint)
        lever = cross(axis, subtract(sole, vector_at(phys.xanchor, k, joint)))
        for c in range(TASKS):
            torque[row, c] -= lever[0] * wrench[0, c] + lever[1] * wrench[1, c] + lever[2] * wrench[2, c]
            torque[row, c] -= axis[0] * wrench[3, c] + axis[1] * wrench[4, c] + axis[2] * wrench[5, c]


@njit(cache=True)
def write_deviation_maps(phys: Physics, k: int, legs: Legs, wrench: Array, torque: Array) -> None:
    """Write W_d (6, 14) and T_d (14, 14): how wrench and torque follow a deviation from the tasks."""
    X = carray(stack_floats(280), (NV, TASKS))
    write_rates(phys, k, legs, X)
    accelerate_pelvis_for_tasks(phys, k, legs, X)
    sole = legs.left if legs.stance == 0 else legs.right
    write_force_maps(phys, k, sole, X, wrench, torque)
    subtract_leg_maps(phys, k, legs.stance, sole, wrench, torque)
