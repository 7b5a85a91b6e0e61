"""How wrench and torques of the whole body follow a deviation from its tasks."""

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from typing import NamedTuple

from numba.np.numpy_support import carray

from ..compiled.kernels import njit
from ..compiled.stack_array import stack_floats
from ..compiled.vector_3 import Vector, add, cross, subtract, to_world, vector_at
from .kinematics import LEG_DOF, LEG_JOINT, NU, NV, PELVIS, WAIST_DOF, Array, Physics
from .leg_inverse import LegInverses
from .mass_matrix import BASE, CHAIN, ROW, linear_entry

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


@njit(cache=True)
def write_deviation_maps(phys: Physics, k: int, legs: Legs, wrench: Array, torque: Array) -> None:
    """Write W_d (6, 14) and T_d (14, 14): how wrench and torque follow a deviation from the tasks."""
    X, total = carray(stack_floats(280), (NV, TASKS)), carray(stack_floats(280), (NV, TASKS))
    write_rates(phys, k, legs, X)
    accelerate_pelvis_for_tasks(phys, k, legs, X)
    mass_times(phys, k, X, total)
    sole = legs.left if legs.stance == 0 else legs.right
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
    for i in range(6):
        joint, row = LEG_JOINT[legs.stance] + i, LEG_DOF[legs.stance] - BASE + i
        axis = vector_at(phys.xaxis, k, joint)
        lever = cross(axis, subtract(sole, vector_at(phys.xanchor, k, joint)))
        for c in range(TASKS):
            torque[row, c] -= lever[0] * wrench[0, c] + lever[1] * wrench[1, c] + lever[2] * wrench[2, c]
            torque[row, c] -= axis[0] * wrench[3, c] + axis[1] * wrench[4, c] + axis[2] * wrench[5, c]
