"""Limits of recovery without a step, in closed form: of the DCM over two standing feet, and of a push.

The CoP may be anywhere in the convex hull P of both soles, and the CMP beside it by what the trunk's swing
gives. A DCM that stays bounded is the discounted mean of all that is to come of the CMP,

    xi = int_0^inf omega exp(-omega s) cmp(s) ds,

so that of the CoP lies in P and that of the trunk in the box of B, its fastest swing towards either side
(`capturability.trunk_reserve`): a robot can be caught in place if and only if xi lies in the Minkowski sum of
both. The edges of this sum have the normals of P and of the box, so that with h the support function of each

    n . xi <= h_P(n) + h_B(n)    for every such normal n.

A push F along the unit vector e for Delta seconds shifts the DCM by F (1 - exp(-omega Delta)) / (m omega^2),
which gives the largest push from rest at xi_0, with the trunk upright and the least over all n . e > 0,

    F*_stand = m omega^2 / (1 - exp(-omega Delta)) min_n (h_P(n) + h_B(n) - n . xi_0) / (n . e).

Of two soles side by side and a push along an axis this is

    F (1 - exp(-omega Delta)) / (m omega^2) <= d + (tau / (m g)) (1 - exp(-omega t_1))^2,
    t_1 = sqrt(theta_max j / tau),

d being the hull's extent in the direction. A reaction time r leaves exp(-omega r) of it.
`standing_trajectory` finds the same push by a linear program, which shares no formula with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError, PushRecoveryError
from ..jit import njit
from .capturability import (
    CaptureConstants,
    capture_constants,
    capture_margin_kernel,
    constants_of,
    pair,
    trunk_reserve,
)
from .gait_box import COP, TRUNK, GaitLimits
from .nominal_gait import box_around
from .robot import RobotModel

Floats = NDArray[np.float64]

CORNERS = 8  # of two soles; their hull has at most as many edges
# Rows of a hull: its edges, then how far it reaches along x, y, -x and -y
REACH = CORNERS
HULL_ROWS = CORNERS + 4
# Columns of such a row, n . z <= offset for all points z of the hull
NORMAL = 0  # pair, unit vector outward
OFFSET = 2  # [m]
HULL_COLUMNS = 3
SAME = 1e-9  # two points [m] or two normals that are no farther apart are one


@njit(cache=True)
def write_hull(other_x: float, other_y: float, turn: float, half_x: float, half_y: float, hull: Any) -> int:
    """Write the hull of a sole at the origin and its equal elsewhere; returns the number of its edges.

    An edge goes through two corners that have no other corner beyond it. Of the rows for edges those that are
    left over repeat the last one.

    Args:
        other_x: centre of the other sole [m].
        other_y: [m].
        turn: of the other sole, counter-clockwise [rad].
        half_x: half the length of a sole [m].
        half_y: half its width [m].
        hull: (HULL_ROWS, HULL_COLUMNS), written.
    """
    corners = np.empty((CORNERS, 2))
    cos, sin = math.cos(turn), math.sin(turn)
    for i in range(4):
        x, y = half_x * (1.0 if i < 2 else -1.0), half_y * (1.0 if i % 2 == 0 else -1.0)
        corners[i, 0], corners[i, 1] = x, y
        corners[4 + i, 0], corners[4 + i, 1] = other_x + cos * x - sin * y, other_y + sin * x + cos * y
    count = 0
    for i in range(CORNERS):
        for j in range(CORNERS):
            dx, dy = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
            if count == CORNERS or _crosses(corners, i, dx, dy):
                continue
            length = math.hypot(dx, dy)
            if length < SAME:
                continue
            x, y = dy / length, -dx / length
            offset = x * corners[i, 0] + y * corners[i, 1]
            edge = _support(corners, x, y) <= offset + SAME
            for k in range(count):  # three corners on a line
                edge = edge and math.hypot(x - hull[k, NORMAL], y - hull[k, NORMAL + 1]) > SAME
            if edge:
                hull[count, NORMAL], hull[count, NORMAL + 1], hull[count, OFFSET] = x, y, offset
                count += 1
    for i in range(count, CORNERS):
        hull[i] = hull[count - 1]
    for i in range(4):
        x, y = (1.0, 0.0, -1.0, 0.0)[i], (0.0, 1.0, 0.0, -1.0)[i]
        hull[REACH + i, NORMAL], hull[REACH + i, NORMAL + 1] = x, y
        hull[REACH + i, OFFSET] = _support(corners, x, y)
    return count


@njit(cache=True)
def _crosses(corners: Any, i: int, dx: float, dy: float) -> bool:
    """Whether a corner lies clearly to the right of the line from corner i along (dx, dy): it is no edge."""
    near, k = 2.0 * SAME * (abs(dx) + abs(dy)), 0
    while k < CORNERS and dy * (corners[k, 0] - corners[i, 0]) - dx * (corners[k, 1] - corners[i, 1]) <= near:
        k += 1
    return k < CORNERS


@njit(cache=True)
def _support(corners: Any, x: float, y: float) -> float:
    """Support function of the corners along (x, y)."""
    most = -np.inf
    for k in range(CORNERS):
        most = max(most, x * corners[k, 0] + y * corners[k, 1])
    return most


@njit(cache=True)
def _write_trunk_reach(angle, rate, c, reach):  # pragma: no cover
    """What the trunk gives along x, y, -x and -y from a state (2,), (2,) [m], into `reach` (2, 2)."""
    for k in range(2):
        side = 1.0 if k == 0 else -1.0
        reach[k, 0] = trunk_reserve(side * angle[0], side * rate[0], c.trunk_pitch_max, c)
        reach[k, 1] = trunk_reserve(side * angle[1], side * rate[1], c.trunk_roll_max, c)


@njit(cache=True)
def _trunk_support(x, y, reach):  # pragma: no cover
    """h_B: the most that the trunk gives along a normal (x, y) [m]."""
    return abs(x) * reach[0 if x > 0.0 else 1, 0] + abs(y) * reach[0 if y > 0.0 else 1, 1]


@njit(cache=True)
def standing_margin_kernel(dcm_x, dcm_y, angle, rate, hull, constants):  # pragma: no cover
    """Least h_P(n) + h_B(n) - n . xi over the normals of hull and box [m]; negative beyond recovery.

    Args:
        dcm_x: [m].
        dcm_y: [m].
        angle: lean of the trunk (2,) [rad].
        rate: (2,) [rad/s].
        hull: of `write_hull`.
        constants: of `capture_constants`.
    """
    reach, margin = np.empty((2, 2)), np.inf
    _write_trunk_reach(angle, rate, constants_of(constants), reach)
    for k in range(hull.shape[0]):
        x, y = hull[k, NORMAL], hull[k, NORMAL + 1]
        margin = min(margin, hull[k, OFFSET] + _trunk_support(x, y, reach) - x * dcm_x - y * dcm_y)
    return margin


NEARLY = 0.05  # feet this near to side by side may stand [m]
SETTLED = 0.02  # margin of the DCM within the hull of feet that are to stand [m]
THROWN = 0.02  # a foot without load that is higher than the other by more has been pushed off the floor [m]


@njit(cache=True)
def may_settle(
    other_x: float, other_y: float, x: float, y: float, half_x: float, half_y: float, apart: float
) -> bool:
    """Whether a robot that has touched down can stand from here on.

    Its feet are side by side to NEARLY, and the DCM lies SETTLED within their hull: far enough within what
    makes a step necessary that the two do not take turns.

    Args:
        other_x: centre of the other sole, from the stance sole's, along its axes [m].
        other_y: likewise [m].
        x: DCM [m].
        y: DCM [m].
        half_x: half the length of a sole [m].
        half_y: half its width [m].
        apart: lateral distance of feet that stand [m].
    """
    if abs(other_x) > NEARLY or abs(abs(other_y) - apart) > NEARLY:
        return False
    low_x, high_x = box_around(SETTLED - half_x, half_x - SETTLED, other_x)
    low_y, high_y = box_around(SETTLED - half_y, half_y - SETTLED, other_y)
    return low_x < x < high_x and low_y < y < high_y


@njit(cache=True)
def stays_on_other_foot(plan: Any, other_x: float, other_y: float, must: bool = False) -> bool:
    """Whether a standing robot's step begins on the foot that is not its stance foot; the plan is turned.

    The foot farther from the CoP asked for becomes the swing foot. Place and time of the plan are those of
    the step, relative to the foot that stays; its CoP and its trunk are as seen from the stance foot, and are
    turned into the other one's frame.

    Args:
        plan: gait variables (7,), canonical frame, written.
        other_x: centre of the other sole, canonical frame [m].
        other_y: likewise [m].
        must: it does, whatever the CoP is.
    """
    x, y = plan[COP] - other_x, other_y - plan[COP + 1]
    if not (must or math.hypot(x, y) < math.hypot(plan[COP], plan[COP + 1])):
        return False
    plan[COP], plan[COP + 1], plan[TRUNK + 1] = x, y, -plan[TRUNK + 1]
    return True


@njit(cache=True)
def margin_on_both_feet(other, dcm, angle, rate, constants):  # pragma: no cover
    """Capture margin of a robot that stands on both feet [m]: in place, or by a step of either foot.

    Args:
        other: centre of the other sole (2,), canonical frame [m]; taken for parallel.
        dcm: (2,) [m].
        angle: lean of the trunk (2,) [rad].
        rate: (2,) [rad/s].
        constants: of `capture_constants`.
    """
    c = constants_of(constants)
    hull = np.empty((HULL_ROWS, HULL_COLUMNS))
    write_hull(other[0], other[1], 0.0, c.cop_x_max, c.cop_y_max, hull)
    lean, pace, seen = angle.copy(), rate.copy(), dcm.copy()
    best = standing_margin_kernel(dcm[0], dcm[1], lean, pace, hull, constants)
    for _ in range(2):
        best = max(best, capture_margin_kernel(0.0, seen, lean, pace, constants))
        seen[0], seen[1] = seen[0] - other[0], other[1] - seen[1]  # from the other foot, mirrored
        lean[1], pace[1] = -lean[1], -pace[1]
    return best


@dataclass(frozen=True)
class Feet:
    """Two soles on the floor: one at the origin, x along it, and where the other one stands."""

    other: tuple[float, float]  # its centre [m]
    turn: float = 0.0  # of it, counter-clockwise [rad]

    @classmethod
    def side_by_side(cls, robot: RobotModel) -> Feet:
        """As a robot stands at rest, the other foot being the left one."""
        return cls((0.0, robot.pelvis_width))

    @property
    def middle(self) -> tuple[float, float]:
        """Between the centres of both soles, where CoM and CoP of a robot at rest are [m]."""
        return 0.5 * self.other[0], 0.5 * self.other[1]

    def hull(self, limits: GaitLimits) -> Floats:
        """Hull of both soles (HULL_ROWS, HULL_COLUMNS), see `write_hull`."""
        hull = np.empty((HULL_ROWS, HULL_COLUMNS))
        numbers = (*self.other, self.turn, limits.cop_x_max, limits.cop_y_max)
        if not all(math.isfinite(number) for number in numbers):
            raise InvalidValueError(f"Feet must be finite [m], [rad], got {self}")
        write_hull(*(float(number) for number in numbers), hull)
        return hull


def standing_margin(
    robot: RobotModel,
    limits: GaitLimits,
    feet: Feet,
    dcm: ArrayLike,
    trunk_angle: ArrayLike = (0.0, 0.0),
    trunk_rate: ArrayLike = (0.0, 0.0),
    *,
    soles: bool = True,
    flywheel: bool = True,
) -> float:
    """How far a DCM lies within what can be caught without a step [m]; negative: a step is needed.

    Args:
        robot: physical constants.
        limits: sole and trunk.
        feet: where both stand.
        dcm: (2,), relative to the first sole's centre [m].
        trunk_angle: lean (2,) [rad].
        trunk_rate: (2,) [rad/s].
        soles: whether the CoP may leave the middle between the feet.
        flywheel: whether the trunk may be accelerated.
    """
    numbers = [
        pair(name, value)
        for name, value in (("dcm", dcm), ("trunk_angle", trunk_angle), ("trunk_rate", trunk_rate))
    ]
    constants = capture_constants(robot, limits, flywheel=flywheel)
    hull = _hull(limits, feet, soles)
    (x, y), angle, rate = numbers
    return float(standing_margin_kernel(x, y, angle, rate, hull, constants))


def _hull(limits: GaitLimits, feet: Feet, soles: bool) -> Floats:
    """The hull of the feet, or what it shrinks to where the CoP stays in their middle."""
    hull = feet.hull(limits)
    if not soles:
        hull[:, OFFSET] = hull[:, NORMAL : NORMAL + 2] @ feet.middle
    return hull


def max_standing_force(
    robot: RobotModel,
    psi: float,
    duration: float = 0.1,
    *,
    soles: bool = True,
    flywheel: bool = True,
    limits: GaitLimits | None = None,
    feet: Feet | None = None,
    reaction: float = 0.0,
) -> float:
    """F*_stand(psi): the largest push that any controller can recover from without a step [N].

    The robot stands at rest with the CoM over the middle between its feet, the trunk upright.

    Args:
        robot: physical constants.
        psi: direction, counter-clockwise from the first sole's x [rad].
        duration: of the push [s].
        soles: whether the CoP may leave the middle.
        flywheel: whether the trunk may be accelerated.
        limits: sole and trunk; the paper's by default.
        feet: side by side by default.
        reaction: CoP and trunk stay at rest this long after the push began [s].
    """
    if not (math.isfinite(duration) and duration > 0):
        raise InvalidValueError(f"duration must be positive [s], got {duration}")
    impulse = max_standing_impulse(
        robot, psi, soles=soles, flywheel=flywheel, limits=limits, feet=feet, reaction=reaction
    )
    return impulse * robot.omega / -math.expm1(-robot.omega * duration)


def max_standing_impulse(
    robot: RobotModel,
    psi: float,
    *,
    soles: bool = True,
    flywheel: bool = True,
    limits: GaitLimits | None = None,
    feet: Feet | None = None,
    reaction: float = 0.0,
) -> float:
    """J*_stand(psi): the largest impulse, as a velocity jump J / m, recovered from without a step [N s].

    Arguments as for `max_standing_force`.
    """
    if not (math.isfinite(psi) and math.isfinite(reaction) and reaction >= 0):
        raise InvalidValueError(
            f"psi [rad] and reaction [s] must be finite, reaction >= 0, got {psi}, {reaction}"
        )
    limits = GaitLimits.of(robot) if limits is None else limits
    feet = Feet.side_by_side(robot) if feet is None else feet
    hull, rest = _hull(limits, feet, soles), np.zeros(2)
    c, reach = CaptureConstants(*capture_constants(robot, limits, flywheel=flywheel)), np.empty((2, 2))
    _write_trunk_reach(rest, rest, c, reach)
    shift = math.inf
    for x, y, offset in hull:
        along = x * math.cos(psi) + y * math.sin(psi)
        room = offset + _trunk_support(x, y, reach) - x * feet.middle[0] - y * feet.middle[1]
        if along > 1e-12:
            shift = min(shift, room / along)
    return float(shift * robot.mass * robot.omega * math.exp(-robot.omega * reaction))


@dataclass(frozen=True)
class StandingTrajectory:
    """The largest push, and how it is caught without a step."""

    impulse: float  # [N s]
    time: Floats  # (N + 1,) nodes, from the push's onset [s]
    dcm: Floats  # (N + 1, 2) [m]
    cop: Floats  # (N, 2) [m], constant from node to node
    trunk_angle: Floats  # (N + 1, 2) [rad]
    trunk_acceleration: Floats  # (N, 2) [rad/s^2], constant from node to node


def standing_trajectory(
    robot: RobotModel,
    psi: float,
    duration: float = 0.1,
    *,
    limits: GaitLimits | None = None,
    feet: Feet | None = None,
    horizon: float = 2.0,
    interval: float = 0.01,
) -> StandingTrajectory:
    """The largest push that any trajectory survives in place, by a linear program solved with HiGHS.

    Between nodes, h apart, inputs are constant. With lambda = exp(omega h), per axis,

        maximise  J >= 0  subject to
        xi_{k+1}    = lambda xi_k - (lambda - 1) (z_k + (j / (m g)) a_k - J e on_k / (Delta m omega^2))
        theta_{k+1} = theta_k + h theta'_k + h^2 a_k / 2,     theta'_{k+1} = theta'_k + h a_k
        n . z_k <= offset  for all edges of the hull,  |a_k| <= tau_max / j,  |theta_k| <= theta_max
        xi_0 in the middle,  theta_0 = theta'_0 = 0,  n . xi_N <= offset,  theta'_N = 0.

    A DCM that ends in the hull can be held there, so that every solution is a recovery.

    Args:
        robot: physical constants.
        psi: direction of the push, counter-clockwise from the first sole's x [rad].
        duration: of the push, a multiple of `interval` [s].
        limits: sole and trunk; the paper's by default.
        feet: side by side by default.
        horizon: [s].
        interval: h [s].
    """
    from scipy import sparse
    from scipy.optimize import linprog

    limits = GaitLimits.of(robot) if limits is None else limits
    feet = Feet.side_by_side(robot) if feet is None else feet
    n, h, growth = round(horizon / interval), interval, math.exp(robot.omega * interval)
    torque = robot.trunk_torque_max / robot.trunk_inertia
    node, inputs = sparse.eye(n, n + 1), sparse.eye(n)
    after, ends = sparse.eye(n, n + 1, 1), sparse.eye(1, n + 1)
    on = ((np.arange(n) + 0.5) * h < duration).astype(np.float64)[:, None]
    rows, columns, right, bounds = [], [], [], [(0.0, None)]
    for share, rest, most in zip(
        (math.cos(psi), math.sin(psi)), feet.middle, limits.trunk_accelerations, strict=True
    ):
        rows.append(
            sparse.bmat(
                [  # xi, theta, theta', z, a
                    [after - growth * node, None, None, (growth - 1.0) * inputs,
                     (growth - 1.0) * robot.cmp_per_trunk_acceleration * inputs],
                    [None, after - node, -h * node, None, -0.5 * h * h * inputs],
                    [None, None, after - node, None, -h * inputs],
                    [ends, None, None, None, None],
                ]
            )
        )  # fmt: skip
        push = -(growth - 1.0) * share / (duration * robot.mass * robot.omega**2) * on
        columns.append(np.vstack([push, np.zeros((2 * n + 1, 1))]))
        right.append(np.concatenate([np.zeros(3 * n), [rest]]))
        still, free = [(0.0, 0.0)], [(None, None)]
        lean, most = robot.trunk_angle_max, min(torque, most)
        bounds += (
            free * (n + 1)
            + still
            + [(-lean, lean)] * n
            + still
            + free * (n - 1)
            + still
            + free * n
            + [(-most, most)] * n
        )
    A = sparse.hstack([np.vstack(columns), sparse.block_diag(rows)], format="csr")
    hull = feet.hull(limits)[:REACH]
    size = 5 * n + 3  # variables of an axis
    inside = sparse.lil_matrix((len(hull) * (n + 1), 1 + 2 * size))
    places = [n, *range(3 * n + 3, 4 * n + 3)]  # xi_N and z
    for i, place in enumerate(places):
        for axis in range(2):
            inside[len(hull) * i : len(hull) * (i + 1), 1 + axis * size + place] = hull[
                :, NORMAL + axis, None
            ]
    cost = np.zeros(1 + 2 * size)
    cost[0] = -1.0
    result = linprog(
        cost, A_ub=inside.tocsr(), b_ub=np.tile(hull[:, OFFSET], n + 1), A_eq=A, b_eq=np.concatenate(right),
        bounds=bounds, method="highs",
    )  # fmt: skip
    if result.status != 0:
        raise PushRecoveryError(f"HiGHS stopped without an optimum: {result.message}")
    axes = [np.split(part, [n + 1, 2 * n + 2, 3 * n + 3, 4 * n + 3]) for part in np.split(result.x[1:], 2)]
    xi, angle, _, cop, acceleration = (np.column_stack(both) for both in zip(*axes, strict=True))
    return StandingTrajectory(
        float(result.x[0]), h * np.arange(n + 1, dtype=np.float64), xi, cop, angle, acceleration
    )
