"""The sparse mass matrix of a biped, and products with it.

Row j holds the columns of the base, 0 to 5, then those of its own chain (waist or leg) up to the diagonal;
the chains do not couple with each other.
"""

from __future__ import annotations

import numpy as np

from ..compiled.kernels import njit
from ..compiled.vector_3 import ZERO, Vector, add, dual_basis, scaled, subtract, vector_at, vector_in
from .kinematics import LEG_DOF, NV, WAIST_DOF, Array, Physics
from .leg_inverse import LegInverses

BASE = 6  # degrees of freedom of the free joint
CHAIN = np.array(
    [0] * BASE + [WAIST_DOF] * 2 + [LEG_DOF[0]] * 6 + [LEG_DOF[1]] * 6
)  # where a row's chain begins
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
    row = ROW[j]
    return phys.mass_matrix[k, row], phys.mass_matrix[k, row + 1], phys.mass_matrix[k, row + 2]


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
    return add(vector_in(phys.qvel, k, 0), relative)


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
    return dual_basis(x, y, z)


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
