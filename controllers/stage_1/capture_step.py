"""The field's first foothold: the capture point's error moves it one for one, and T stays nominal.

Raibert (1986, chapter 2) places a foot at half of what the body covers in a stance, and moves it by
k (v - v_des); with k = 1 / omega the sum of place and velocity is the capture point (Pratt et al. 2006), xi.
On a periodic gait with sway the nominal state at the same moment t stands for the half stance:

    u = u_nom + (xi - xi_nom(t)) / (1 - c),    xi_nom(t) = (u_nom + b_nom) exp(-omega (T + delay - t)),

canonical frame, clipped to the step box; c is 0 but in double support (`planner`). Nothing is predicted: an
error e grows to e exp(omega (T - t)) until touchdown, and the foot follows it as it grows. Where it can
follow to the end, b = b_nom.
"""

from __future__ import annotations

import math

from ..compiled.kernels import njit
from ..model.gait_box import DURATION, STEP
from ..model.nominal_gait import NOMINAL_DURATION, NOMINAL_STEP
from ..model.observation import ELAPSED
from .columns import DCM_AHEAD, NOMINAL_OFFSET, OFFSET, SHIFT


@njit(cache=True)
def write_capture_step(obs, c, low, high, nominal, row):  # pragma: no cover
    """Place [m] and time [s] of the step and its DCM offset [m] into `row`; T is nominal, if not past."""
    row[DURATION] = max(nominal[NOMINAL_DURATION], obs[ELAPSED] + c.duration_margin)
    growth = math.exp(c.omega * (row[DURATION] + c.touchdown_delay - obs[ELAPSED]))
    for axis in range(2):
        dcm, step = row[DCM_AHEAD + axis] - row[SHIFT + axis], nominal[NOMINAL_STEP + axis]
        error = dcm - (step + row[NOMINAL_OFFSET + axis]) / growth
        row[STEP + axis] = min(max(step + error / (1.0 - c.transfer), low[axis]), high[axis])
        row[OFFSET + axis] = dcm * growth - row[STEP + axis]
