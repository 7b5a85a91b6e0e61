"""Constants, tables and scratch of the compiled loop of stage 2, as three arrays and by name.

Numba unpacks every array of a call, about 0.1 us each, together more than a plan takes. So all constants and
tables come as one array of numbers and one of counts, and the scratch memory as a third.
"""

# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ..compiled.kernels import njit
from .tables import Tables

HANDLE = 6  # length of a solver's handle
HEADER = 7  # counts before the tables of integers
DIRECTIONS = 4  # of `tables`


class Constants(NamedTuple):
    """Scalars of the compiled loop."""

    omega: float
    cmp_per_acceleration: float
    cop_x: float  # bounds [m]
    cop_y: float
    acceleration: float  # [rad/s^2]
    torque: float  # tau_max / j [rad/s^2]
    gravity: float  # gravity torque per sin(lean) / j [rad/s^2]
    angle: float  # [rad]
    dt: float
    first_min: float
    beta_cop: float
    beta_trunk: float
    use_cop: bool
    use_trunk: bool


class Memory(NamedTuple):
    """Scratch of the compiled loop; rewritten by every solve."""

    matrices: NDArray[np.float64]  # (E, rows * n)
    handles: NDArray[np.int64]  # (E, 6)
    lower: NDArray[np.float64]  # (rows,)
    upper: NDArray[np.float64]
    optimum: NDArray[np.float64]  # (rows,): A u of the unconstrained optimum u
    solution: NDArray[np.float64]  # (n,)


SCALARS = len(Constants._fields)
NUMBERS = SCALARS - 2  # the flags are the last of them


def packed_numbers(c: Constants, tables: Tables) -> NDArray[np.float64]:
    """Constants and tables as one array."""
    arrays = (tables.steps, tables.inputs, tables.angles, tables.weights, tables.gram)
    return np.concatenate([np.array(c, dtype=np.float64), *(array.ravel() for array in arrays)])


def packed_counts(tables: Tables, memory: Memory) -> NDArray[np.int64]:
    """Sizes, integer tables and the handles of the memory's solvers as one array."""
    sizes = [
        len(tables.rest), tables.steps.shape[1], tables.inputs.shape[1], tables.angles.shape[1],
        memory.matrices.shape[1], len(memory.lower), len(memory.solution),
    ]  # fmt: skip
    arrays = (tables.rest, tables.cops, tables.nodes, memory.handles)
    return np.concatenate([np.array(sizes, dtype=np.int64), *(array.ravel() for array in arrays)])


@njit(cache=True)
def constants_of(numbers: Any) -> Constants:
    """The scalars of `packed_numbers`."""
    use_cop, use_trunk = numbers[NUMBERS] != 0.0, numbers[NUMBERS + 1] != 0.0
    return Constants(*(to_fixed_tuple(numbers[:NUMBERS], NUMBERS) + (use_cop, use_trunk)))


@njit(cache=True)
def tables_of(numbers: Any, counts: Any) -> Tables:
    """The tables of `packed_numbers` and `packed_counts`."""
    e, nodes, inputs, angles = counts[0], counts[1], counts[2], counts[3]
    a = HEADER + e
    b = SCALARS + e * nodes
    c = b + e * inputs * DIRECTIONS
    d = c + e * angles * DIRECTIONS
    g = d + e * inputs
    return Tables(
        counts[HEADER:a], counts[a : a + e], counts[a + e : a + 2 * e],
        numbers[SCALARS:b].reshape((e, nodes)),
        numbers[b:c].reshape((e, inputs, DIRECTIONS)), numbers[c:d].reshape((e, angles, DIRECTIONS)),
        numbers[d:g].reshape((e, inputs)),
        numbers[g : g + e * DIRECTIONS**2].reshape((e, DIRECTIONS, DIRECTIONS)),
    )  # fmt: skip


@njit(cache=True)
def memory_of(counts: Any, scratch: Any) -> Memory:
    """The scratch of `new_memory`, and its solvers' handles."""
    e, size, rows, n = counts[0], counts[4], counts[5], counts[6]
    a = HEADER + 3 * e
    b = e * size
    c = b + 3 * rows
    return Memory(
        scratch[:b].reshape((e, size)), counts[a : a + HANDLE * e].reshape((e, HANDLE)),
        scratch[b : b + rows], scratch[b + rows : c - rows], scratch[c - rows : c], scratch[c : c + n],
    )  # fmt: skip


def new_memory(matrices: NDArray[np.float64], rows: int, n: int) -> tuple[Memory, NDArray[np.float64]]:
    """Memory without solvers, and the one array whose parts all but the handles are."""
    e, size = matrices.shape
    scratch = np.zeros(e * size + 3 * rows + n)
    own, *rest = np.split(scratch, e * size + rows * np.arange(4))
    own[:] = matrices.ravel()
    return Memory(own.reshape(e, size), np.zeros((e, HANDLE), dtype=np.int64), *rest), scratch
