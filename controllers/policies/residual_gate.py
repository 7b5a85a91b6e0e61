"""When a learned residual may act: only while the DCM is away from the nominal gait."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError
from ..model.gait_box import GaitLimits
from ..model.nominal_gait import NOMINAL_SIZE, check_pelvis, nominal_gait_kernel
from ..model.nominal_start import step_start_dcm_kernel
from ..model.observation import COMMAND, DCM, ELAPSED
from ..model.robot import RobotModel

_ELAPSED, _DCM, _COMMAND = ELAPSED, DCM.start, COMMAND.start


def check_gate(band: ArrayLike) -> tuple[float, float]:
    """The band (shut, open) of a gate [m].

    Raises:
        InvalidValueError: Not two finite numbers with 0 <= shut < open.
    """
    try:
        values = np.asarray(band, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != (2,) or not (np.isfinite(values).all() and 0.0 <= values[0] < values[1]):
        raise InvalidValueError(f"a residual gate is two numbers 0 <= shut < open [m], got {band!r}")
    return float(values[0]), float(values[1])


class ResidualGate:
    """Opening g in [0, 1] of a residual, a function of the observation alone.

        e = |xi(t) exp(-omega t) - xi_0,nom|,   g = clip((e - shut) / (open - shut), 0, 1)

    xi(t) exp(-omega t) is the measured DCM traced back to the begin of the step, xi_0,nom the nominal gait's
    there. An undisturbed walk of the policy below stays under `shut` and is its own, bit for bit.

    Args:
        robot: Physical constants.
        limits: Gait box, which the nominal gait follows from.
        delay: The new foot carries load this long after T [s].
        band: (shut, open) [m].
    """

    def __init__(self, robot: RobotModel, limits: GaitLimits, delay: float, band: ArrayLike):
        check_pelvis(robot, limits)
        self.band = check_gate(band)
        self._constants = tuple(map(float, (robot.omega, robot.pelvis_width, delay, *self.band)))
        self._low, self._high = limits.low, limits.high

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Openings (n, 1) of observations (n, 36)."""
        rows = np.ascontiguousarray(observations, dtype=np.float64)
        return _openings(rows, self._constants, self._low, self._high)


@njit(cache=True)
def _openings(observations, constants, low, high):  # pragma: no cover - compiled
    omega, pelvis_width, delay, shut, opened = constants
    out = np.empty((observations.shape[0], 1), dtype=np.float32)
    nominal = np.empty(NOMINAL_SIZE)
    for i in range(observations.shape[0]):
        obs = observations[i]
        nominal_gait_kernel(obs[_COMMAND], obs[_COMMAND + 1], pelvis_width, low, high, omega, delay, nominal)
        start_x, start_y = step_start_dcm_kernel(nominal, pelvis_width, omega, delay, 0.0)
        back = math.exp(-omega * obs[_ELAPSED])
        error = math.hypot(obs[_DCM] * back - start_x, obs[_DCM + 1] * back - start_y)
        out[i, 0] = min(max((error - shut) / (opened - shut), 0.0), 1.0)
    return out


def make_gate(
    policy: object, robot: RobotModel, limits: GaitLimits, band: ArrayLike | None
) -> ResidualGate | None:
    """The gate of a residual on `policy`, whose touchdown delay it takes; None where there is no band.

    Raises:
        InvalidValueError: a policy with double support, whose nominal DCM the gate does not know.
    """
    if band is None:
        return None
    config = getattr(policy, "config", None)
    if (both := getattr(config, "double_support", 0.0)) > 0:
        raise InvalidValueError(f"a residual gate knows no double support, got {both} s; use no gate")
    delay = float(getattr(config, "touchdown_delay", 0.0))
    return ResidualGate(robot, limits, delay, band)
