"""A CoP that is planned at the edge of the sole stays there while the DCM needs it.

Whole-body control follows the CoM's acceleration that the planned CMP asks for, and the CoP makes up for the
angular momentum of all other tasks: a braking swing leg alone takes the CMP 0.3 m beyond the CoP. As a rule
that keeps the CoM on the plan. But a CoP planned at the edge says that the sole has less to give than the DCM
needs; there the CoP shall not be taken back for what the legs add. With the CoP c that the tasks ask for, the
planned one p, the edge e, and the CMP m that the DCM lacks until touchdown, the CMP moves by

    s = min((p - c) |p| / e, m),    m = (xi e^(w t) - xi_T) / (e^(w t) - 1) - cmp,

where both point the way of p. It takes a force of -f_z s / z more, which stays well within friction. The
legs turn with the CoM, which takes the CoP 8 % farther; `wrench_bounds` ends that at the edge.
"""

from __future__ import annotations

import math

from ..compiled.kernels import njit
from .bounds import Bounds, centre_of_pressure
from .kinematics import Array, Heading

SHARE_OF_GRIP = 0.8  # of the friction counted on; up to there the force may grow
SHORTEST = 1e-3  # least e^(w t) - 1


@njit(cache=True, forceinline=True)
def missing_cmp(dcm: float, goal: float, cmp: float, growth: float) -> float:
    """How far beyond a CMP another one lies, which takes the DCM to its goal at touchdown [m].

    `growth` is exp(omega t) for the time t to touchdown; all from the sole's centre [m].
    """
    return (growth * dcm - goal) / max(growth - 1.0, SHORTEST) - cmp


@njit(cache=True, forceinline=True)
def kept_cop(planned: float, cop: float, edge: float, missing: float) -> float:
    """How far [m] the CoP moves towards the edge that it is planned at, from where the tasks ask for it."""
    side = math.copysign(1.0, planned)
    wanted = min(abs(planned), edge)
    return side * max(min((wanted - side * cop) * wanted / edge, side * missing), 0.0)


@njit(cache=True, forceinline=True)
def share_within(x: float, y: float, dx: float, dy: float, radius: float) -> float:
    """Largest share (0 to 1) with (x, y) + share (dx, dy) within a radius; 0 where (x, y) is not."""
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius * radius
    if c >= 0.0 or a == 0.0:
        return 0.0
    return min((math.sqrt(b * b - a * c) - b) / a, 1.0)


@njit(cache=True, forceinline=True)
def full_sole_force(
    wrench: Array, axis: Heading, planned: Heading, missing: Heading, height: float, bounds: Bounds
) -> Heading:
    """Horizontal force, world axes [N], that keeps the CoP where it is planned at the edge.

    `planned` CoP and `missing` CMP along the foot's axes [m], `height` of the CoM over the sole [m].
    """
    s, vertical = bounds.settings, wrench[2]
    if vertical <= 0.0:
        return 0.0, 0.0
    x, y = centre_of_pressure(wrench, axis)
    x = kept_cop(planned[0], x, s.cop_x_max, missing[0])
    y = kept_cop(planned[1], y, s.cop_y_max, missing[1])
    gain = -vertical / height
    fx, fy = gain * (axis[0] * x - axis[1] * y), gain * (axis[1] * x + axis[0] * y)
    share = share_within(wrench[0], wrench[1], fx, fy, SHARE_OF_GRIP * bounds.grip[0] * vertical)
    return share * fx, share * fy
