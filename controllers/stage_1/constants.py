"""Constants of stage 1 in one array, and by name in compiled code."""

# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..model.double_support import check_double_support, transfer_weight
from ..model.gait_box import GaitLimits
from ..model.nominal_gait import check_pelvis
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig


class StepConstants(NamedTuple):
    """Scalars of the compiled loop; flags are 1 or 0."""

    omega: float  # [1/s]
    pelvis_width: float  # l_p [m]
    alpha_step: float
    alpha_duration: float
    alpha_offset: float
    adapt_step: float
    adapt_duration: float
    duration_margin: float  # [s]
    freeze: float  # [s]
    touchdown_delay: float  # [s]
    upright_stiffness: float  # [1/s^2]
    upright_damping: float  # [1/s]
    carry: float  # share of the push estimate that is still to come: 1 - exp(-omega push_carry)
    trunk_gain: float  # CMP per trunk acceleration that the debt of the trunk counts with [m s^2]
    push_threshold: float  # [m]
    double_support: float  # d [s]
    period: float  # for which the first inputs are held [s]
    transfer: float  # c = kappa(0)
    swing_acceleration: float  # bound of the swing foot's; 0: none [m/s^2]
    adapt: float  # 0 gives the nominal gait
    capture_point: float  # 1: the rule of `capture_step` in the place of eq. 3, also ahead of linear MPC


CONSTANTS = len(StepConstants._fields)


def pack_constants(
    robot: RobotModel, limits: GaitLimits, config: PlannerConfig, adapt: bool = True
) -> NDArray[np.float64]:
    """`StepConstants` as an array (CONSTANTS,).

    Raises:
        InvalidValueError: a pelvis wider than the step box, or a double support longer than the shortest
            step.
    """
    check_pelvis(robot, limits)
    check_double_support(config.double_support, limits)
    return np.array(
        StepConstants(
            omega=robot.omega,
            pelvis_width=robot.pelvis_width,
            alpha_step=config.alpha_step,
            alpha_duration=config.alpha_duration,
            alpha_offset=config.alpha_offset,
            adapt_step=float(config.adapt_step),
            adapt_duration=float(config.adapt_duration),
            duration_margin=config.duration_margin,
            freeze=config.freeze,
            touchdown_delay=config.touchdown_delay,
            upright_stiffness=config.upright_stiffness,
            upright_damping=config.upright_damping,
            carry=-math.expm1(-robot.omega * config.push_carry),
            trunk_gain=robot.cmp_per_trunk_acceleration * config.trunk_debt,
            push_threshold=config.push_threshold,
            double_support=config.double_support,
            period=config.first_interval_min,
            transfer=transfer_weight(0.0, config.double_support, robot.omega),
            swing_acceleration=config.swing_acceleration,
            adapt=float(adapt),
            capture_point=float(config.foothold != "optimal"),
        )
    )


@njit(cache=True)
def constants_of(packed: Any) -> StepConstants:
    """The constants of `pack_constants` by name."""
    return StepConstants(*to_fixed_tuple(packed, CONSTANTS))
