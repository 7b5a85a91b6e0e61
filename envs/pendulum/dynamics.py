"""n linear inverted pendulums with flywheel, integrated exactly.

Per horizontal axis, with x_CMP = z + (j / (m g)) theta'' and a push F,

    x'' = omega^2 (x - c),    c = x_CMP - F / (m omega^2),    theta'' = a.

Between events c and a are constant, so xi = x + x'/omega and eta = x - x'/omega follow exp(+-omega t) about
c. A cycle is cut at every event inside it: touchdown, the edges of pushes, the trunk's arrival at its stop.
There is no integration step. State is kept in the world frame: x forward, y left. In double support, which
begins every step, the other foot stays where it stood and the CoP may be anywhere in the hull of both soles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit
from ...controllers.model.double_support import both_stand
from ...controllers.model.frame import side_sign
from ...controllers.model.gait_box import DURATION, STEP
from ..scenario.push_force import resolve_starts
from .model_errors import acting, begin_cycle
from .support import supported_cop, transferred_cop

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FAILURES = ("", "dcm_diverged", "not_finite")
DIVERGED, NOT_FINITE = range(1, len(FAILURES))
LANDED = 1e-9  # a touchdown due this soon after a cycle belongs to it [s]


class Pendulums(NamedTuple):
    """State of n pendulums, world frame; axis 0 forward, axis 1 left."""

    com: Array  # (n, 2) [m]
    velocity: Array  # (n, 2) [m/s]
    angle: Array  # (n, 2) lean of the trunk [rad]
    rate: Array  # (n, 2) [rad/s]
    stance: Array  # (n, 2) centre of the stance sole [m]
    lift: Array  # (n, 2) where the swing foot stood [m]
    plan: Array  # (n, 7) gait variables, canonical frame
    cop: Array  # (n, 2) CoP at the end of the cycle [m]
    cmp: Array  # (n, 2) [m]
    push: Array  # (n, 2) external force over m omega^2 that explains the DCM's last cycle [m]
    time: Array  # (n,) since reset [s]
    step_start: Array  # (n,) [s]
    side: Ints  # (n,) stance foot, index into SIDES
    steps: Ints  # (n,) completed
    failure: Ints  # (n,) index into FAILURES
    heading: Array  # (n,) always 0: a pendulum does not turn [rad]


class Physics(NamedTuple):
    """Physical constants."""

    omega: float  # [1/s]
    mass: float  # [kg]
    gain: float  # j / (m g) [m s^2]
    half_length: float  # of the sole [m]
    half_width: float  # [m]
    acceleration_max: float  # tau_max / j [rad/s^2]
    angle_max: float  # [rad]
    double_support: float  # [s]


@njit(cache=True)
def time_to_stop(angle, rate, acceleration, limit):  # pragma: no cover
    """Least s > 0 with angle + rate s + acceleration s^2 / 2 = +-limit, moving outwards; inf if never."""
    best = np.inf
    for sign in (1.0, -1.0):
        room, speed, push = limit - sign * angle, sign * rate, sign * acceleration
        if room <= 0.0 and (speed > 0.0 or (speed == 0.0 and push > 0.0)):
            return 0.0
        square = speed * speed + 2.0 * push * room
        if square < 0.0 or room < 0.0:
            continue
        root = speed + math.sqrt(square)
        if root > 0.0 and room > 0.0:
            best = min(best, 2.0 * room / root)
    return best


@njit(cache=True)
def advance_axis(s, k, axis, cop, acceleration, force, span, p):  # pragma: no cover
    """One axis for a span without events but the trunk's stop.

    The stop is inelastic: it takes the trunk's angular momentum j theta' at once, a torque impulse that gives
    the CoM j theta' / (m h) [m/s] = omega^2 (j / (m g)) theta'. While the torque pushes the trunk against its
    stop the two cancel.
    """
    left = span
    for _ in range(4):
        a = acceleration
        angle, rate = s.angle[k, axis], s.rate[k, axis]
        if abs(angle) >= p.angle_max and angle * a >= 0.0 and rate == 0.0:
            a = 0.0
            hit = np.inf
        else:
            hit = time_to_stop(angle, rate, a, p.angle_max)
        d = min(left, hit)
        centre = cop + p.gain * a - force / (p.mass * p.omega * p.omega)
        x, v = s.com[k, axis] - centre, s.velocity[k, axis] / p.omega
        grow = math.exp(p.omega * d)
        xi, eta = (x + v) * grow, (x - v) / grow
        s.com[k, axis] = centre + 0.5 * (xi + eta)
        s.velocity[k, axis] = 0.5 * p.omega * (xi - eta)
        s.angle[k, axis] = angle + d * (rate + 0.5 * a * d)
        s.rate[k, axis] = rate + a * d
        s.cmp[k, axis] = cop + p.gain * a
        if hit > left:
            break
        s.velocity[k, axis] += p.omega * p.omega * p.gain * s.rate[k, axis]
        s.rate[k, axis] = 0.0
        s.angle[k, axis] = math.copysign(p.angle_max, s.angle[k, axis])
        left -= d
        if left <= 0.0:
            break


@njit(cache=True)
def touch_down(s, k):  # pragma: no cover
    """The swing foot becomes the stance foot, exactly where the plan wants it."""
    sign = side_sign(s.side[k])
    old_x, old_y = s.stance[k, 0], s.stance[k, 1]
    s.stance[k, 0] = old_x + s.plan[k, STEP]
    s.stance[k, 1] = old_y + sign * s.plan[k, STEP + 1]
    s.lift[k, 0], s.lift[k, 1] = old_x, old_y
    s.side[k] = 1 - s.side[k]
    s.steps[k] += 1
    s.step_start[k] = s.time[k]


@njit(cache=True)
def _next_event(s, q, k, end, landed, double_support):  # pragma: no cover
    """Time of the next event after now, at most `end`; starts of pushes that wait for it are resolved [s]."""
    now = s.time[k]
    until = end
    if not landed:
        until = min(until, s.step_start[k] + s.plan[k, DURATION])
    if both_stand(now - s.step_start[k], double_support):
        until = min(until, s.step_start[k] + double_support)
    resolve_starts(
        q.start[k], q.step[k], q.fraction[k], s.steps[k], s.step_start[k], s.plan[k, DURATION], now, until
    )
    for i in range(q.start.shape[1]):
        if now < q.start[k, i] < until:
            until = q.start[k, i]
        stop = q.start[k, i] + q.duration[k, i]
        if now < stop < until:
            until = stop
    return until


@njit(cache=True)
def _force(s, q, e, k, span, p):  # pragma: no cover
    """External force of the coming span as on the believed mass (2) [N]; counts what pushes deliver."""
    force_x, force_y = 0.0, 0.0
    for i in range(q.start.shape[1]):
        if q.start[k, i] <= s.time[k] < q.start[k, i] + q.duration[k, i]:
            force_x += q.force[k, i, 0]
            force_y += q.force[k, i, 1]
            for a in range(3):
                q.delivered[k, i, a] += q.force[k, i, a] * span
    downhill = e.downhill[k]
    return force_x / e.weight[k] + p.mass * downhill[0], force_y / e.weight[k] + p.mass * downhill[1]


@njit(cache=True)
def _estimate_push(s, k, force_x, force_y, span, dt, p):  # pragma: no cover
    """Add a span's share to the push estimate of its cycle, as an observer of DCM and CMP would find it.

    The DCM ends the cycle beyond its prediction by sum exp(omega left) (exp(omega span) - 1) F / (m omega^2),
    `left` being what follows the span; the estimate is that over (exp(omega dt) - 1).
    """
    grow = math.exp(p.omega * span)
    share = (grow - 1.0) / (math.exp(p.omega * dt) - 1.0) / (p.mass * p.omega * p.omega)
    s.push[k, 0] = s.push[k, 0] * grow + share * force_x
    s.push[k, 1] = s.push[k, 1] * grow + share * force_y


@njit(cache=True)
def advance(s, q, e, dt, p):  # pragma: no cover
    """One control cycle of every pendulum under its plan and with its model errors.

    The CoP is clipped to what the feet on the floor span and the trunk's acceleration to the torque. After a
    touchdown inside the cycle the CoP makes the undisturbed transfer's mean (without double support it rests
    at the centre of the new sole) and the trunk's acceleration goes on. One that is due when the cycle ends
    happens then, so that the next action already belongs to the new step.
    """
    for k in range(s.time.shape[0]):
        if s.failure[k] != 0:
            continue
        end = s.time[k] + dt
        cop_x, cop_y, pitch, roll, change = begin_cycle(s, e, k, dt, p)
        landed = False
        s.push[k, 0] = s.push[k, 1] = 0.0
        while s.time[k] < end:
            if s.time[k] >= change:
                cop_x, cop_y, pitch, roll = acting(s, e, k, e.lag[k], end - s.time[k], p)
                change = np.inf
            if not landed and s.time[k] >= s.step_start[k] + s.plan[k, DURATION]:
                touch_down(s, k)
                landed = True
                cop_x, cop_y = transferred_cop(s, k, end - s.time[k], p)
            elif p.double_support > 0.0:  # the other foot may have left the floor within the cycle
                cop_x, cop_y = supported_cop(s, k, cop_x, cop_y, p)
            until = _next_event(s, q, k, min(end, change), landed, p.double_support)
            span = until - s.time[k]
            force_x, force_y = _force(s, q, e, k, span, p)
            _estimate_push(s, k, force_x, force_y, span, dt, p)
            advance_axis(s, k, 0, s.stance[k, 0] + cop_x, pitch, force_x, span, p)
            advance_axis(s, k, 1, s.stance[k, 1] + cop_y, roll, force_y, span, p)
            s.time[k] = until
        s.cop[k, 0], s.cop[k, 1] = s.stance[k, 0] + cop_x, s.stance[k, 1] + cop_y
        if not landed and s.time[k] >= s.step_start[k] + s.plan[k, DURATION] - LANDED:
            touch_down(s, k)
