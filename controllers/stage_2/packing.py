"""Constants, tables and scratch of the compiled loop of stage 2: one array of a call, and by name in it.

Numba unpacks every array of a call, about 0.1 us each, together more than a plan takes. So all of them come
as one address table, and are read as contiguous arrays, which is what they are.
"""

# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ..compiled.array_table import (
    Floats1,
    Floats2,
    Ints2,
    dense_part_of,
)
from ..compiled.kernels import njit
from .tables import Tables

HANDLE = 6  # length of a solver's handle


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

    matrices: Floats2  # (E, rows * n)
    handles: Ints2  # (E, 6)
    lower: Floats1  # (rows,)
    upper: Floats1
    optimum: Floats1  # (rows,): A u of the unconstrained optimum u
    solution: Floats1  # (n,)


class Shared(NamedTuple):
    """What the loop of every worker reads, beside the tables."""

    numbers: Floats1  # (SCALARS,), the fields of `Constants`
    box: Floats2  # (2, 7), of the gait variables: low, high


class Parts(NamedTuple):
    """All arrays of the compiled loop, C-contiguous, in the order of their `parts_table`."""

    shared: Shared
    tables: Tables
    memory: Memory


SCALARS = len(Constants._fields)
NUMBERS = SCALARS - 2  # the flags are the last of them


@njit(cache=True)
def constants_of(t: Any) -> Constants:
    """The scalars of the loop."""
    numbers = dense_part_of(t, Parts, "shared").numbers
    use_cop, use_trunk = numbers[NUMBERS] != 0.0, numbers[NUMBERS + 1] != 0.0
    return Constants(*(to_fixed_tuple(numbers[:NUMBERS], NUMBERS) + (use_cop, use_trunk)))


@njit(cache=True)
def box_of(t: Any) -> Any:
    """The box of the gait variables (2, 7)."""
    return dense_part_of(t, Parts, "shared").box


@njit(cache=True)
def tables_of(t: Any) -> Tables:
    """What is the same for all rows of the problem."""
    return dense_part_of(t, Parts, "tables")


@njit(cache=True)
def memory_of(t: Any) -> Memory:
    """Scratch of one worker."""
    return dense_part_of(t, Parts, "memory")


def new_memory(matrices: NDArray[np.float64], rows: int, n: int) -> Memory:
    """Memory without solvers, for problems of at most `rows` rows and `n` inputs."""
    handles = np.zeros((len(matrices), HANDLE), dtype=np.int64)
    return Memory(matrices.copy(), handles, np.zeros(rows), np.zeros(rows), np.zeros(rows), np.zeros(n))
