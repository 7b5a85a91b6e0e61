"""What the pendulum does over the rest of this step and two more, linear in jerks and footsteps.

Along one axis, with c = x, v = x' / omega, a = x'' / omega^2, j = x''' / omega^3 [m] and s = omega d for an
interval of d seconds, the cart-table model with a constant jerk is exactly (Wieber 2006, eq. 5)

    c + v s + a s^2 / 2 + j s^3 / 6,    v + a s + j s^2 / 2,    a + j s,        z = c - a (the CoP).

Each step has SAMPLES equal intervals. The new foot takes over at once, so a is free anew at each touchdown,
as it is now: a robot can put its CoP anywhere in the sole at any time. A quantity is a row of coefficients of
the columns below; the matrices are the same for both axes.
"""

from __future__ import annotations

import numpy as np

from ..compiled.kernels import njit

STEPS = 3  # this one, and the two whose feet are placed
SAMPLES = 4  # intervals of a step
NODES = STEPS * (SAMPLES + 1)  # beginning and ends of the intervals of each step

# Columns
ACCELERATION = 0  # a at the beginning of each step
JERK = ACCELERATION + STEPS  # j of each interval
FOOT = JERK + STEPS * SAMPLES  # first and second footstep, each from the foot before
UNKNOWNS = FOOT + STEPS - 1
POSITION, RATE = UNKNOWNS, UNKNOWNS + 1  # c and v now
COLUMNS = RATE + 1


@njit(cache=True)
def predict(remaining, period, omega, cop, rate, spans):  # pragma: no cover
    """Predict the nodes of the horizon.

    Args:
        remaining: time until the next touchdown [s].
        period: of the steps after it [s].
        omega: natural frequency [1/s].
        cop: CoP less the centre of the foot that it is in, written (NODES, COLUMNS) [m].
        rate: v, written (NODES, COLUMNS) [m].
        spans: time that each node stands for, half of the intervals beside it, written (NODES,) [s].
    """
    c, v, a, foot = np.zeros(COLUMNS), np.zeros(COLUMNS), np.zeros(COLUMNS), np.zeros(COLUMNS)
    c[POSITION], v[RATE] = 1.0, 1.0
    node = 0
    spans[:] = 0.0
    for step in range(STEPS):
        span = (remaining if step == 0 else period) / SAMPLES
        s = omega * span
        a[:] = 0.0
        a[ACCELERATION + step] = 1.0
        if step > 0:
            foot[FOOT + step - 1] = 1.0
        cop[node], rate[node] = c - a - foot, v
        for interval in range(SAMPLES):
            jerk = JERK + step * SAMPLES + interval
            c += v * s + a * (0.5 * s * s)
            v += a * s
            c[jerk], v[jerk], a[jerk] = s**3 / 6.0, 0.5 * s * s, s
            spans[node] += 0.5 * span
            node += 1
            spans[node] += 0.5 * span
            cop[node], rate[node] = c - a - foot, v
        node += 1
