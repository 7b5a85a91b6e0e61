"""Pushes that follow a law, in a physics step: contacts with what meets a body, slippery and moved floors.

A law's numbers and state are columns of `Pushes`. True places come straight from the robot's simulation.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ...controllers.array_table import floats_at, ints_at, tuple_reader
from ...controllers.jit import njit
from ...controllers.math3 import (
    ZERO,
    Vector,
    add,
    cross,
    dot,
    of_rotation,
    rotated,
    scaled,
    subtract,
    vector_in,
    vector_of,
)
from ...controllers.whole_body.kinematics import Array, Ints, Physics
from ..robots.compiled_robot import CompiledRobot
from ..robots.indices import pushed_rows
from ..scenario.arrays import DUE, Pushes
from ..scenario.push import ACCELERATING, AT_TOE, BOUND, COUPLED, GRIPPED, STAYS, TILTED, CouplingTerms
from ..scenario.scenario import Scenario
from ..sensing import Sensors
from ..simulation import ENTRY

# Columns of `Pushes.progress`
PHASE, PLACE, SPEED, DEPTH, DEEPEST = 0, 1, 2, 3, 4  # of a coupling: s, its rate, d, d_max
LINE, ORIGIN, ASIDE, DRIFT, BEFORE = 5, 8, 11, 14, 17  # of it, (3,) each
NOMINAL, LOW = 0, 1  # of a grip: the floor's own friction; 1 while it is lower
VELOCITY, WAY, GRAVITY = 0, 1, 3  # of a floor: its velocity, unit vector (2,), gravity of its own (3,)
AXIS, PIVOT = 6, 9  # of one that tilts, besides: its axis, and the point that it turns about, (3,) each
WAITING, MEETING, OVER = 0.0, 1.0, 2.0  # phases
# Columns of `Pushes.places`
COM, AXES = 0, 1  # of the body
PAIRS, COUNT = 0, 1  # of a sole's contacts with the floor: where the addresses of their frictions are
FIELD, FELT, FRAME = 0, 1, 2  # gravity of the simulation, that of the sensors (0: there are none), a `Frame`


class Frame(NamedTuple):
    """Addresses of what bodies of a robot in a frame that turns feel inertial forces by, and their count."""

    turn: int  # rate of the frame, for the sensors, (3,); 0: there are none
    com: int  # of the robot, (3,)
    place: int  # of MjData: xipos (bodies, 3), ximat (.., 9), cvel (.., 6), xfrc_applied (.., 6)
    axes: int
    twist: int
    force: int
    mass: int  # of MjModel: (bodies,), (bodies, 3)
    inertia: int
    bodies: int  # how many follow: the number of each, and its row in `Physics.xfrc`, -1 where it has none


ROBOT = len(Frame._fields)  # numbers that those of its bodies follow
coupling_terms: Callable[[Array], CouplingTerms] = tuple_reader(CouplingTerms)
frame_terms: Callable[[Ints], Frame] = tuple_reader(Frame)


def own_floor(scenario: Scenario, model: mujoco.MjModel | None, common: mujoco.MjModel) -> Any:
    """A copy of the model for a robot whose floor a law changes; otherwise the model, None the common one."""
    if not any(push.law is not None and push.law.moves_floor for push in scenario.forces):
        return model
    return copy.copy(common if model is None else model)


def assign_laws(
    pushes: Pushes,
    k: int,
    scenario: Scenario,
    robot: CompiledRobot,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    sensors: Sensors | None,
) -> list[Array]:
    """Give robot k what its laws work by: places of bodies, frictions of soles, gravity.

    Args:
        pushes: of all robots; those of the scenario are assigned.
        k: the robot.
        scenario: of the robot.
        robot: its description.
        model: of its simulation, its own where a law changes the floor.
        data: of its simulation.
        sensors: of all robots that sense as it does; None: it knows its true state.

    Returns:
        Arrays that have to live as long as the robot has this scenario.

    """
    kept = []
    for i, push in enumerate(scenario.forces):
        body = robot.indices.pushed[pushes.body[k, i]]
        if pushes.law[k, i] == COUPLED:
            pushes.places[k, i, [COM, AXES]] = data.xipos[body].ctypes.data, data.xmat[body].ctypes.data
            if int(CouplingTerms._make(pushes.terms[k, i]).bits) & AT_TOE:
                leg = robot.indices.feet.index(body)
                toe = robot.soles[leg] + [robot.half_sole[0], 0.0, 0.0]
                pushes.offset[k, i] = push.offset + toe - model.body_ipos[body]
        elif pushes.law[k, i] == GRIPPED:
            pairs = sole_pairs(model, robot.plan.sole_boxes[robot.indices.feet.index(body)])
            kept.append(np.array([model.pair_friction[pair].ctypes.data for pair in pairs], np.int64))
            pushes.places[k, i, [PAIRS, COUNT]] = kept[-1].ctypes.data, len(pairs)
            pushes.progress[k, i, NOMINAL] = model.pair_friction[pairs[0], 0]
        elif pushes.law[k, i] in ACCELERATING:
            felt = 0 if sensors is None else sensors.gravity[k].ctypes.data
            pushes.places[k, i, [FIELD, FELT]] = model.opt.gravity.ctypes.data, felt
            pushes.progress[k, i, GRAVITY:][:3] = model.opt.gravity
            if pushes.law[k, i] == TILTED:
                kept.append(frame_of(k, robot, model, data, sensors))
                pushes.places[k, i, FRAME] = kept[-1].ctypes.data
    return kept


def frame_of(
    k: int, robot: CompiledRobot, model: mujoco.MjModel, data: mujoco.MjData, sensors: Sensors | None
) -> Ints:
    """A `Frame` of robot k, its bodies' numbers and their rows in `Physics.xfrc`, (ROBOT + 2 bodies,)."""
    root = model.body_rootid[robot.indices.pelvis]
    bodies = np.flatnonzero((model.body_rootid == root) & (model.body_mass > 0.0)).tolist()
    row_of = {body: row for row, body in pushed_rows(robot.indices)}
    fields = data.xipos, data.ximat, data.cvel, data.xfrc_applied, model.body_mass, model.body_inertia
    turn = 0 if sensors is None else sensors.turn[k].ctypes.data
    at = [turn, data.subtree_com[root].ctypes.data, *(field.ctypes.data for field in fields), len(bodies)]
    return np.array([*Frame(*at), *bodies, *(row_of.get(body, -1) for body in bodies)], np.int64)


def sole_pairs(model: mujoco.MjModel, sole: str) -> list[int]:
    """Contacts of a sole with the world."""
    geoms, own = np.stack([model.pair_geom1, model.pair_geom2], axis=1), model.geom(sole).id
    others = np.where(geoms[:, 0] == own, geoms[:, 1], geoms[:, 0])
    has = (geoms == own).any(axis=1) & (model.geom_bodyid[others] == 0)
    return np.flatnonzero(has).tolist()


def floor_state(model: mujoco.MjModel) -> Array:
    """Gravity and the frictions of a robot's own model, which laws write, (3 + pairs,)."""
    return np.concatenate([model.opt.gravity, model.pair_friction[:, 0]])


def put_floor_state(model: mujoco.MjModel, state: Array) -> None:
    """Put a `floor_state` back into a model of the robot's own."""
    model.opt.gravity[:] = state[:3]
    model.pair_friction[:, :2] = state[3:, None]


@njit(cache=True)
def ramp_time(t: float, duration: float, rise: float) -> float:
    """Integral up to t of a profile that rises from 0 to 1 and falls again at the end of its time [s]."""
    t = min(max(t, 0.0), duration)
    up, down = min(t, rise), max(t - (duration - rise), 0.0)
    flat = max(min(t, duration - rise) - rise, 0.0)
    return 0.5 * up * up / rise + flat + down - 0.5 * down * down / rise


@njit(cache=True)
def mean_of_ramp(pushes: Pushes, k: int, i: int, t0: float, t1: float, out: Array) -> bool:
    """Write the mean of a ramped force over [t0, t1] into `out` (3,) [N]; True where it is not zero.

    Over any partition of time the sum of mean x (t1 - t0) is F (d - rise), to rounding.
    """
    start, duration, rise = pushes.start[k, i], pushes.duration[k, i], pushes.terms[k, i, 0]
    if t1 <= start or t0 >= start + duration:
        return False
    share = (ramp_time(t1 - start, duration, rise) - ramp_time(t0 - start, duration, rise)) / (t1 - t0)
    for axis in range(3):
        out[axis] = pushes.force[k, i, axis] * share
    return share > 0.0


@njit(cache=True)
def way_speed(t: float, travel: float, fastest: float, acceleration: float) -> float:
    """Speed at t on a way from rest to rest, see `Shift` [m/s]."""
    top = min(fastest, np.sqrt(travel * acceleration))
    if travel == 0.0 or t <= 0.0:
        return 0.0
    end = travel / top + top / acceleration
    return max(min(top, acceleration * t, acceleration * (end - t)), 0.0)


@njit(cache=True)
def way_gone(t: float, travel: float, fastest: float, acceleration: float) -> float:
    """Integral of `way_speed` up to t [m]."""
    top = min(fastest, np.sqrt(travel * acceleration))
    if top == 0.0:
        return 0.0
    return top * ramp_time(t, travel / top + top / acceleration, top / acceleration)


@njit(cache=True)
def point_of(pushes: Pushes, k: int, i: int) -> Vector:
    """The point of attack in the world as it truly is [m]."""
    com, axes = floats_at(pushes.places[k, i, COM], 3), floats_at(pushes.places[k, i, AXES], 9)
    x, y, z = pushes.offset[k, i, 0], pushes.offset[k, i, 1], pushes.offset[k, i, 2]
    return (
        com[0] + axes[0] * x + axes[1] * y + axes[2] * z,
        com[1] + axes[3] * x + axes[4] * y + axes[5] * z,
        com[2] + axes[6] * x + axes[7] * y + axes[8] * z,
    )


@njit(cache=True)
def put_vector(row: Array, first: int, vector: Vector) -> None:
    """Write a vector into three columns of a row."""
    row[first], row[first + 1], row[first + 2] = vector


@njit(cache=True)
def couple(pushes: Pushes, k: int, i: int, now: float, dt: float, out: Array) -> bool:
    """Write the force of a `Coupling` in the coming physics step into `out` (3,) [N]; True where it acts.

    Mass and robot are integrated alike, by the semi-implicit Euler method: the force of the depths at the
    beginning of a step first changes both velocities, and these then both places. So the spring gains no
    energy, but for the edges of a contact: up to (k / m) dt^2 / 4 of it, less than `restitution` takes.
    """
    row, c, start = pushes.progress[k, i], coupling_terms(pushes.terms[k, i]), pushes.start[k, i]
    bits, elapsed = int(c.bits), now - start
    if row[PHASE] == OVER or elapsed < -DUE:
        return False
    if bits & STAYS == 0 and elapsed >= pushes.duration[k, i] - DUE:
        row[PHASE] = OVER
        return False
    point = point_of(pushes, k, i)
    if row[PHASE] == WAITING:
        force = vector_of(pushes.force[k, i], 0)
        row[PHASE], row[PLACE], row[SPEED], row[DEPTH] = MEETING, -c.gap, c.speed, -c.gap
        put_vector(row, LINE, scaled(force, 1.0 / np.sqrt(dot(force, force))))
        put_vector(row, ORIGIN, point)
    line, gone = vector_of(row, LINE), subtract(point, vector_of(row, ORIGIN))
    along = dot(line, gone)
    if c.reach < np.inf:
        left = subtract(scaled(line, c.reach), gone)
        distance = np.sqrt(dot(left, left))
        along, line = c.reach - distance, scaled(left, 1.0 / distance)
    depth, before = row[PLACE] - along, row[DEPTH]
    row[DEPTH] = depth
    load = 0.0
    if depth > 0.0:
        if point[2] > c.height:
            row[PHASE] = OVER
            return False
        row[DEEPEST] = max(row[DEEPEST], depth)
        squared = c.restitution * c.restitution
        load = min(depth, (depth - (1.0 - squared) * row[DEEPEST]) / squared) * c.stiffness
        load = min(max(load + c.damping * (depth - before) / dt, 0.0), c.limit)
    force = scaled(line, load)
    if bits & BOUND:
        force = add(force, hold_aside(row, c, subtract(gone, scaled(line, along)), before, dt))
    if c.inverse_mass > 0.0:
        row[SPEED] += (c.drive - load * c.inverse_mass) * dt
        row[PLACE] += row[SPEED] * dt
    else:
        row[SPEED] = way_speed(elapsed + dt, c.travel, c.fastest, c.acceleration)
        speed = way_speed(elapsed, c.travel, c.fastest, c.acceleration)
        row[PLACE] += 0.5 * (speed + row[SPEED]) * dt
    put_vector(out, 0, force)
    return load > 0.0 or bits & BOUND != 0


@njit(cache=True)
def hold_aside(row: Array, c: CouplingTerms, point: Vector, before: float, dt: float) -> Vector:
    """Force across the line on a body, of a mass that sticks to it while they touch [N].

    Where they begin to touch, the mass moves aside as the body does.

    Args:
        row: state of the coupling.
        c: its numbers.
        point: of attack, less its part along the line, from the line's origin [m].
        before: depth a step ago [m].
        dt: [s].
    """
    rate = scaled(subtract(point, vector_of(row, BEFORE)), 1.0 / dt)
    put_vector(row, BEFORE, point)
    force = ZERO
    if row[DEPTH] > 0.0:
        if before <= 0.0:
            put_vector(row, ASIDE, point)
            put_vector(row, DRIFT, rate)
        lag, slip = subtract(vector_of(row, ASIDE), point), subtract(vector_of(row, DRIFT), rate)
        force = add(scaled(lag, c.stiffness), scaled(slip, c.damping))
    put_vector(row, DRIFT, subtract(vector_of(row, DRIFT), scaled(force, c.inverse_mass * dt)))
    put_vector(row, ASIDE, add(vector_of(row, ASIDE), scaled(vector_of(row, DRIFT), dt)))
    return force


@njit(cache=True)
def slips(pushes: Pushes, k: int, i: int, end: float) -> bool:
    """Whether a sole slips by push i in the physics step that ends then."""
    return -DUE <= end - pushes.start[k, i] < pushes.duration[k, i] - DUE


@njit(cache=True)
def move_floor(pushes: Pushes, k: int, i: int, now: float, dt: float, heading: float, phys: Physics) -> None:
    """Let a law of the floor act from the end of the coming physics step on, forces of a turn in that step.

    Contacts and gravity of a step are those that the one before it has left.
    """
    row, places = pushes.progress[k, i], pushes.places[k, i]
    since = now + dt - pushes.start[k, i]
    if pushes.law[k, i] == GRIPPED:
        friction, low = row[NOMINAL], slips(pushes, k, i, now + dt)
        if low or row[LOW] != 0.0:
            for j in range(pushes.law.shape[1]):  # of several slips of one sole the lowest counts
                same = pushes.law[k, j] == GRIPPED and pushes.body[k, j] == pushes.body[k, i]
                if same and slips(pushes, k, j, now + dt):
                    friction = min(friction, pushes.terms[k, j, 0])
            for address in ints_at(places[PAIRS], places[COUNT]):
                pair = floats_at(address, 2)
                pair[0] = pair[1] = friction
            row[LOW] = 1.0 if low else 0.0
        return
    field = floats_at(places[FIELD], 3)
    if places[FELT] != 0:
        floats_at(places[FELT], 3)[:] = field
    if since < -DUE:
        return
    if pushes.law[k, i] == TILTED:
        if since < pushes.duration[k, i] + 2.0 * dt:  # until all is as it was
            tilt_floor(pushes, k, i, since, dt, heading, phys)
        return
    direction, travel, fastest, acceleration = pushes.terms[k, i, :4]
    if row[WAY] == 0.0 and row[WAY + 1] == 0.0:
        row[WAY], row[WAY + 1] = np.cos(heading + direction), np.sin(heading + direction)
    speed = way_speed(since + dt, travel, fastest, acceleration)
    gain = (speed - row[VELOCITY]) / dt
    row[VELOCITY] = speed
    field[0] = row[GRAVITY] - gain * row[WAY]
    field[1] = row[GRAVITY + 1] - gain * row[WAY + 1]


@njit(cache=True)
def tilt_floor(
    pushes: Pushes, k: int, i: int, since: float, dt: float, heading: float, phys: Physics
) -> None:
    """Turn gravity against a floor that tilts, and add the forces that bodies feel in its axes, `FloorTilt`.

    `since` is how long it has gone on at the end of the coming physics step [s].
    """
    row, places, terms = pushes.progress[k, i], pushes.places[k, i], pushes.terms[k, i]
    frame = frame_terms(ints_at(places[FRAME], ROBOT))
    if row[AXIS] == 0.0 and row[AXIS + 1] == 0.0:
        com, along = floats_at(frame.com, 3), heading + terms[0]
        put_vector(row, AXIS, (-np.sin(along), np.cos(along), 0.0))
        put_vector(row, PIVOT, (com[0], com[1], 0.0))
    axis, pivot = vector_of(row, AXIS), vector_of(row, PIVOT)
    angle, fastest, acceleration, back = terms[1], terms[2], terms[3], terms[4]
    rate = way_speed(since, angle, fastest, acceleration)
    rate -= way_speed(since - back, angle, fastest, acceleration)
    omega, alpha = scaled(axis, 0.5 * (row[VELOCITY] + rate)), scaled(axis, (rate - row[VELOCITY]) / dt)
    row[VELOCITY] = rate
    middle = since + 0.5 * dt  # of the step that has this gravity
    tilted = way_gone(middle, angle, fastest, acceleration)
    tilted -= way_gone(middle - back, angle, fastest, acceleration)
    back_turn = of_rotation(scaled(axis, -tilted))
    put_vector(floats_at(places[FIELD], 3), 0, rotated(back_turn, vector_of(row, GRAVITY)))
    table = ints_at(places[FRAME], ROBOT + 2 * frame.bodies)
    for b in range(frame.bodies):
        body, at = table[ROBOT + b], table[ROBOT + frame.bodies + b]
        force, torque = inertial_load(frame, body, pivot, omega, alpha)
        if at < 0:
            own = floats_at(frame.force + 6 * ENTRY * body, 6)
            put_vector(own, 0, force)
            put_vector(own, 3, torque)
            continue
        for a in range(3):
            phys.xfrc[k, at, a] += force[a]
            phys.xfrc[k, at, 3 + a] += torque[a]
    if frame.turn != 0:
        place, velocity = subtract(vector_in(phys.qpos, k, 0), pivot), vector_in(phys.qvel, k, 0)
        felt = floats_at(places[FELT], 3)
        put_vector(floats_at(frame.turn, 3), 0, omega)
        put_vector(felt, 0, add(vector_of(felt, 0), inertial_field(place, velocity, omega, alpha)))


@njit(cache=True)
def inertial_field(place: Vector, velocity: Vector, omega: Vector, alpha: Vector) -> Vector:
    """Acceleration that a point feels in a frame that turns: Euler's, centrifugal, Coriolis [m/s^2]."""
    half = add(scaled(cross(omega, place), 0.5), velocity)
    return scaled(add(cross(alpha, place), scaled(cross(omega, half), 2.0)), -1.0)


@njit(cache=True)
def inertial_load(
    frame: Frame, body: int, pivot: Vector, omega: Vector, alpha: Vector
) -> tuple[Vector, Vector]:
    """Force at its CoM and torque that a body feels in a frame that turns about a pivot [N], [N m]."""
    place, com = vector_of(floats_at(frame.place + 3 * ENTRY * body, 3), 0), floats_at(frame.com, 3)
    twist = floats_at(frame.twist + 6 * ENTRY * body, 6)  # angular, and linear at the robot's CoM
    spin = vector_of(twist, 0)
    velocity = add(vector_of(twist, 3), cross(spin, subtract(place, vector_of(com, 0))))
    mass = floats_at(frame.mass + ENTRY * body, 1)[0]
    force = scaled(inertial_field(subtract(place, pivot), velocity, omega, alpha), mass)
    axes = floats_at(frame.axes + 9 * ENTRY * body, 9)
    inertia = floats_at(frame.inertia + 3 * ENTRY * body, 3)
    half = 0.5 * (inertia[0] + inertia[1] + inertia[2])
    torque = ZERO
    for j in range(3):  # along the principal axes
        line = axes[j], axes[3 + j], axes[6 + j]
        along = dot(line, omega)
        torque = add(torque, scaled(line, inertia[j] * dot(line, alpha)))
        torque = add(torque, scaled(cross(omega, line), inertia[j] * along))
        torque = add(torque, scaled(cross(line, spin), 2.0 * (half - inertia[j]) * along))
    return force, scaled(torque, -1.0)
