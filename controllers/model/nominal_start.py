"""State of the pendulum at the start of a step of the undisturbed two-step periodic gait.

In the canonical frame its DCM is the offset of the step before, whose sway has the other sign, seen from this
step's mirrored frame. With lambda = exp(omega (T + delay)) and, in double support of d seconds, c = kappa(0),

    xi_0 = (b_x, (W - l_p) (1 - lambda c) / (lambda - 1) + l_p (1 + lambda c) / (lambda + 1)).

The foot of the step before stood at p; less p c, what the CoP's transfer takes off the DCM, this is what
drifts to the nominal step's end, u_T + b = lambda (xi_0 - p c).
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from .double_support import transfer_weight
from .nominal_gait import NOMINAL_DCM_OFFSET, NOMINAL_DURATION, NOMINAL_STEP, NominalGait


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
