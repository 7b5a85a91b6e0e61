"""A planning period of n bipeds in one compiled call: begin, physics steps, finish; one loop for all.

All arrays lie behind address tables (`Tables`). How an action becomes torques is an `Actuation`, where robots
know their state from is an `Estimator`. The loop calls both through their addresses (`calls_of`), so that it
and whole-body control are compiled once, whatever else there is.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Annotated, NamedTuple

import numpy as np
from numba import typeof, types
from numba.np.numpy_support import carray
from numba.np.unsafe.ndarray import to_fixed_tuple

from ...controllers.array_table import (
    COMMON,
    NO_STATE,
    SENSED,
    Floats1,
    Floats2,
    Ints1,
    address_of,
    caller_of,
    first_rows,
    only_part_of,
    part_of,
)
from ...controllers.errors import InvalidValueError
from ...controllers.estimation import self_model
from ...controllers.estimation.base_estimate import Estimator
from ...controllers.estimation.observe import Contacts, count_contacts, observe, tracks_plan
from ...controllers.estimation.self_model import SelfModel
from ...controllers.jit import njit
from ...controllers.math3 import Vector, cross, stack_floats, to_world, vector_at, vector_in, vector_of
from ...controllers.model.gait_box import DURATION
from ...controllers.whole_body import gait_machine
from ...controllers.whole_body.gait_machine import NOT_FINITE, Gait, GaitSettings
from ...controllers.whole_body.inverse_dynamics import Gains
from ...controllers.whole_body.kinematics import BODIES, PUSHED_BODY, Array, Ints, Physics
from ...controllers.whole_body.limits import DCM_TRACKING, Bounds, BoundSettings
from ...controllers.whole_body.swing import STAND, TURN
from ..scenario.arrays import Pushes, Schedule, follow, may_stay, mean_force, resolve_starts, turn_forces
from ..scenario.model_errors import CONTROL_STEP
from ..scenario.push import COUPLED, FLOOR_LAWS, RAMPED
from ..sensing import SensedObservation, Sensors, read_inertial, read_joints_and_feet
from ..simulation import Handles, advance, compute_nominal, show_unmeasured
from . import model_errors
from .actuators import brake_joints
from .floor import Floor, place_tiles
from .laws import couple, mean_of_ramp, move_floor
from .limits_record import LimitsRecord, note_limits, plan_limits_met
from .model_errors import RobotErrors

# Intrinsics such as part_of have the arguments of their signature, less the typing context.
# pyright: reportCallIssue=false

FASTEST = 1e3  # [m/s, rad/s] far beyond any robot, and slow enough for MuJoCo to compute without a warning
SETTINGS, GAINS, BOUND_SETTINGS = len(GaitSettings._fields), len(Gains._fields), len(BoundSettings._fields)


class Exchange(NamedTuple):
    """Inputs and outputs of the loop besides the state of the robots."""

    command: Floats2  # (n, 4) in force [m/s], [m/s], [rad/s], 1: stand
    previous_action: Floats2  # (n, 7)
    capture: Annotated[Floats1, COMMON]  # `CaptureConstants`
    observation: Floats2  # (n, 36), written
    margin: Floats1  # (n,) capture margin [m], written
    world: Floats2  # (n, 6) DCM, CoP and CMP in the world [m], written
    truth: Floats2  # (n, 36) observation without its noise, written
    com: Floats2  # (n, 2) true CoM in the world [m], written


class Calls(NamedTuple):
    """Addresses of what the loop calls for one robot, see `calls_of`."""

    at: Ints1  # (5,)


BEGIN, TORQUES, FINISH, CONTROL, SENSE = range(5)


class Arena(NamedTuple):
    """Everything that the loop of any biped reads and writes."""

    physics: Physics
    gait: Gait
    pushes: Pushes
    bounds: Annotated[Bounds, NO_STATE]
    both: Annotated[Bounds, NO_STATE]  # of two feet
    exchange: Exchange
    contacts: Contacts
    handles: Annotated[Handles, NO_STATE]  # of the simulations
    errors: RobotErrors
    met: LimitsRecord
    schedule: Schedule
    known: SelfModel
    floors: Floor
    sensed: Annotated[SensedObservation, SENSED]
    sensors: Annotated[Sensors, SENSED]
    judged: Annotated[Physics, SENSED]  # the true state: `physics` itself, but of robots with sensors
    judged_contacts: Annotated[Contacts, SENSED]
    judged_handles: Annotated[Handles, NO_STATE]
    calls: Annotated[Calls, NO_STATE]


class Tables(NamedTuple):
    """Address tables of all that robots have which sense alike."""

    arena: Ints  # of an `Arena`
    own: Ints  # of what the actuation has beside it
    estimate: Ints  # of what the estimator has; empty with exact sensing


class Controller(NamedTuple):
    """Constants and workspace of gait machine and whole-body control."""

    settings: GaitSettings
    gains: Gains
    bounds: Bounds
    both: Bounds  # of two feet


def arena_constants(
    settings: GaitSettings, gains: Gains, bounds: BoundSettings, both: BoundSettings
) -> Array:
    """All scalar constants in one array."""
    return np.array([*settings, *gains, *bounds, *both])


@njit(cache=True)
def settings_of(c: Array) -> GaitSettings:
    """Read the constants of the gait machine."""
    return GaitSettings(*to_fixed_tuple(c[:SETTINGS], SETTINGS))


@njit(cache=True)
def controller_of(t: Tables, c: Array) -> Controller:
    """Read all constants, and the arrays of the bounds."""
    gains = Gains(*to_fixed_tuple(c[SETTINGS : SETTINGS + GAINS], GAINS))
    first = SETTINGS + GAINS
    bounds = BoundSettings(*to_fixed_tuple(c[first : first + BOUND_SETTINGS], BOUND_SETTINGS))
    both = BoundSettings(*to_fixed_tuple(c[first + BOUND_SETTINGS :], BOUND_SETTINGS))
    return Controller(
        settings_of(c), gains, Bounds(bounds, *part_of(t.arena, Arena, "bounds")),
        Bounds(both, *part_of(t.arena, Arena, "both")),
    )  # fmt: skip


class Plant(NamedTuple):
    """Parts of the arena that a physics step moves, whoever found the torques."""

    physics: Physics
    gait: Gait
    pushes: Pushes
    contacts: Contacts
    handles: Handles
    errors: RobotErrors
    met: LimitsRecord
    known: SelfModel
    floors: Floor
    judged: Physics


@njit(cache=True, inline="always")
def plant_of(t: Tables) -> Plant:
    """Read the parts of the arena that a physics step moves."""
    a = t.arena
    return Plant(
        part_of(a, Arena, "physics"), part_of(a, Arena, "gait"), part_of(a, Arena, "pushes"),
        part_of(a, Arena, "contacts"), part_of(a, Arena, "handles"), part_of(a, Arena, "errors"),
        part_of(a, Arena, "met"), part_of(a, Arena, "known"), part_of(a, Arena, "floors"),
        part_of(a, Arena, "judged"),
    )  # fmt: skip


class Felt(NamedTuple):
    """Contacts of a robot over a period, before its observation clears them; see `Contacts`."""

    impulse: Vector
    time: float
    velocity: Vector


class Actuation(NamedTuple):
    """How an action becomes torques: kernels that the loop calls for one robot.

    They find what they need in `Tables`, of which `own` is the table of a core's `own` parts.
    """

    begin: Callable[..., None]  # (t, c, k, gait (7,), action (7,)): hold what is asked in the period
    torques: Callable[..., int]  # (t, c, k, share, dt): write phys.ctrl; bits of limits met
    finish: Callable[..., None]  # (t, c, k, felt): what else is observed, after the robot's observation
    control: Callable[..., int] | None = None  # `control_robot` where torques call it


TABLES, _FLOATS = typeof(Tables(*[np.empty((0, 7), np.int64)] * 3)), types.float64[::1]
_VECTOR, _ROBOT, _NUMBER = types.UniTuple(types.float64, 3), types.int64, types.float64
_FELT = types.NamedTuple((_VECTOR, _NUMBER, _VECTOR), Felt)
SIGNATURES = (  # of what lies at BEGIN, TORQUES, FINISH, CONTROL and SENSE
    types.void(TABLES, _FLOATS, _ROBOT, _FLOATS, _FLOATS),
    types.int64(TABLES, _FLOATS, _ROBOT, _NUMBER, _NUMBER),
    types.void(TABLES, _FLOATS, _ROBOT, _FELT),
    types.int64(TABLES, _FLOATS, types.int64[:, :], types.int64[:], _ROBOT, _NUMBER),
    types.void(TABLES, _ROBOT, _NUMBER),
)
begin_robot, find_torques, finish_robot, call_control, sense_robot = (caller_of(one) for one in SIGNATURES)


@cache
def calls_of(actuation: Actuation, estimator: Estimator | None) -> Calls:
    """What the loop calls under an actuation, of robots that sense alike; compiled.

    Args:
        actuation: what turns actions into torques.
        estimator: of robots that act on their own sensors; None where all act on the true state.
    """
    sense = sensing_step(estimator) if estimator else None
    kernels = zip((*actuation, sense), SIGNATURES, strict=True)
    return Calls(np.array([address_of(kernel, one) if kernel else 0 for kernel, one in kernels]))


@njit(cache=True, nogil=True)
def begin_period(t: Tables, c: Array, gaits: Array, actions: Array, first: int, end: int) -> None:
    """Hold gaits (n, 7) and actions (n, 7) of robots first..end-1 for a planning period."""
    failure, period = part_of(t.arena, Arena, "gait").failure, part_of(t.arena, Arena, "errors").period
    calls = part_of(t.arena, Arena, "calls").at
    for k in range(first, end):
        if failure[k] == 0:
            period[k] += 1
        begin_robot(calls[BEGIN], t, c, k, gaits[k], actions[k])


@njit(cache=True, nogil=True)
def make_steps(t: Tables, c: Array, count: int, share: float, dt: float, first: int, end: int) -> None:
    """Let robots first..end-1 make steps, each of which is `share` of a period and takes `dt` [s].

    One robot makes all its steps before the next begins, with its data still in the processor's cache. A
    robot that has fallen rests. One whose state overflows falls at once, before control divides by it, and
    keeps the observation that it had.
    """
    plant, controller, sensing = plant_of(t), controller_of(t, c), acts_on_sensors(t)
    gait, errors, calls = plant.gait, plant.errors, part_of(t.arena, Arena, "calls").at
    for k in range(first, end):
        if gait.failure[k] != 0:
            continue
        controller.bounds.grip[0] = controller.both.grip[0] = plant.known.grip[k]
        for _ in range(count):
            met = find_torques(calls[TORQUES], t, c, k, share, dt)
            load_plant(plant, k, met, dt)
            if errors.physical[k] == 0:
                brake_joints(plant.physics, k, errors.motors, dt)
                advance(plant.handles, k)
            elif sensing:
                sense_robot(calls[SENSE], t, k, dt)
            else:
                first_side = (gait.stance[k] + gait.steps[k]) % 2
                force = plant.contacts.force[k]
                model_errors.advance_with_errors(
                    plant.physics, errors, k, first_side, plant.handles, force, dt
                )
            if escaped(plant.judged.qvel, k):
                gait.failure[k] = NOT_FINITE
                break
            learn_from_step(plant, k, dt)


@njit(cache=True, nogil=True)
def finish_period(t: Tables, c: Array, first: int, end: int) -> None:
    """Judge and observe robots first..end-1."""
    judged, gait = part_of(t.arena, Arena, "judged"), part_of(t.arena, Arena, "gait")
    contacts, settings = part_of(t.arena, Arena, "judged_contacts"), settings_of(c)
    calls = part_of(t.arena, Arena, "calls").at
    for k in range(first, end):
        gait_machine.check_failure(judged, gait, k, settings)
        if gait.failure[k] != NOT_FINITE:
            impulse, velocity = vector_in(contacts.impulse, k, 0), vector_in(contacts.velocity, k, 0)
            felt = Felt(impulse, contacts.time[k], velocity)
            observe_robot(t, k, settings)
            finish_robot(calls[FINISH], t, c, k, felt)


@njit(cache=True, nogil=True)
def whole_period(
    t: Tables,
    c: Array,
    gaits: Array,
    actions: Array,
    count: int,
    share: float,
    dt: float,
    first: int,
    end: int,
) -> None:
    """A planning period of robots first..end-1."""
    begin_period(t, c, gaits, actions, first, end)
    make_steps(t, c, count, share, dt, first, end)
    finish_period(t, c, first, end)


@cache
def sensing_step(estimator: Estimator) -> Callable[..., None]:
    """The physics step of a robot that knows of itself what its own sensors and an estimator say; compiled.

    Each of the two has its turn: the inertial unit and `predict`, then joints, soles and `correct`.
    """
    predict, correct = estimator.predict, estimator.correct
    Estimate = type(estimator.make(0))

    @njit(cache=True)
    def advance_sensing(t, k, dt):
        phys, errors = part_of(t.arena, Arena, "physics"), part_of(t.arena, Arena, "errors")
        handles = part_of(t.arena, Arena, "handles")
        estimate, sensors = only_part_of(t.estimate, Estimate), part_of(t.arena, Arena, "sensors")
        true, true_contacts = part_of(t.arena, Arena, "judged"), part_of(t.arena, Arena, "judged_contacts")
        true_handles, contacts = (
            part_of(t.arena, Arena, "judged_handles"),
            part_of(t.arena, Arena, "contacts"),
        )
        model_errors.move(true, errors, k, true_handles, true_contacts.force[k], dt)
        show_unmeasured(true_handles, k)
        count_contacts(true_contacts, k, dt)
        step = errors.step[k]
        predict(estimate, k, read_inertial(sensors, k, step, true, dt), phys, dt)
        read_joints_and_feet(phys, contacts, sensors, true, true_contacts, k, step, dt)
        if errors.noise[k, model_errors.JOINT_NOISE] > 0.0:
            model_errors.measure_joints(phys, errors, k, sensors.side[k])
        compute_nominal(handles, k)
        correct(estimate, k, phys, dt)

    return advance_sensing


@njit(cache=True, forceinline=True)
def acts_on_sensors(t: Tables) -> bool:
    """Whether the robots of these tables act on their own sensors."""
    return part_of(t.arena, Arena, "sensed").observation.shape[0] > 0


@njit(cache=True)
def escaped(qvel: Array, k: int) -> bool:
    """Whether a velocity of robot k, (n, 20), is not finite or beyond FASTEST."""
    fine = True
    for i in range(qvel.shape[1]):
        fine = fine and abs(qvel[k, i]) <= FASTEST
    return not fine


@njit(cache=True, forceinline=True)
def place_of(number: int) -> int:
    """Row of `Physics` that a body has: those of `push.BODIES` their own, a robot's links the last ones."""
    return PUSHED_BODY[number] if number < len(PUSHED_BODY) else BODIES + number - len(PUSHED_BODY)


@njit(cache=True, inline="always")
def apply_pushes(phys: Physics, gait: Gait, k: int, pushes: Pushes, dt: float) -> None:
    """Write the mean push over the coming physics step into the external forces of one robot.

    A push that follows a law has the force of that, or changes the floor under the robot.
    """
    now, mean = gait.time[k], carray(stack_floats(3), (3,))
    resolve_starts(
        pushes.start[k], pushes.step[k], pushes.fraction[k], gait.steps[k], now - max(gait.elapsed[k], 0.0),
        gait.plan[k, DURATION], now, now + dt,
    )  # fmt: skip
    turn_forces(pushes.force[k], pushes.frame[k], pushes.start[k], gait.heading[k], now + dt)
    phys.xfrc[k] = 0.0
    for i in range(pushes.start.shape[1]):
        law = pushes.law[k, i]
        if law in FLOOR_LAWS:
            move_floor(pushes, k, i, now, dt, gait.heading[k], phys)
            continue
        if law == COUPLED:
            acts = couple(pushes, k, i, now, dt, mean)
        elif law == RAMPED:
            acts = mean_of_ramp(pushes, k, i, now, now + dt, mean)
        else:
            acts = mean_force(pushes.force[k], pushes.duration[k], pushes.start[k], i, now, now + dt, mean)
        if acts:
            body, force = place_of(pushes.body[k, i]), vector_of(mean, 0)
            torque = cross(to_world(phys.xmat, k, body, vector_at(pushes.offset, k, i)), force)
            for a in range(3):
                phys.xfrc[k, body, a] += force[a]
                phys.xfrc[k, body, 3 + a] += torque[a]
                pushes.delivered[k, i, a] += force[a] * dt


@njit(cache=True, inline="always")
def load_plant(plant: Plant, k: int, met: int, dt: float) -> None:
    """Let pushes and the floor under robot k act in the coming physics step, whose time passes.

    `met` are the limits that its torques and its plan meet, as bits of `limits_met`.
    """
    gait, pushes = plant.gait, plant.pushes
    apply_pushes(plant.judged, gait, k, pushes, dt)
    note_limits(plant.met, k, met, pushes.start[k], gait.time[k], dt)
    gait_machine.pass_time(gait, k, dt)
    if plant.floors.places[k, 0] != 0:
        place_tiles(plant.floors, k)


@njit(cache=True, inline="always")
def learn_from_step(plant: Plant, k: int, dt: float) -> None:
    """Give robot k the mass matrix and bias that it has learned, and count what its contacts gave."""
    phys, known = plant.physics, plant.known
    self_model.scale_mass(known, k, phys)
    self_model.feel_joints(known.joints, known.before, phys, plant.gait, k, dt)
    self_model.add_losses(known.joints, phys, k)
    count_contacts(plant.contacts, k, dt)
    self_model.count_asked(known, k, plant.gait, dt)


@njit(cache=True)
def observe_robot(t: Tables, k: int, settings: GaitSettings) -> None:
    """Command, observation, margin and self-model of robot k after a period, and whether it kept its plan."""
    a = t.arena
    phys, gait, contacts = (
        part_of(a, Arena, "physics"),
        part_of(a, Arena, "gait"),
        part_of(a, Arena, "contacts"),
    )
    command, previous, capture, out, margin, world, truth, com = part_of(a, Arena, "exchange")
    errors, known = part_of(a, Arena, "errors"), part_of(a, Arena, "known")
    judged, judged_contacts = part_of(a, Arena, "judged"), part_of(a, Arena, "judged_contacts")
    follow(part_of(a, Arena, "schedule"), k, gait.time[k], command[k])
    gait.turn[k], gait.stand[k] = command[k, TURN], command[k, STAND]
    span, before = contacts.time[k], (world[k, 0], world[k, 1])
    com[k, 0], com[k, 1] = judged.com[k, 0, 0], judged.com[k, 0, 1]
    self_model.learn(known, k, phys, gait, contacts, settings)
    mass = settings.mass * known.mass[k]
    margin[k] = observe(
        judged, gait, k, judged_contacts, mass, settings, command[k], previous[k], capture, truth[k], world[k]
    )
    seen = truth[k]
    if acts_on_sensors(t):
        sensed = part_of(a, Arena, "sensed")
        seen = sensed.observation[k]
        observe(
            phys, gait, k, contacts, mass, settings, command[k], previous[k], capture, seen, sensed.world[k]
        )
    model_errors.write_seen(errors, k, gait.steps[k], span, settings.omega, seen, out[k])
    if span > 0.0 or errors.noise[k, model_errors.DCM_NOISE] == 0.0:  # otherwise it is seen as it was
        self_model.show_known(known, k, gait, span, out[k])
    if not tracks_plan(judged, gait, k, span, settings, before, truth[k], world[k]):
        starts = part_of(a, Arena, "pushes").start
        note_limits(part_of(a, Arena, "met"), k, DCM_TRACKING, starts[k], gait.time[k] - span, span)


@njit(cache=True)
def accept_gait(t: Tables, c: Array, k: int, asked: Array, action: Array) -> None:
    """Hold a gait (7,) for robot k; note its action (7,) and the limits that the plan meets."""
    gait, record = part_of(t.arena, Arena, "gait"), part_of(t.arena, Arena, "met")
    exchange = part_of(t.arena, Arena, "exchange")
    stays = may_stay(exchange.command[k]) and action[DURATION] >= 1.0
    gait_machine.accept(gait, k, settings_of(c), asked, action, exchange.previous_action[k])
    record.plan[k] = plan_limits_met(exchange.observation[k], gait.plan[k], record.plan[k], record.edges)
    if gait.elapsed[k] < 0.0 and not stays:
        gait_machine.lift_off(part_of(t.arena, Arena, "physics"), gait, k)


_GAIT = first_rows(Arena)["gait"]


@njit(cache=True)
def control_robot(t: Tables, c: Array, walk: Ints, landing: Ints, k: int, dt: float) -> int:
    """Whole-body control of robot k by a gait machine, rows of a table; see `gait_machine.control`."""
    settings, gains, bounds, both = controller_of(t, c)
    phys, gait = part_of(t.arena, Arena, "physics"), only_part_of(walk, Gait)
    return gait_machine.control(phys, gait, k, settings, gains, bounds, both, landing, dt)


@njit(cache=True)
def gait_torques(t: Tables, c: Array, k: int, share: float, dt: float) -> int:
    """Whole-body control of the gait that robot k holds."""
    record, control = part_of(t.arena, Arena, "met"), part_of(t.arena, Arena, "calls").at[CONTROL]
    return call_control(control, t, c, t.arena[_GAIT:], record.landing, k, dt) | record.plan[k]


@njit(cache=True)
def observe_no_more(t: Tables, c: Array, k: int, felt: Felt) -> None:
    """The observation of the gait is all that is observed."""


GAIT = Actuation(accept_gait, gait_torques, observe_no_more, control_robot)


def substeps(control_hz: float) -> int:
    """Physics steps per planning period; the rate must divide the physics rate."""
    steps = round(1.0 / (control_hz * CONTROL_STEP)) if control_hz > 0 else 0
    if steps < 1 or abs(steps * CONTROL_STEP * control_hz - 1.0) > 1e-9:
        valid = ", ".join(f"{500 / s:g}" for s in (1, 2, 4, 5, 10))
        raise InvalidValueError(
            f"control_hz must divide the physics rate of 500 Hz (such as {valid}), got {control_hz}"
        )
    return steps
