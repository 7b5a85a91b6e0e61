"""The compiled loop of stage 2: one plan is one row in, one row out; see `cop_planner` for the problem.

Numba unpacks every array of a call, about 0.25 us each, several times what a plan takes. So all constants and
tables come as one array of numbers and one of counts, and the scratch memory as a third.
"""

# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..solvers.least_distance import solve_least_distance
from .dense import SHORTEST
from .tables import Tables

INPUTS, OUTPUTS = 11, 7  # columns of the rows that `plan_rows` reads and writes
HANDLE = 6  # length of a solver's handle
HEADER = 7  # counts before the tables of integers


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


@njit(cache=True)
def acceleration_interval(angle: float, gravity: float, torque: float, box: float) -> tuple[float, float]:
    """|j a - gravity torque sin(angle)| <= tau_max, all over j, within the gait box; never empty."""
    shift = gravity * math.sin(angle)
    low = min(max(shift - torque, -box), box)
    high = max(min(shift + torque, box), -box)
    return low, high


@njit(cache=True)
def acceleration_bounds(angle: float, c: Constants) -> tuple[float, float]:
    """Bounds of the trunk acceleration at the present lean."""
    return acceleration_interval(angle, c.gravity, c.torque, c.acceleration)


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
def _constants_of(numbers: Any) -> Constants:
    return Constants(*(to_fixed_tuple(numbers[:12], 12) + (numbers[12] != 0.0, numbers[13] != 0.0)))


@njit(cache=True)
def _tables_of(numbers: Any, counts: Any) -> Tables:
    e, nodes, inputs, angles = counts[0], counts[1], counts[2], counts[3]
    a = HEADER + e
    b = 14 + e * nodes
    c = b + e * inputs * 4
    d = c + e * angles * 4
    g = d + e * inputs
    return Tables(
        counts[HEADER:a], counts[a : a + e], counts[a + e : a + 2 * e], numbers[14:b].reshape((e, nodes)),
        numbers[b:c].reshape((e, inputs, 4)), numbers[c:d].reshape((e, angles, 4)),
        numbers[d:g].reshape((e, inputs)), numbers[g : g + e * 16].reshape((e, 4, 4)),
    )  # fmt: skip


@njit(cache=True)
def _memory_of(counts: Any, scratch: Any) -> Memory:
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


@njit(cache=True, nogil=True)
def plan_rows(rows: Any, out: Any, numbers: Any, counts: Any, scratch: Any) -> int:
    """Plan every row of (n, 11) into (n, 7); returns how many were invalid; see `CopPlanner.plan_batch`."""
    c, tables, memory = _constants_of(numbers), _tables_of(numbers, counts), _memory_of(counts, scratch)
    invalid = 0
    for i in range(rows.shape[0]):
        row = rows[i]
        finite = True
        for k in range(row.shape[0]):
            finite = finite and math.isfinite(row[k])
        remaining = max(row[0], SHORTEST)
        whole = int(max(math.floor((remaining - c.first_min) / c.dt + 1e-9), 0.0))
        if not finite or whole >= len(tables.rest):
            out[i, 6] = 2
            invalid += 1
            continue
        out[i, 6] = 0
        first = remaining - whole * c.dt
        for axis in range(2):
            cop, acceleration, end, status = _plan_axis(
                whole, first, remaining, row[1 + axis], row[3 + axis], row[5 + axis], row[7 + axis],
                row[9 + axis], c.cop_x if axis == 0 else c.cop_y, c, tables, memory,
            )  # fmt: skip
            out[i, axis], out[i, 2 + axis], out[i, 4 + axis] = cop, acceleration, end
            out[i, 6] = max(out[i, 6], status)
    return invalid


@njit(cache=True)
def _plan_axis(
    e: int, first: float, remaining: float, dcm: float, angle: float, rate: float, target: float,
    reference: float, cop_max: float, c: Constants, tables: Tables, memory: Memory,
) -> tuple[Any, Any, Any, int]:  # fmt: skip
    """One axis: (CoP, trunk acceleration, DCM at touchdown, status)."""
    rest, nodes, cops = tables.rest[e], tables.nodes[e], tables.cops[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    rows = n + nodes
    growth = math.exp(c.omega * remaining)
    free = growth * dcm
    if not c.use_cop:
        reference = min(max(reference, -cop_max), cop_max)
        free -= (growth - 1.0) * reference
    low, high = acceleration_bounds(angle, c)
    if n == 0:
        return reference, 0.0, free, 0

    # Coefficients of the columns of the first interval, and of the right-hand side, along T, S, O
    share = first / c.dt
    weight_z = growth * (1.0 - math.exp(-c.omega * first))
    weight_a = c.cmp_per_acceleration * weight_z
    kz = (weight_z, 0.0, 0.0)
    ka = (weight_a, first, 0.5 * first * first)
    kr = (free - target, -rate, -(angle + first * rate))
    uz, ua, l11, l12, l22 = _first_interval(tables.gram[e], kz, ka, kr, reference, share, c)
    k0 = kr[0] - kz[0] * uz - ka[0] * ua
    k1 = kr[1] - ka[1] * ua
    k2 = kr[2] - ka[2] * ua
    k3 = reference if c.use_cop else 0.0

    # Unconstrained optimum, in the rows of the constraints
    U, V, steps, y = tables.inputs[e], tables.angles[e], tables.steps[e], memory.optimum
    inside = True
    for i in range(rest):
        y[i] = k0 * U[i, 0] + k1 * U[i, 1] + k2 * U[i, 2] + k3 * U[i, 3]
    if c.use_cop:
        y[rest] = uz
    if c.use_trunk:
        y[n - 1] = ua
    for k in range(nodes):
        y[n + k] = (
            k0 * V[k, 0] + k1 * V[k, 1] + k2 * V[k, 2] + k3 * V[k, 3]
            + angle + (first + steps[k]) * rate + (ka[2] + first * steps[k]) * ua
        )  # fmt: skip
    for i in range(rows):
        is_cop = i < cops or (i == rest and c.use_cop)
        lower = -cop_max if is_cop else low if i < n else -c.angle
        upper = cop_max if is_cop else high if i < n else c.angle
        memory.lower[i], memory.upper[i] = lower - y[i], upper - y[i]
        inside = inside and lower <= y[i] <= upper

    status = 0
    if not inside:
        _write_first_columns(e, first, kz, ka, l11, l12, l22, c, tables, memory)
        if solve_least_distance(memory.handles[e]) > 0:
            M, v = memory.matrices[e], memory.solution
            for i in range(n):
                for j in range(n):
                    y[i] += M[i * n + j] * v[j]
        else:
            status = 1
    end = free
    for i in range(rest):
        end -= tables.weights[e, i] * y[i]
    cop, acceleration = reference, 0.0
    if c.use_cop:
        cop = min(max(y[rest], -cop_max), cop_max)
        end -= weight_z * cop
    if c.use_trunk:
        acceleration = min(max(y[n - 1], low), high)
        end -= weight_a * acceleration
    return cop, acceleration, end, status


@njit(cache=True)
def _first_interval(
    gram: Any, kz: Any, ka: Any, kr: Any, reference: float, share: float, c: Constants
) -> tuple[float, float, float, float, float]:
    """Unconstrained z_0 and a_0, and the lower right corner of R.

    The Schur complement of the first interval's inputs in G'G, with the Gram matrix of what the other inputs
    leave of each direction: S_ij = own_i + k_i' gram k_j, S u = own reference + k' gram k_r.
    """
    szz = saa = 1.0
    sza = bz = ba = 0.0
    if c.use_cop:
        szz, bz = c.beta_cop * share, c.beta_cop * share * reference
    if c.use_trunk:
        saa = c.beta_trunk * share
    tail = reference if c.use_cop else 0.0
    for i in range(3):
        along = gram[i, 3] * tail
        for j in range(3):
            along += gram[i, j] * kr[j]
            if c.use_cop:
                szz += kz[i] * gram[i, j] * kz[j]
            if c.use_trunk:
                saa += ka[i] * gram[i, j] * ka[j]
            if c.use_cop and c.use_trunk:
                sza += kz[i] * gram[i, j] * ka[j]
        bz += kz[i] * along if c.use_cop else 0.0
        ba += ka[i] * along if c.use_trunk else 0.0
    l11 = math.sqrt(szz)
    l12 = sza / l11
    l22 = math.sqrt(saa - l12 * l12)
    ua = (ba - l12 * bz / l11) / (l22 * l22) if c.use_trunk else 0.0
    uz = (bz / l11 - l12 * ua) / l11 if c.use_cop else 0.0
    return uz, ua, l11, l12, l22


@njit(cache=True)
def _write_first_columns(
    e: int, first: float, kz: Any, ka: Any, l11: float, l12: float, l22: float, c: Constants, tables: Tables,
    memory: Memory,
) -> None:  # fmt: skip
    """The columns of M = A R^-1 that belong to the first interval: z_0, then a_0."""
    rest, nodes = tables.rest[e], tables.nodes[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    U, V, steps, M = tables.inputs[e], tables.angles[e], tables.steps[e], memory.matrices[e]
    for i in range(n + nodes):
        t = s = o = 0.0
        if i < rest:
            t, s, o = U[i, 0], U[i, 1], U[i, 2]
        elif i >= n:
            t, s, o = V[i - n, 0], V[i - n, 1], V[i - n, 2]
        column = 0.0
        if c.use_cop:
            column = ((1.0 if i == rest else 0.0) - kz[0] * t) / l11
            M[i * n + rest] = column
        if c.use_trunk:
            own = 1.0 if i == n - 1 else 0.0
            if i >= n:
                own = ka[2] + first * steps[i - n]
            M[i * n + n - 1] = (own - ka[0] * t - ka[1] * s - ka[2] * o - column * l12) / l22
