"""State of the pendulum at the start of a step of the undisturbed two-step periodic gait."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .double_support import transfer_weight
from .nominal_gait import NominalGait


class NominalStart(NamedTuple):
    """Canonical frame of the step that begins."""

    com: NDArray[np.float64]  # (2,) [m]
    com_velocity: NDArray[np.float64]  # (2,) [m/s]
    swing: NDArray[np.float64]  # (2,) where the foot that swings now stood, [m]


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
    stretch, turn = 1.0 - growth * carried, pelvis_width * (1.0 + growth * carried) / (growth + 1.0)
    dcm = np.array([gait.offset_x, (gait.width - pelvis_width) * stretch / (growth - 1.0) + turn])
    other_dcm_y = (other_width - pelvis_width) * stretch / (growth - 1.0) + turn
    com_x = (dcm[0] + gait.length * carried) * spread - gait.length - gait.length * sigma / growth
    com_x /= 1.0 - 1.0 / growth
    # y0' = W - spread (xi - W' c) - (y0 + W' sigma) / e, and the same with the primes exchanged
    this = gait.width - spread * (dcm[1] - other_width * carried) - other_width * sigma / growth
    other = other_width - spread * (other_dcm_y - gait.width * carried) - gait.width * sigma / growth
    com_y = (other - this / growth) / (1.0 - 1.0 / growth**2)
    com = np.array([com_x, com_y])
    return NominalStart(com, omega * (dcm - com), np.array([-gait.length, other_width]))
