"""The program of stage 2 written out densely, axis by axis: what OSQP solves, and the oracle of the tests."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..solvers.general_qp import QuadraticProgram

SHORTEST = 1e-3  # a shorter (or negative) remaining time is planned as this [s]


@dataclass(frozen=True)
class ExplicitProblem:
    """Inputs x = (z_0..z_{N-1}, a_0..a_{K-1}); where an input is not used, its part is absent."""

    qp: QuadraticProgram
    durations: NDArray[np.float64]  # (K,), the first N of them until touchdown [s]
    cops: int  # N, or 0 where the CoP stays at the reference
    accelerations: int  # K, or 0 where the trunk is not used
    reference: float  # [m]
    dcm_free: float  # DCM at touchdown with all inputs zero [m]
    dcm_row: NDArray[np.float64]  # (n,)

    def first(self, x: NDArray[np.float64]) -> tuple[float, float]:
        """CoP [m] and trunk acceleration [rad/s^2] of the first interval."""
        cop = float(x[0]) if self.cops else self.reference
        return cop, float(x[self.cops]) if self.accelerations else 0.0

    def dcm_end(self, x: NDArray[np.float64]) -> float:
        """Predicted DCM at touchdown [m]."""
        return float(self.dcm_free - self.dcm_row @ x)


def grid(config: PlannerConfig, remaining: float) -> NDArray[np.float64]:
    """Durations of the intervals until touchdown: a first one, then whole ones [s]."""
    whole = max(math.floor((remaining - config.first_interval_min) / config.sampling_time + 1e-9), 0)
    return np.array([remaining - whole * config.sampling_time] + [config.sampling_time] * whole)


def explicit_problem(
    robot: RobotModel, config: PlannerConfig, remaining: float, dcm: float, angle: float, rate: float,
    target: float, reference: float, cop_max: float, acceleration_low: float, acceleration_high: float,
) -> ExplicitProblem:  # fmt: skip
    """Build the problem by unrolling the model, with no use of its structure."""
    until = grid(config, max(remaining, SHORTEST))
    if not config.use_cop:
        reference = min(max(reference, -cop_max), cop_max)
    N = until.size
    return write_out(
        robot, config, until, 1, (dcm, angle, rate, target), np.full(N, reference), np.full(N, -cop_max),
        np.full(N, cop_max), acceleration_low, acceleration_high,
    )  # fmt: skip


def write_out(
    robot: RobotModel, config: PlannerConfig, until: NDArray[np.float64], partial: int,
    state: tuple[float, float, float, float], references: NDArray[np.float64], cop_low: NDArray[np.float64],
    cop_high: NDArray[np.float64], acceleration_low: float, acceleration_high: float,
) -> ExplicitProblem:  # fmt: skip
    """Build the problem of one axis on any grid.

    Args:
        robot: physical constants.
        config: weights.
        until: (N,) durations of the intervals until touchdown [s].
        partial: the inputs of so many first intervals are weighted by their share of a whole one.
        state: DCM now [m], lean [rad], its rate [rad/s], DCM wanted at touchdown [m].
        references: (N,) of the CoP [m].
        cop_low: (N,) [m].
        cop_high: (N,) [m].
        acceleration_low: of the trunk [rad/s^2].
        acceleration_high: [rad/s^2].
    """
    dcm, angle, rate, target = state
    durations = np.concatenate([until, np.full(config.tail_intervals, config.tail_sampling_time)])
    N, K = until.size, durations.size
    cops, accelerations = N if config.use_cop else 0, K if config.use_trunk else 0
    n = cops + accelerations

    # Affine maps [constant, inputs] of the states, one interval after the other; with the debt of the trunk
    # in it, the DCM at touchdown is less what the tail will move the CMP, discounted to touchdown
    xi, theta, omega = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    xi[0], theta[0], omega[0] = dcm, angle, rate
    angles, rates = [], []
    for k in range(K):
        d, z, a = durations[k], np.zeros(n + 1), np.zeros(n + 1)
        if cops and k < N:
            z[1 + k] = 1.0
        elif not cops and k < N:
            z[0] = references[k]
        if accelerations:
            a[1 + cops + k] = 1.0
        if k < N:
            e = math.exp(robot.omega * d)
            xi = e * xi - (e - 1) * (z + robot.cmp_per_trunk_acceleration * a)
        elif config.trunk_debt:
            before, after = (math.exp(-robot.omega * durations[N:j].sum()) for j in (k, k + 1))
            xi = xi - robot.cmp_per_trunk_acceleration * (before - after) * a
        theta, omega = theta + d * omega + d * d / 2 * a, omega + d * a
        angles.append(theta)
        rates.append(omega)

    share = durations / config.sampling_time
    share[partial:] = 1.0
    H, f = np.zeros((n, n)), np.zeros(n)
    own = np.concatenate([config.beta_cop * share[:cops], config.beta_trunk * share[:accelerations]])
    H += np.diag(own)
    f[:cops] -= own[:cops] * references[:cops]
    terms = [(config.beta_dcm, xi - np.eye(n + 1)[0] * target)]
    if accelerations:
        terms += [(config.beta_trunk_rate, r) for r in rates] + [(config.beta_trunk_angle, t) for t in angles]
    for weight, row in terms:
        H += weight * np.outer(row[1:], row[1:])
        f += weight * row[0] * row[1:]
    soft = np.array(angles)[:, 1:] if accelerations else np.zeros((0, n))
    offset = np.array(angles)[:, 0] if accelerations else np.zeros(0)
    limit = robot.trunk_angle_max
    lower = np.concatenate([cop_low[:cops], np.full(accelerations, acceleration_low), -limit - offset])
    upper = np.concatenate([cop_high[:cops], np.full(accelerations, acceleration_high), limit - offset])
    weights = np.concatenate([np.zeros(n), np.full(offset.size, config.beta_trunk_limit)])
    qp = QuadraticProgram(H, f, np.concatenate([np.eye(n), soft]), lower, upper, weights)
    return ExplicitProblem(qp, durations, cops, accelerations, float(references[0]), float(xi[0]), -xi[1:])
