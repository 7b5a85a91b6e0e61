"""Compiled assembly of the paper's second stage: eqs. 8-20 as a program, and as a least-distance problem."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit


class Constants(NamedTuple):
    """Scalars of the problem."""

    omega: float
    cmp_per_acceleration: float
    angle: float  # [rad]
    dt: float
    beta_cop: float
    beta_dcm_acceleration: float
    beta_jerk: float
    beta_rate: float
    beta_angle: float
    repaired: bool
    use_trunk: bool


class Workspace(NamedTuple):
    """Arrays of one horizon length N; rewritten by every solve.

    Inputs: N DCM accelerations, then N trunk jerks. Rows: Z_1..Z_N, theta''_1..N, theta_1..N (the last two
    only with the trunk in use).
    """

    H: NDArray[np.float64]  # (n, n)
    f: NDArray[np.float64]  # (n,)
    A: NDArray[np.float64]  # (m, n)
    offset: NDArray[np.float64]  # (m,): the rows' values with zero inputs
    low: NDArray[np.float64]  # (m,): low <= A x <= high
    high: NDArray[np.float64]
    soft: NDArray[np.bool_]  # (m,)
    dcm: NDArray[np.float64]  # (n + 1,): xi_T = dcm[0] + dcm[1:] . x
    M: NDArray[np.float64]  # (m, n) = A R^-1 with H = R'R
    factor: NDArray[np.float64]  # (n, n): L = R'
    x: NDArray[np.float64]  # (n,): the unconstrained optimum, then the solution
    lower: NDArray[np.float64]  # (m,): of M v
    upper: NDArray[np.float64]
    v: NDArray[np.float64]  # (n,)

    @classmethod
    def of(cls, nodes: int, use_trunk: bool) -> Workspace:
        """Allocate for N = nodes."""
        n, m = (2 * nodes, 3 * nodes) if use_trunk else (nodes, nodes)
        soft = np.arange(m) >= 2 * nodes
        return cls(
            np.zeros((n, n)), np.zeros(n), np.zeros((m, n)), np.zeros(m), np.zeros(m), np.zeros(m), soft,
            np.zeros(n + 1), np.zeros((m, n)), np.zeros((n, n)), np.zeros(n), np.zeros(m), np.zeros(m),
            np.zeros(n),
        )  # fmt: skip


@njit(cache=True)
def _add(weight: float, row: Any, target: float, w: Workspace) -> None:
    """Add weight (row[0] + row[1:] . x - target)^2 / 2 to the cost (lower triangle of H)."""
    if weight == 0.0:
        return
    n = w.f.shape[0]
    for i in range(n):
        scaled = weight * row[1 + i]
        if scaled != 0.0:
            w.f[i] += scaled * (row[0] - target)
            for j in range(i + 1):
                w.H[i, j] += scaled * row[1 + j]


@njit(cache=True)
def _advance(
    d: float, k: int, N: int, use_trunk: bool, xi: Any, dxi: Any, theta: Any, rate: Any, acceleration: Any
) -> None:
    """The affine maps of the states over interval k of d [s], eqs. 11-14."""
    for i in range(xi.shape[0]):
        xi[i] += d * dxi[i]
        theta[i] += d * rate[i] + d * d / 2 * acceleration[i]
        rate[i] += d * acceleration[i]
    xi[1 + k] += d * d / 2
    dxi[1 + k] += d
    if use_trunk:
        theta[1 + N + k] += d * d * d / 6
        rate[1 + N + k] += d * d / 2
        acceleration[1 + N + k] += d


@njit(cache=True)
def build(durations: Any, state: Any, beta_dcm: float, c: Constants, w: Workspace) -> None:
    """Cost and constraint rows, from the affine maps [constant, inputs] of the states along the horizon."""
    N, n = durations.shape[0], w.f.shape[0]
    dcm0, target, reference = state[0], state[3], state[4]
    w.H[:], w.f[:], w.A[:] = 0.0, 0.0, 0.0
    xi, dxi = np.zeros(n + 1), np.zeros(n + 1)
    theta, rate, acceleration, z = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    xi[0], theta[0], rate[0], acceleration[0] = dcm0, state[1], state[2], state[6]
    dxi[0] = c.omega * (dcm0 - state[5] - c.cmp_per_acceleration * state[6])  # eq. 6b
    time = 0.0
    for k in range(N):
        d = durations[k]
        share = d / c.dt if k == 0 else 1.0
        _advance(d, k, N, c.use_trunk, xi, dxi, theta, rate, acceleration)
        free = 0.0
        if c.repaired:
            free = (
                c.omega * (dcm0 - reference) * (math.exp(c.omega * (time + d)) - math.exp(c.omega * time)) / d
            )
        w.H[k, k] += c.beta_dcm_acceleration * share
        w.f[k] -= c.beta_dcm_acceleration * share * free
        if c.use_trunk:
            w.H[N + k, N + k] += c.beta_jerk * share
            _add(c.beta_rate, rate, 0.0, w)
            _add(c.beta_angle, theta, 0.0, w)
        for i in range(n + 1):
            z[i] = xi[i] - dxi[i] / c.omega - c.cmp_per_acceleration * acceleration[i]  # eq. 10
        _add(c.beta_cop, z, reference, w)
        _set_row(k, z, w)
        if c.use_trunk:
            _set_row(N + k, acceleration, w)
            _set_row(2 * N + k, theta, w)
        time += d
    w.dcm[:] = xi
    _add(beta_dcm, xi, target, w)
    for i in range(n):
        for j in range(i):
            w.H[j, i] = w.H[i, j]
    _whiten(w)


@njit(cache=True)
def _set_row(i: int, row: Any, w: Workspace) -> None:
    w.offset[i] = row[0]
    w.A[i, :] = row[1:]


@njit(cache=True)
def _whiten(w: Workspace) -> None:
    """H = L L', x = -H^-1 f, M = A L'^-1."""
    n, L = w.f.shape[0], w.factor
    for i in range(n):
        for j in range(i + 1):
            total = w.H[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(total) if i == j else total / L[j, j]
    for i in range(n):
        w.x[i] = -w.f[i]
    _forward(L, w.x)
    _backward(L, w.x)
    for r in range(w.A.shape[0]):
        w.M[r, :] = w.A[r, :]
        _forward(L, w.M[r])


@njit(cache=True)
def _forward(L: Any, b: Any) -> None:
    """Solve L x = b in place of b."""
    for i in range(b.shape[0]):
        total = b[i]
        for k in range(i):
            total -= L[i, k] * b[k]
        b[i] = total / L[i, i]


@njit(cache=True)
def _backward(L: Any, b: Any) -> None:
    """Solve L' x = b in place of b."""
    for i in range(b.shape[0] - 1, -1, -1):
        b[i] /= L[i, i]
        for k in range(i):
            b[k] -= L[i, k] * b[i]


@njit(cache=True)
def write_bounds(
    cop_low: float, cop_high: float, low: float, high: float, angle: float, w: Workspace
) -> None:
    """Bounds of the rows of A x, and of M v about the unconstrained optimum."""
    N = w.A.shape[0] if w.A.shape[0] == w.A.shape[1] else w.A.shape[0] // 3
    for i in range(w.A.shape[0]):
        if i < N:
            lower, upper = cop_low, cop_high
        elif i < 2 * N:
            lower, upper = low, high
        else:
            lower, upper = -angle, angle
        value = 0.0
        for j in range(w.A.shape[1]):
            value += w.A[i, j] * w.x[j]
        w.low[i], w.high[i] = lower - w.offset[i], upper - w.offset[i]
        w.lower[i], w.upper[i] = w.low[i] - value, w.high[i] - value


@njit(cache=True)
def outputs(period: float, state: Any, add: bool, c: Constants, w: Workspace, result: Any) -> None:
    """CoP and trunk acceleration after `period` [s], and the DCM at touchdown, of x (+ L'^-1 v if `add`)."""
    n = w.x.shape[0]
    if add:
        _backward(w.factor, w.v)
        for i in range(n):
            w.x[i] += w.v[i]
    input_dcm = w.x[0]
    jerk = w.x[n // 2] if c.use_trunk else 0.0
    dxi = c.omega * (state[0] - state[5] - c.cmp_per_acceleration * state[6])
    xi = state[0] + period * dxi + period * period / 2 * input_dcm
    acceleration = state[6] + period * jerk
    result[0] = xi - (dxi + period * input_dcm) / c.omega - c.cmp_per_acceleration * acceleration
    result[1] = acceleration
    result[2] = w.dcm[0]
    for i in range(n):
        result[2] += w.dcm[1 + i] * w.x[i]
