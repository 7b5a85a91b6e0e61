"""The nominal gait of a commanded velocity, and the pendulum's state at the start of its steps.

Nominal gait of a commanded velocity, by the mid-range rule.

The step period is the middle of the range that the step box leaves for the commanded velocity; the DCM offset
is that of the two-step periodic gait of the linear inverted pendulum (Khadiv et al. 2016, section III):

    L = v_x P,    W = l_p + v_y P,    P = T + touchdown_delay,    lambda = exp(omega P),
    b_x = L / (lambda - 1),    b_y = v_y P / (lambda - 1) - l_p / (lambda + 1).

With double support of d seconds (`double_support.py`) and c = kappa(0), the CoP's transfer changes it to

    b_x = L (1 - lambda c) / (lambda - 1),
    b_y = v_y P (1 - lambda c) / (lambda - 1) - l_p (1 + lambda c) / (lambda + 1).

All of it is in the canonical frame: a velocity towards the swing side widens this step and narrows the next.

Sideways the range of P ends at min(W_max - l_p, l_p - W_min) / |v_y|, not at the published W_max / |v_y|: of
two steps one is l_p + v_y P wide and the other l_p - v_y P, and both have to lie in the box. With the paper's
limits (0.1 to 0.4 m, l_p = 0.2 m) and v_y = 0.2 m/s that gives T = 0.40 s with steps of 0.28 and 0.12 m; the
published rule gives 0.65 s, whose narrow step, 0.07 m, the box forbids.

State of the pendulum at the start of a step of the undisturbed two-step periodic gait.

In the canonical frame its DCM is the offset of the step before, whose sway has the other sign, seen from this
step's mirrored frame. With lambda = exp(omega (T + delay)) and, in double support of d seconds, c = kappa(0),

    xi_0 = (b_x, (W - l_p) (1 - lambda c) / (lambda - 1) + l_p (1 + lambda c) / (lambda + 1)).

The foot of the step before stood at p; less p c, what the CoP's transfer takes off the DCM, this is what
drifts to the nominal step's end, u_T + b = lambda (xi_0 - p c).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..jit import njit
from .double_support import check_double_support, transfer_weight
from .gait_box import DURATION, STEP, GaitLimits
from .robot import RobotModel

# Columns of a nominal gait (5,); of a pair (x, y) the first one
NOMINAL_STEP = 0  # pair, L, W [m]
NOMINAL_DURATION = 2  # T [s]
NOMINAL_DCM_OFFSET = 3  # pair, b_x, b_y [m]
NOMINAL_SIZE = 5


@dataclass(frozen=True)
class NominalGait:
    """Step of the undisturbed gait, canonical frame."""

    length: float  # L_nom [m]
    width: float  # W_nom, outward [m]
    duration: float  # T_nom [s]
    offset_x: float  # b_x,nom [m]
    offset_y: float  # b_y,nom [m]

    @property
    def offset(self) -> NDArray[np.float64]:
        """DCM at touchdown less the foothold, (2,) [m]."""
        return np.array([self.offset_x, self.offset_y])

    @property
    def row(self) -> NDArray[np.float64]:
        """The same as kernels take it, (5,)."""
        return np.array(dataclasses.astuple(self), dtype=np.float64)


@njit(cache=True)
def nominal_gait_kernel(
    velocity_x, velocity_y, pelvis_width, low, high, omega, touchdown_delay, nominal, double_support=0.0
):  # pragma: no cover
    """Write (L, W, T, b_x, b_y) into `nominal` (5,); `low`, `high` start with the bounds of L, W, T.

    A command too fast for the shortest step is followed as far as the step box goes.
    """
    period_max = high[DURATION] + touchdown_delay
    if velocity_x > 0.0:
        period_max = min(period_max, high[STEP] / velocity_x)
    elif velocity_x < 0.0:
        period_max = min(period_max, low[STEP] / velocity_x)
    if velocity_y != 0.0:
        room = max(0.0, min(high[STEP + 1] - pelvis_width, pelvis_width - low[STEP + 1]))
        period_max = min(period_max, room / abs(velocity_y))
    duration = max(low[DURATION], 0.5 * (low[DURATION] + period_max - touchdown_delay))
    period = duration + touchdown_delay
    length = min(max(velocity_x * period, low[STEP]), high[STEP])
    room = min(high[STEP + 1] - pelvis_width, pelvis_width - low[STEP + 1])
    sway = min(max(velocity_y * period, -room), room)
    growth = math.exp(omega * period)
    offset_x = length / (growth - 1.0)
    offset_y = sway / (growth - 1.0) - pelvis_width / (growth + 1.0)
    if double_support > 0.0:
        carried = growth * transfer_weight(0.0, double_support, omega)
        offset_x *= 1.0 - carried
        offset_y = sway * (1.0 - carried) / (growth - 1.0) - pelvis_width * (1.0 + carried) / (growth + 1.0)
    nominal[NOMINAL_STEP], nominal[NOMINAL_STEP + 1] = length, pelvis_width + sway
    nominal[NOMINAL_DURATION] = duration
    nominal[NOMINAL_DCM_OFFSET], nominal[NOMINAL_DCM_OFFSET + 1] = offset_x, offset_y


def nominal_gait(
    robot: RobotModel,
    limits: GaitLimits,
    velocity: ArrayLike = (0.0, 0.0),
    touchdown_delay: float = 0.0,
    double_support: float = 0.0,
) -> NominalGait:
    """Nominal gait for a commanded velocity.

    Args:
        robot: physical constants.
        limits: step box.
        velocity: commanded (v_x, v_y) in the canonical frame, (2,) [m/s].
        touchdown_delay: the new foot carries load this long after T [s].
        double_support: both feet stand for this long from touchdown on [s].

    Raises:
        InvalidValueError: for a velocity that is not two finite numbers, a pelvis wider than the step box or
            a double support longer than the shortest step.
    """
    command = np.asarray(velocity, dtype=np.float64)
    if command.shape != (2,) or not np.isfinite(command).all():
        raise InvalidValueError(f"velocity must be two finite numbers [m/s], got {velocity!r}")
    check_pelvis(robot, limits)
    check_double_support(double_support, limits)
    out = np.empty(NOMINAL_SIZE)
    nominal_gait_kernel(
        command[0], command[1], robot.pelvis_width, limits.low, limits.high, robot.omega, touchdown_delay,
        out, double_support,
    )  # fmt: skip
    return NominalGait(*(float(value) for value in out))


def check_pelvis(robot: RobotModel, limits: GaitLimits) -> None:
    """Raise unless the feet can stand l_p apart, which the in-place gait needs."""
    if not limits.width_min <= robot.pelvis_width <= limits.width_max:
        raise InvalidValueError(
            f"pelvis_width must lie within the step width [{limits.width_min}, {limits.width_max}] m, "
            f"got {robot.pelvis_width}"
        )


class NominalStart(NamedTuple):
    """Canonical frame of the step that begins."""

    com: NDArray[np.float64]  # (2,) [m]
    com_velocity: NDArray[np.float64]  # (2,) [m/s]
    swing: NDArray[np.float64]  # (2,) where the foot that swings now stood, [m]


@njit(cache=True)
def step_start_dcm_kernel(nominal, pelvis_width, omega, delay, double_support):  # pragma: no cover
    """xi_0 of a nominal gait (5,), two numbers [m]."""
    growth = math.exp(omega * (nominal[NOMINAL_DURATION] + delay))
    carried = growth * transfer_weight(0.0, double_support, omega)
    sway = (nominal[NOMINAL_STEP + 1] - pelvis_width) * (1.0 - carried)
    start_y = sway / (growth - 1.0) + pelvis_width * (1.0 + carried) / (growth + 1.0)
    return nominal[NOMINAL_DCM_OFFSET], start_y


@njit(cache=True)
def drifting_dcm_kernel(nominal, omega, delay):  # pragma: no cover
    """xi_0 - p c = (u_T + b) / lambda of a nominal gait (5,), two numbers [m]."""
    decay = math.exp(-omega * (nominal[NOMINAL_DURATION] + delay))
    end_x = nominal[NOMINAL_STEP] + nominal[NOMINAL_DCM_OFFSET]
    end_y = nominal[NOMINAL_STEP + 1] + nominal[NOMINAL_DCM_OFFSET + 1]
    return end_x * decay, end_y * decay


def step_start_dcm(
    gait: NominalGait, pelvis_width: float, omega: float, delay: float = 0.0, double_support: float = 0.0
) -> tuple[float, float]:
    """xi_0 of a nominal gait, canonical frame [m]; arguments as for `nominal_start`."""
    timing = float(omega), float(delay), float(double_support)
    return step_start_dcm_kernel(gait.row, float(pelvis_width), *timing)


def nominal_start(
    gait: NominalGait, pelvis_width: float, omega: float, delay: float = 0.0, double_support: float = 0.0
) -> NominalStart:
    """CoM, its velocity and the swing foot at the start of a step of `gait`.

    With e = exp(omega P), P = T + delay, and the stance at 0: com(P) = xi_0 (e - 1/e) / 2 + com_0 / e.
    Sagittally com(P) = com_0 + L; laterally this step of width W and the next one of 2 l_p - W take turns,
    and the frame is mirrored between them: com_next = W - com(P). Double support of d seconds, with the other
    foot at p, c = kappa(0) and sigma = sinh(omega d) / (omega d) - 1, makes it

        com(P) = (xi_0 - p c) (e - 1/e) / 2 + (com_0 + p sigma) / e.

    Args:
        gait: nominal gait of this step.
        pelvis_width: l_p [m].
        omega: natural frequency [1/s].
        delay: the new foot carries load this long after T [s].
        double_support: both feet stand for this long from touchdown on [s].
    """
    growth = math.exp(omega * (gait.duration + delay))
    spread = 0.5 * (growth - 1.0 / growth)
    other_width = 2.0 * pelvis_width - gait.width
    carried = sigma = 0.0
    if double_support > 0.0:
        carried = transfer_weight(0.0, double_support, omega)
        sigma = math.sinh(omega * double_support) / (omega * double_support) - 1.0
    other_gait = dataclasses.replace(gait, width=other_width)  # sideways; its DCM along x is not used
    dcm = np.array(step_start_dcm(gait, pelvis_width, omega, delay, double_support))
    _, other_dcm_y = step_start_dcm(other_gait, pelvis_width, omega, delay, double_support)
    com_x = (dcm[0] + gait.length * carried) * spread - gait.length - gait.length * sigma / growth
    com_x /= 1.0 - 1.0 / growth
    # y0' = W - spread (xi - W' c) - (y0 + W' sigma) / e, and the same with the primes exchanged
    this = gait.width - spread * (dcm[1] - other_width * carried) - other_width * sigma / growth
    other = other_width - spread * (other_dcm_y - gait.width * carried) - gait.width * sigma / growth
    com_y = (other - this / growth) / (1.0 - 1.0 / growth**2)
    com = np.array([com_x, com_y])
    return NominalStart(com, omega * (dcm - com), np.array([-gait.length, other_width]))
