"""The compiled loop of stage 2: one plan is one row in, one row out; see `planner` for the problem."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled.kernels import njit
from ..model.observation import TRUNK_ANGLE, TRUNK_RATE
from ..solvers.least_distance import solve_least_distance
from ..stage_1.columns import DCM_AHEAD, REMAINING, RESULT, TARGET
from .dense import SHORTEST
from .interface import RESULT_COP, RESULT_DCM_END, RESULT_STATUS, RESULT_TRUNK, STATUS, take_over
from .packing import Constants, Memory, box_of, constants_of, memory_of, tables_of
from .tables import ANGLE, RATE, REFERENCE, TERMINAL, Tables

# Columns of an input row, `CopPlanner.plan_batch`; of a pair (x, y) the first one
UNTIL = 0  # touchdown [s]
DCM = 1  # pair [m]
LEAN = 3  # pair [rad]
LEAN_RATE = 5  # pair [rad/s]
DCM_TARGET = 7  # pair [m]
COP_REFERENCE = 9  # pair [m]
INPUTS = 11

CLIPPED, INVALID = STATUS.index("clipped"), STATUS.index("invalid")
_ANGLE, _RATE = TRUNK_ANGLE.start, TRUNK_RATE.start


class AxisState(NamedTuple):
    """What one axis starts from and is to reach."""

    dcm: float  # [m]
    angle: float  # of the trunk [rad]
    rate: float  # [rad/s]
    target: float  # DCM wanted at touchdown [m]
    reference: float  # of the CoP [m]
    cop_max: float  # [m]
    low: float  # bounds of the trunk acceleration [rad/s^2]
    high: float
    growth: float  # exp(omega remaining)
    free: float  # DCM at touchdown with no input but a CoP that is given [m]


class FirstInterval(NamedTuple):
    """The first interval: the columns of its inputs along the directions T, S, O, and their optimum."""

    span: float  # [s]
    kz: tuple[float, float, float]  # of z_0
    ka: tuple[float, float, float]  # of a_0
    kr: tuple[float, float, float]  # of the right-hand side
    uz: float  # unconstrained z_0 [m]
    ua: float  # unconstrained a_0 [rad/s^2]
    l11: float  # lower right corner of R
    l12: float
    l22: float


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


@njit(cache=True, forceinline=True)
def write_input(obs: Any, row: Any, out: Any) -> None:
    """An input row (11,) of an observation and its stage 1 row; the CoP's reference is the sole's centre."""
    out[UNTIL] = row[REMAINING]
    for axis in range(2):
        out[DCM + axis] = row[DCM_AHEAD + axis]
        out[LEAN + axis], out[LEAN_RATE + axis] = obs[_ANGLE + axis], obs[_RATE + axis]
        out[DCM_TARGET + axis] = row[TARGET + axis]
        out[COP_REFERENCE + axis] = 0.0


@njit(cache=True)
def write_inputs(observations: Any, rows: Any, inputs: Any) -> None:
    """`write_input` of every row."""
    for i in range(rows.shape[0]):
        write_input(observations[i], rows[i], inputs[i])


@njit(cache=True, nogil=True)
def regulate_rows(observations: Any, rows: Any, packed: Any) -> int:
    """Stage 2 of stage 1 rows, in place; returns how many were invalid; see `Regulator.regulate`."""
    c, box, inputs = constants_of(packed), box_of(packed), np.empty((rows.shape[0], INPUTS))
    write_inputs(observations, rows, inputs)
    invalid = plan_rows(inputs, rows[:, RESULT:], packed)
    if invalid == 0:
        for i in range(rows.shape[0]):
            take_over(observations[i], rows[i], box, c.use_cop, c.use_trunk)
    return invalid


@njit(cache=True, nogil=True)
def plan_rows(rows: Any, out: Any, packed: Any) -> int:
    """Plan every row of (n, 11) into (n, 7); returns how many were invalid; see `CopPlanner.plan_batch`.

    Args:
        rows: inputs, by the columns above.
        out: results, by the columns of `interface`.
        packed: address table of `Parts`.
    """
    c, tables, memory = constants_of(packed), tables_of(packed), memory_of(packed)
    invalid = 0
    for i in range(rows.shape[0]):
        row = rows[i]
        finite = True
        for k in range(row.shape[0]):
            finite = finite and math.isfinite(row[k])
        remaining = max(row[UNTIL], SHORTEST)
        whole = int(max(math.floor((remaining - c.first_min) / c.dt + 1e-9), 0.0))
        if not finite or whole >= len(tables.rest):
            out[i, RESULT_STATUS] = INVALID
            invalid += 1
            continue
        out[i, RESULT_STATUS] = 0
        for axis in range(2):
            _plan_axis(whole, remaining, row, axis, c, tables, memory, out[i])
    return invalid


@njit(cache=True, forceinline=True)
def _axis_state(row: Any, axis: int, remaining: float, c: Constants) -> AxisState:
    """State and bounds of one axis of an input row."""
    dcm, angle, reference = row[DCM + axis], row[LEAN + axis], row[COP_REFERENCE + axis]
    cop_max = c.cop_x if axis == 0 else c.cop_y
    growth = math.exp(c.omega * remaining)
    free = growth * dcm
    if not c.use_cop:
        reference = min(max(reference, -cop_max), cop_max)
        free -= (growth - 1.0) * reference
    low, high = acceleration_bounds(angle, c)
    rate, target = row[LEAN_RATE + axis], row[DCM_TARGET + axis]
    return AxisState(dcm, angle, rate, target, reference, cop_max, low, high, growth, free)


@njit(cache=True, forceinline=True)
def _plan_axis(
    e: int, remaining: float, row: Any, axis: int, c: Constants, tables: Tables, memory: Memory, out: Any
) -> None:
    """Plan one axis of an input row over horizon e: CoP, trunk acceleration, DCM at touchdown, status."""
    state = _axis_state(row, axis, remaining, c)
    cop, acceleration, end = state.reference, 0.0, state.free
    rest = tables.rest[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    if n > 0:
        first = _first_interval(tables.gram[e], remaining - e * c.dt, state, c)
        _write_optimum(e, first, state, c, tables, memory.optimum)
        if not _write_room(e, state, c, tables, memory):
            _write_first_columns(e, first, c, tables, memory)
            if not _move_inside(e, n, memory):
                out[RESULT_STATUS] = max(out[RESULT_STATUS], CLIPPED)
        y = memory.optimum
        for i in range(rest):
            end -= tables.weights[e, i] * y[i]
        if c.use_cop:
            cop = min(max(y[rest], -state.cop_max), state.cop_max)
            end -= first.kz[TERMINAL] * cop
        if c.use_trunk:
            acceleration = min(max(y[n - 1], state.low), state.high)
            end -= first.ka[TERMINAL] * acceleration
    out[RESULT_COP + axis], out[RESULT_TRUNK + axis], out[RESULT_DCM_END + axis] = cop, acceleration, end


@njit(cache=True, forceinline=True)
def _first_interval(gram: Any, span: float, state: AxisState, c: Constants) -> FirstInterval:
    """Columns of the first interval, its unconstrained z_0 and a_0, and the lower right corner of R.

    The Schur complement of the first interval's inputs in G'G, with the Gram matrix of what the other inputs
    leave of each direction: S_ij = own_i + k_i' gram k_j, S u = own reference + k' gram k_r.
    """
    share = span / c.dt
    weight_z = state.growth * (1.0 - math.exp(-c.omega * span))
    kz = (weight_z, 0.0, 0.0)
    ka = (c.cmp_per_acceleration * weight_z, span, 0.5 * span * span)
    kr = (state.free - state.target, -state.rate, -(state.angle + span * state.rate))
    szz = saa = 1.0
    sza = bz = ba = 0.0
    if c.use_cop:
        szz, bz = c.beta_cop * share, c.beta_cop * share * state.reference
    if c.use_trunk:
        saa = c.beta_trunk * share
    tail = state.reference if c.use_cop else 0.0
    for i in range(3):
        along = gram[i, REFERENCE] * tail
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
    return FirstInterval(span, kz, ka, kr, uz, ua, l11, l12, l22)


@njit(cache=True, forceinline=True)
def _write_optimum(
    e: int, first: FirstInterval, state: AxisState, c: Constants, tables: Tables, y: Any
) -> None:
    """The unconstrained optimum into y: the inputs, then the trunk angles at the nodes."""
    rest, nodes = tables.rest[e], tables.nodes[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    U, V, steps, span, ka, kr = (
        tables.inputs[e],
        tables.angles[e],
        tables.steps[e],
        first.span,
        first.ka,
        first.kr,
    )
    k0 = kr[TERMINAL] - first.kz[TERMINAL] * first.uz - ka[TERMINAL] * first.ua
    k1 = kr[RATE] - ka[RATE] * first.ua
    k2 = kr[ANGLE] - ka[ANGLE] * first.ua
    k3 = state.reference if c.use_cop else 0.0
    for i in range(rest):
        y[i] = k0 * U[i, TERMINAL] + k1 * U[i, RATE] + k2 * U[i, ANGLE] + k3 * U[i, REFERENCE]
    if c.use_cop:
        y[rest] = first.uz
    if c.use_trunk:
        y[n - 1] = first.ua
    for k in range(nodes):
        y[n + k] = (
            k0 * V[k, TERMINAL] + k1 * V[k, RATE] + k2 * V[k, ANGLE] + k3 * V[k, REFERENCE]
            + state.angle + (span + steps[k]) * state.rate + (ka[ANGLE] + span * steps[k]) * first.ua
        )  # fmt: skip


@njit(cache=True, forceinline=True)
def _write_room(e: int, state: AxisState, c: Constants, tables: Tables, memory: Memory) -> bool:
    """How far the optimum may move down and up, by rows of the constraints; True where it may stay."""
    rest, cops, y = tables.rest[e], tables.cops[e], memory.optimum
    n = rest + int(c.use_cop) + int(c.use_trunk)
    inside = True
    for i in range(n + tables.nodes[e]):
        is_cop = i < cops or (i == rest and c.use_cop)
        lower = -state.cop_max if is_cop else state.low if i < n else -c.angle
        upper = state.cop_max if is_cop else state.high if i < n else c.angle
        memory.lower[i], memory.upper[i] = lower - y[i], upper - y[i]
        inside = inside and lower <= y[i] <= upper
    return inside


@njit(cache=True, forceinline=True)
def _move_inside(e: int, n: int, memory: Memory) -> bool:
    """Move the inputs of the optimum to the constrained one; False where the solver fails."""
    if solve_least_distance(memory.handles[e]) <= 0:
        return False
    M, v, y = memory.matrices[e], memory.solution, memory.optimum
    for i in range(n):
        for j in range(n):
            y[i] += M[i * n + j] * v[j]
    return True


@njit(cache=True, forceinline=True)
def _write_first_columns(e: int, first: FirstInterval, c: Constants, tables: Tables, memory: Memory) -> None:
    """The columns of M = A R^-1 that belong to the first interval: z_0, then a_0."""
    rest, nodes = tables.rest[e], tables.nodes[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    kz, ka = first.kz, first.ka
    U, V, steps, M = tables.inputs[e], tables.angles[e], tables.steps[e], memory.matrices[e]
    for i in range(n + nodes):
        t = s = o = 0.0
        if i < rest:
            t, s, o = U[i, TERMINAL], U[i, RATE], U[i, ANGLE]
        elif i >= n:
            t, s, o = V[i - n, TERMINAL], V[i - n, RATE], V[i - n, ANGLE]
        column = 0.0
        if c.use_cop:
            column = ((1.0 if i == rest else 0.0) - kz[TERMINAL] * t) / first.l11
            M[i * n + rest] = column
        if c.use_trunk:
            own = 1.0 if i == n - 1 else 0.0
            if i >= n:
                own = ka[ANGLE] + first.span * steps[i - n]
            along = own - ka[TERMINAL] * t - ka[RATE] * s - ka[ANGLE] * o
            M[i * n + n - 1] = (along - column * first.l12) / first.l22
