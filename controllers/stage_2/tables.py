"""Constant matrices of stage 2, and how a compiled loop receives them.

Constant matrices of stage 2, built once for every horizon length.

The planner minimises |G u - r|^2, where u = (rest, first): `rest` are the CoPs and trunk accelerations of
the whole intervals, `first` those of the first interval, whose length depends on the time that remains. Only
the columns of `first` change with it, and they lie in the span of three fixed directions of the residuals:

    T: the terminal DCM, weighted        S: unit trunk rate now        O: unit trunk angle now

and so does r, together with Z: the CoP reference of the whole intervals. With G_rest = Q R, projections
U_i = R^-1 Q' i and the Gram matrix of what is left of each direction, (1 - QQ') i, all that changes with a
tick is a combination of these vectors.

Constants, tables and scratch of the compiled loop of stage 2: one array of a call, and by name in it.

Numba unpacks every array of a call, about 0.1 us each, together more than a plan takes. So all of them come
as one address table, and are read as contiguous arrays, which is what they are.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ..array_table import Floats1, Floats2, Floats3, Ints1, Ints2, dense_part_of
from ..jit import njit
from ..model.robot import RobotModel
from ..settings import PlannerConfig
from .problem import require_positive

TERMINAL, RATE, ANGLE, REFERENCE = 0, 1, 2, 3  # the directions T, S, O, Z


class Tables(NamedTuple):
    """Stacked tables, one entry e for each horizon length N = e + 1.

    Rows of the constraint matrix M = A R_full^-1: one per input (bounds), then one per node (trunk angle).
    """

    rest: Ints1  # (E,): number of inputs of the whole intervals, n - first
    cops: Ints1  # (E,): how many of them are CoPs
    nodes: Ints1  # (E,): number of trunk nodes
    steps: Floats2  # (E, nodes): time of a node after the end of the first interval [s]
    inputs: Floats3  # (E, n, 4): U_i
    angles: Floats3  # (E, nodes, 4): trunk angle due to U_i
    weights: Floats2  # (E, n): terminal DCM per input, DCM - DCM_free = -weights . u
    gram: Floats3  # (E, 4, 4)


class Horizon(NamedTuple):
    """The tables of one horizon length, before they are stacked."""

    steps: NDArray[np.float64]
    inputs: NDArray[np.float64]
    angles: NDArray[np.float64]
    weights: NDArray[np.float64]
    gram: NDArray[np.float64]
    constraints: NDArray[np.float64]  # (n_rest + nodes, n_rest): M without the first interval


def horizon(robot: RobotModel, config: PlannerConfig, intervals: int) -> Horizon:
    """Tables for `intervals` = N until touchdown, the first of them partial."""
    dt = config.sampling_time
    durations = np.array([dt] * (intervals - 1) + [config.tail_sampling_time] * config.tail_intervals)
    cops = intervals - 1 if config.use_cop else 0
    accelerations = durations.size if config.use_trunk else 0
    nodes = accelerations + 1 if config.use_trunk else 0
    steps = np.concatenate([[0.0], np.cumsum(durations)])[:nodes]
    k, j = np.arange(nodes)[:, None], np.arange(accelerations)[None, :]
    rate = np.where(j < k, durations[j], 0.0)  # (nodes, accelerations)
    angle = np.where(j < k, durations[j] * (steps[k] - steps[j + 1] + durations[j] / 2), 0.0)
    growth = math.exp(robot.omega * dt)
    # e^{w (touchdown - end)} (e^{w dt} - 1) of each whole interval
    dcm = (growth - 1) * growth ** np.arange(intervals - 2, -1, -1.0)
    weights = np.zeros(cops + accelerations)
    weights[:cops] = dcm[:cops]
    count = min(accelerations, intervals - 1)
    weights[cops : cops + count] = robot.cmp_per_trunk_acceleration * dcm[:count]
    if config.trunk_debt and accelerations:
        decay = np.exp(-robot.omega * (steps[intervals - 1 :] - steps[intervals - 1]))
        weights[cops + intervals - 1 :] = -robot.cmp_per_trunk_acceleration * np.diff(decay)

    G, directions = _residuals(config, weights, rate, angle, steps)
    Q, R = np.linalg.qr(G)
    projected = Q.T @ directions
    left = directions - Q @ projected
    n = weights.size
    inverse = np.linalg.inv(R) if n else np.zeros((0, 0))
    inputs = inverse @ projected
    selector = np.zeros((nodes, n))
    selector[:, cops:] = angle
    constraints = np.concatenate([inverse, selector @ inverse])
    return Horizon(steps, inputs, selector @ inputs, weights, left.T @ left, constraints)


def _residuals(
    config: PlannerConfig,
    weights: NDArray[np.float64],
    rate: NDArray[np.float64],
    angle: NDArray[np.float64],
    steps: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """G and the directions T, S, O, Z (rows, 4) of a horizon.

    Rows: own weights of the inputs, terminal DCM, rates, angles. Columns of G: CoPs, accelerations.

    Args:
        config: weights.
        weights: (n,) of the inputs in the terminal DCM.
        rate: (nodes, accelerations) trunk rate that an acceleration leads to.
        angle: (nodes, accelerations) trunk angle.
        steps: (nodes,) time of a node [s].
    """
    nodes, accelerations = rate.shape
    cops = weights.size - accelerations
    own = np.sqrt(np.concatenate([np.full(cops, config.beta_cop), np.full(accelerations, config.beta_trunk)]))
    n = own.size
    dcm_scale = math.sqrt(config.beta_dcm)
    rate_scale, angle_scale = math.sqrt(config.beta_trunk_rate), math.sqrt(config.beta_trunk_angle)
    G = np.zeros((n + 1 + 2 * nodes, n))
    G[:n] = np.diag(own)
    G[n] = dcm_scale * weights
    G[n + 1 : n + 1 + nodes, cops:] = rate_scale * rate
    G[n + 1 + nodes :, cops:] = angle_scale * angle
    directions = np.zeros((len(G), 4))
    directions[n, TERMINAL] = dcm_scale
    directions[n + 1 : n + 1 + nodes, RATE] = rate_scale
    directions[n + 1 + nodes :, RATE] = angle_scale * steps
    directions[n + 1 + nodes :, ANGLE] = angle_scale
    directions[:cops, REFERENCE] = own[:cops]
    return G, directions


def build(robot: RobotModel, config: PlannerConfig, longest: float) -> tuple[Tables, NDArray[np.float64]]:
    """All tables for horizons up to `longest` [s], and the stacked constraint matrices (E, rows, n).

    Raises:
        InvalidValueError: a weight is zero without which an input has no unique optimum.
    """
    require_positive(config, "beta_cop", "beta_trunk")
    E = math.ceil(longest / config.sampling_time)
    parts = [horizon(robot, config, e + 1) for e in range(E)]
    first = int(config.use_cop) + int(config.use_trunk)
    n, nodes = max(p.weights.size for p in parts) + first, max(p.steps.size for p in parts)
    rest = np.array([p.weights.size for p in parts])
    tables = Tables(
        rest=rest,
        cops=np.array([e if config.use_cop else 0 for e in range(E)]),
        nodes=np.array([p.steps.size for p in parts]),
        steps=np.zeros((E, nodes)),
        inputs=np.zeros((E, n, 4)),
        angles=np.zeros((E, nodes, 4)),
        weights=np.zeros((E, n)),
        gram=np.stack([p.gram for p in parts]),
    )
    # Packed without padding inside an entry: (rows, n) row after row, as the solver reads them
    matrices = np.zeros((E, (n + nodes) * n))
    for e, p in enumerate(parts):
        r, k = p.weights.size, p.steps.size
        tables.steps[e, :k] = p.steps
        tables.inputs[e, :r] = p.inputs
        tables.angles[e, :k] = p.angles
        tables.weights[e, :r] = p.weights
        matrix = matrices[e, : (r + first + k) * (r + first)].reshape(r + first + k, r + first)
        matrix[:r, :r] = p.constraints[:r]
        matrix[r + first :, :r] = p.constraints[r:]
    return tables, matrices


# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


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
