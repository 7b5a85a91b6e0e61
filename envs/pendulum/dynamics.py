"""n linear inverted pendulums with flywheel, integrated exactly, with their model errors.

Per horizontal axis, with x_CMP = z + (j / (m g)) theta'' and a push F,

    x'' = omega^2 (x - c),    c = x_CMP - F / (m omega^2),    theta'' = a.

Between events c and a are constant, so xi = x + x'/omega and eta = x - x'/omega follow exp(+-omega t) about
c. A cycle is cut at every event inside it: touchdown, the edges of pushes, the trunk's arrival at its stop.
There is no integration step. State is kept in the world frame: x forward, y left. In double support, which
begins every step, the other foot stays where it stood and the CoP may be anywhere in the hull of both soles.

A pendulum m (1 + e) times as heavy, its trunk's inertia alike, falls as before, but a push F and a trunk
torque tau move it less: F / (1 + e), theta'' / (1 + e). A floor that rises by s pulls it downhill with
m g tan(s); the part of gravity normal to the floor stays g. With a delay d, CoP and trunk acceleration of an
action act from d after its period began; place and time of the step count at once. An action for a step that
is over when its time comes moves the CoP as a touchdown does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.jit import njit
from ...controllers.model.gait_box import COP, DURATION, STEP, TRUNK
from ...controllers.model.nominal_gait import both_stand, nearest_in_hull, transfer_mean
from ...controllers.model.observation import PUSH_ESTIMATE, side_sign
from ...controllers.model.robot import GRAVITY
from ...controllers.model.standing import may_settle, stays_on_other_foot
from ...controllers.stage_1 import stopping_debt
from ...controllers.whole_body.swing import STAND
from ..scenario.arrays import may_stay, resolve_starts
from ..scenario.model_errors import BOUNDS
from ..scenario.noise import (
    COM_NOISE,
    MOTION_NOISES,
    VELOCITY_NOISE,
    add_motion_noise,
    counter_seed,
    motion_noise,
)
from ..scenario.scenario import EXACT_SENSING, Scenario


@njit(cache=True)
def supported_cop(s, k, cop_x, cop_y, p):  # pragma: no cover
    """The CoP (world axes, from the stance sole) brought to the nearest point that the feet can bear."""
    if s.standing[k] != 0 or both_stand(s.time[k] - s.step_start[k], p.double_support):
        other_x, other_y = s.lift[k, 0] - s.stance[k, 0], s.lift[k, 1] - s.stance[k, 1]
        return nearest_in_hull(cop_x, cop_y, other_x, other_y, p.half_length, p.half_width)
    return (
        min(max(cop_x, -p.half_length), p.half_length),
        min(max(cop_y, -p.half_width), p.half_width),
    )


@njit(cache=True)
def transferred_cop(s, k, left, p):  # pragma: no cover
    """CoP of no action's, for the next `left` seconds or the rest of double support: the transfer's mean."""
    elapsed = s.time[k] - s.step_start[k]
    if s.standing[k] != 0:
        return 0.5 * (s.lift[k, 0] - s.stance[k, 0]), 0.5 * (s.lift[k, 1] - s.stance[k, 1])
    if left <= 0.0 or not both_stand(elapsed, p.double_support):
        return 0.0, 0.0
    share = transfer_mean(elapsed, min(left, p.double_support - elapsed), p.double_support, p.omega)
    return share * (s.lift[k, 0] - s.stance[k, 0]), share * (s.lift[k, 1] - s.stance[k, 1])


Array = NDArray[np.float64]
Ints = NDArray[np.int64]

KNOWN = ("mass", "slope_forward", "slope_left", "delay", "dcm_noise")
INSTANT = 1e-9  # [s]
# Columns of what an action asked for; of a pair (x, y) the first one
ASKED_COP = 0  # pair, from the stance sole [m]
ASKED_TRUNK = 2  # pair, trunk acceleration [rad/s^2]
ASKED_STEP = 4  # number of the step that it was for
ASKED_SIZE = 5

_PUSH = PUSH_ESTIMATE.start


class PendulumErrors(NamedTuple):
    """Model errors of n pendulums for compiled loops."""

    weight: Array  # (n,) true mass over the believed one
    downhill: Array  # (n, 2) of gravity along the floor, over the believed mass [m/s^2]
    lag: Ints  # (n,) whole periods of the delay
    rest: Array  # (n,) what is left of it [s]
    deviation: Array  # (n,) of the observed DCM [m]
    seed: Ints  # (n,)
    period: Ints  # (n,) since reset
    asked: Array  # (n, L, ASKED_SIZE) ring over periods, columns see above; world axes


def no_errors(n: int, dt: float) -> PendulumErrors:
    """Arrays of n pendulums without errors, planned for every `dt` [s]."""
    longest = math.ceil(BOUNDS["delay"][2] / dt) + 2
    return PendulumErrors(
        weight=np.ones(n), downhill=np.zeros((n, 2)), lag=np.zeros(n, np.int64), rest=np.zeros(n),
        deviation=np.zeros(n), seed=np.zeros(n, np.int64), period=np.zeros(n, np.int64),
        asked=np.zeros((n, longest, ASKED_SIZE)),
    )  # fmt: skip


def assign_errors(table: PendulumErrors, k: int, scenario: Scenario, dt: float) -> None:
    """Give pendulum k the errors of a scenario, at its beginning.

    Raises:
        InvalidValueError: for an error, an option of the physics or a sensing that a pendulum cannot have.
    """
    if scenario.sensing != EXACT_SENSING:
        raise InvalidValueError(
            f"the pendulum has no sensors: sensing must be {EXACT_SENSING!r}, got {scenario.sensing!r}"
        )
    if options := scenario.physics.to_dict():
        raise InvalidValueError(
            f"the pendulum is integrated exactly and has no options of physics, got {options}"
        )
    errors = scenario.errors
    errors.require_only("the pendulum", KNOWN)
    lag = math.floor((errors.delay + INSTANT) / dt)
    rest = errors.delay - lag * dt
    table.weight[k] = 1.0 + errors.mass
    table.downhill[k] = [0.0 - GRAVITY * math.tan(angle) for angle in errors.tilt]
    table.lag[k], table.rest[k] = lag, rest if rest > INSTANT else 0.0
    table.deviation[k] = errors.dcm_noise
    table.seed[k] = counter_seed(scenario.noise_seed)
    table.period[k] = 0
    table.asked[k] = 0.0
    table.asked[k, :, ASKED_STEP] = -1.0  # before reset: for no step of this episode


@njit(cache=True)
def acting(s, e, k, ago, left, p):  # pragma: no cover
    """CoP from the stance sole (2) and trunk acceleration (2) of the action of `ago` periods before this."""
    size = e.asked.shape[1]
    row = e.asked[k, (e.period[k] - ago) % size]
    if row[ASKED_STEP] == s.steps[k]:
        cop_x, cop_y = supported_cop(s, k, row[ASKED_COP], row[ASKED_COP + 1], p)
    else:
        cop_x, cop_y = transferred_cop(s, k, left, p)
    return cop_x, cop_y, row[ASKED_TRUNK], row[ASKED_TRUNK + 1]


@njit(cache=True)
def begin_cycle(s, e, k, dt, p):  # pragma: no cover
    """CoP (2), trunk acceleration (2) as the cycle begins, as `acting`; and when another action sets in [s].

    The acceleration is the one that the torque for the asked one gives the true trunk.
    """
    sign = side_sign(s.side[k])
    pitch = min(max(s.plan[k, TRUNK], -p.acceleration_max), p.acceleration_max) / e.weight[k]
    roll = sign * min(max(s.plan[k, TRUNK + 1], -p.acceleration_max), p.acceleration_max) / e.weight[k]
    cop_x, cop_y = s.plan[k, COP], sign * s.plan[k, COP + 1]
    if e.lag[k] == 0 and e.rest[k] == 0.0:
        cop_x, cop_y = supported_cop(s, k, cop_x, cop_y, p)
        return cop_x, cop_y, pitch, roll, np.inf
    row = e.asked[k, e.period[k] % e.asked.shape[1]]
    row[ASKED_COP], row[ASKED_COP + 1] = cop_x, cop_y
    row[ASKED_TRUNK], row[ASKED_TRUNK + 1], row[ASKED_STEP] = pitch, roll, s.steps[k]
    late, change = e.lag[k], np.inf
    if e.rest[k] > 0.0:
        late, change = late + 1, s.time[k] + e.rest[k]
    cop_x, cop_y, pitch, roll = acting(s, e, k, late, dt, p)
    return cop_x, cop_y, pitch, roll, change


@njit(cache=True)
def show(s, e, p, dt, truth, seen, first, end):  # pragma: no cover
    """Write what policies see of pendulums first..end-1, (n, 36), from observations without noise (n, 36).

    The push estimate is that of an observer who knows no other DCM: noise n of the DCM changes it by
    (n - exp(omega dt) n of the period before) / (exp(omega dt) - 1).
    """
    noise, before = np.empty(MOTION_NOISES), np.empty(MOTION_NOISES)
    grow = math.exp(p.omega * dt)
    for k in range(first, end):
        seen[k] = truth[k]
        if e.deviation[k] == 0.0:
            continue
        motion_noise(e.seed[k], e.period[k], e.deviation[k], p.omega, s.steps[k], noise)
        add_motion_noise(noise, p.omega, seen[k])
        if e.period[k] == 0:
            continue
        motion_noise(e.seed[k], e.period[k] - 1, e.deviation[k], p.omega, s.steps[k], before)
        for axis in range(2):
            now = noise[COM_NOISE + axis] + noise[VELOCITY_NOISE + axis] / p.omega
            then = before[COM_NOISE + axis] + before[VELOCITY_NOISE + axis] / p.omega
            seen[k, _PUSH + axis] += (now - grow * then) / (grow - 1.0)


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
    standing: Ints  # (n,) 1: both feet stay where they are until a step begins


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
    pelvis_width: float  # l_p [m]
    duration_max: float  # a standing robot that is asked for this duration makes no step [s]


@njit(cache=True)
def time_to_stop(angle, rate, acceleration, limit):  # pragma: no cover
    """Least s > 0 with angle + rate s + acceleration s^2 / 2 = +-limit, moving outwards; inf if never."""
    best = np.inf
    for sign in (1.0, -1.0):
        left, speed, push = limit - sign * angle, sign * rate, sign * acceleration
        if left <= 0.0 and (speed > 0.0 or (speed == 0.0 and push > 0.0)):
            return 0.0
        square = speed * speed + 2.0 * push * left
        if square < 0.0 or left < 0.0:
            continue
        root = speed + math.sqrt(square)
        if root > 0.0 and left > 0.0:
            best = min(best, 2.0 * left / root)
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
def lift_off(s, k):  # pragma: no cover
    """Let a standing robot's step begin, on the foot nearer to the CoP asked for (`stays_on_other_foot`)."""
    other_x = s.lift[k, 0] - s.stance[k, 0]
    other_y = side_sign(s.side[k]) * (s.lift[k, 1] - s.stance[k, 1])
    if stays_on_other_foot(s.plan[k], other_x, other_y):
        for axis in range(2):
            s.stance[k, axis], s.lift[k, axis] = s.lift[k, axis], s.stance[k, axis]
        s.side[k] = 1 - s.side[k]
    s.standing[k] = 0
    s.step_start[k] = s.time[k]


@njit(cache=True)
def settle(s, k, stand, p):  # pragma: no cover
    """Let a robot that has touched down stand, where it is told to and can (`may_settle`)."""
    debt_x = stopping_debt(s.rate[k, 0], p.gain, p.acceleration_max, p.omega)
    debt_y = stopping_debt(s.rate[k, 1], p.gain, p.acceleration_max, p.omega)
    x = s.com[k, 0] + s.velocity[k, 0] / p.omega + debt_x - s.stance[k, 0]
    y = s.com[k, 1] + s.velocity[k, 1] / p.omega + debt_y - s.stance[k, 1]
    other_x, other_y = s.lift[k, 0] - s.stance[k, 0], s.lift[k, 1] - s.stance[k, 1]
    if stand != 0.0 and may_settle(other_x, other_y, x, y, p.half_length, p.half_width, p.pelvis_width):
        s.standing[k] = 1


@njit(cache=True)
def _next_event(s, q, k, end, landed, double_support):  # pragma: no cover
    """Time of the next event after now, at most `end`; starts of pushes that wait for it are resolved [s]."""
    now = s.time[k]
    until = end
    if not landed and s.standing[k] == 0:
        until = min(until, s.step_start[k] + s.plan[k, DURATION])
    if s.standing[k] == 0 and both_stand(now - s.step_start[k], double_support):
        until = min(until, s.step_start[k] + double_support)
    begun = s.step_start[k] if s.standing[k] == 0 else now  # no step has begun
    resolve_starts(q.start[k], q.step[k], q.fraction[k], s.steps[k], begun, s.plan[k, DURATION], now, until)
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
def advance(s, q, e, command, dt, p):  # pragma: no cover
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
        stays = may_stay(command[k]) and s.plan[k, DURATION] >= p.duration_max - INSTANT
        if s.standing[k] != 0 and not stays:
            x, y = s.stance[k, 0], s.stance[k, 1]
            lift_off(s, k)
            for i in range(e.asked.shape[1]):  # what was asked for, from the sole that stands now
                e.asked[k, i, ASKED_COP] += x - s.stance[k, 0]
                e.asked[k, i, ASKED_COP + 1] += y - s.stance[k, 1]
        cop_x, cop_y, pitch, roll, change = begin_cycle(s, e, k, dt, p)
        landed = False
        s.push[k, 0] = s.push[k, 1] = 0.0
        while s.time[k] < end:
            if s.time[k] >= change:
                cop_x, cop_y, pitch, roll = acting(s, e, k, e.lag[k], end - s.time[k], p)
                change = np.inf
            if s.standing[k] == 0 and not landed and s.time[k] >= s.step_start[k] + s.plan[k, DURATION]:
                touch_down(s, k)
                settle(s, k, command[k, STAND], p)
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
        ends = s.step_start[k] + s.plan[k, DURATION] - LANDED
        if s.standing[k] == 0 and not landed and s.time[k] >= ends:
            touch_down(s, k)
            settle(s, k, command[k, STAND], p)
