"""A planning period of n bipeds: all arrays behind one address table, and the compiled calls.

Which robots of a core act on the true state and which on their own sensors, and the arrays of both.

All arrays of n bipeds behind one address table, and the compiled calls of a planning period.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from ...controllers.array_table import Floats1, Floats2, part_of
from ...controllers.errors import InvalidValueError
from ...controllers.estimation.base_estimate import BaseEstimate
from ...controllers.estimation.observe import Contacts, count_contacts, observe, tracks_plan
from ...controllers.estimation.self_model import (
    SelfModel,
    add_losses,
    count_asked,
    feel_joints,
    learn,
    scale_mass,
    show_known,
)
from ...controllers.jit import njit
from ...controllers.validation import require_choice
from ...controllers.whole_body.gait_machine import (
    NOT_FINITE,
    Gait,
    GaitSettings,
    accept,
    check_failure,
    control,
    pass_time,
)
from ...controllers.whole_body.inverse_dynamics import Gains
from ...controllers.whole_body.kinematics import Array, Ints, Physics
from ...controllers.whole_body.limits import DCM_TRACKING, Bounds, BoundSettings
from ...controllers.whole_body.swing import TURN
from ..scenario.arrays import Pushes, Schedule, follow
from ..scenario.model_errors import CONTROL_STEP
from ..scenario.scenario import ONBOARD, SENSING
from ..sensing import OnboardArrays, Sensing, Sensors, Shown
from ..simulation import Handles, advance
from .actuators import brake_joints
from .floor import Floor, place_tiles
from .limits_record import BoundsRecord, note_bounds, plan_bounds_met
from .model_errors import DCM_NOISE, RobotErrors, advance_onboard, advance_with_errors, show
from .pushes import apply_pushes


class Senses:
    """The sensing of n robots, each its own; `kinds` holds the arrays of exact sensing, then of onboard.

    The latter are made for the first robot that has sensors.
    """

    def __init__(self, n: int, exact: Sensing, make_onboard: Callable[[], Sensing], forced: str | None):
        """Let all robots act on the true state, or on what is forced on them.

        Args:
            n: number of robots.
            exact: arrays of exact sensing.
            make_onboard: makes those of onboard sensing.
            forced: sensing of every robot, whatever its scenario says; None: what that says.

        Raises:
            UnknownNameError: for another sensing.
        """
        if forced is not None:
            require_choice("sensing", forced, SENSING)
        self.forced = forced
        self.kinds = [exact]
        self.onboard = np.full(n, forced == ONBOARD)
        self._make, self._runs = make_onboard, [(0, n)]
        if forced == ONBOARD:
            self.kinds.append(make_onboard())

    @property
    def last(self) -> Sensing:
        """Of robots that act on their own sensors, once there are any; until then the exact one."""
        return self.kinds[-1]

    def of(self, k: int) -> int:
        """Which of `kinds` robot k has."""
        return int(self.onboard[k])

    def assign(self, k: int, sensing: str) -> bool:
        """Give robot k the sensing of a scenario; returns whether a kind has come with it."""
        self.onboard[k] = (self.forced or sensing) == ONBOARD
        changes = np.flatnonzero(np.diff(self.onboard)) + 1
        self._runs = list(pairwise([0, *changes.tolist(), len(self.onboard)]))
        if comes := self.of(k) == len(self.kinds):
            self.kinds.append(self._make())
        return comes

    def alike(self, first: int, end: int) -> Iterator[tuple[int, int, int]]:
        """(kind, first, end) of neighbours that sense alike, over the robots first..end-1."""
        for start, stop in self._runs:
            if start < end and stop > first:
                yield self.of(start), max(start, first), min(stop, end)


# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


FASTEST = 1e3  # [m/s, rad/s] far beyond any robot, and slow enough for MuJoCo to compute without a warning
SETTINGS, GAINS, BOUND_SETTINGS = len(GaitSettings._fields), len(Gains._fields), len(BoundSettings._fields)


class View(NamedTuple):
    """What goes in and out besides the state of the robots."""

    command: Floats2  # (n, 3) in force [m/s], [m/s], [rad/s]
    previous_action: Floats2  # (n, 7)
    capture: Floats1  # constants of the capture margin
    observation: Floats2  # (n, 36), written
    margin: Floats1  # (n,) capture margin [m], written
    world: Floats2  # (n, 6) DCM, CoP and CMP in the world [m], written
    truth: Floats2  # (n, 36) observation without its noise, written
    com: Floats2  # (n, 2) true CoM in the world [m], written


class Arena(NamedTuple):
    """Everything that the compiled loop reads and writes."""

    physics: Physics
    gait: Gait
    pushes: Pushes
    bounds: Bounds
    exchange: View  # numba keeps the name `view` for itself
    contacts: Contacts
    handles: Handles  # of the simulations
    errors: RobotErrors
    met: BoundsRecord
    schedule: Schedule
    known: SelfModel
    floors: Floor
    shown: Shown
    sensors: Sensors
    estimate: BaseEstimate
    judged: Physics  # the true state: `physics` itself, but with onboard sensing
    judged_contacts: Contacts
    judged_handles: Handles


# What is no state of a robot: a thread's workspace, addresses, and what all robots have in common.
NO_STATE = {"bounds", "handles", "judged_handles", "floors.places"}
COMMON = {
    "physics.soles", "physics.ankle_height", "physics.mirror", "physics.leg_form", "physics.knee_bend",
    "exchange.capture", "met.edges", "floors.half_sole", "shown.onboard", "sensors.settings",
    "sensors.present", "judged.soles", "judged.ankle_height", "judged.mirror", "judged.leg_form",
    "judged.knee_bend",
}  # fmt: skip
SENSED = {"shown", "sensors", "estimate", "judged", "judged_contacts"}  # parts of onboard sensing alone


def arena_constants(settings: GaitSettings, gains: Gains, bounds: BoundSettings) -> Array:
    """All scalar constants in one array."""
    return np.array([*settings, *gains, *bounds])


@njit(cache=True)
def settings_of(c: Array) -> GaitSettings:
    """The first constants."""
    return GaitSettings(*to_fixed_tuple(c[:SETTINGS], SETTINGS))


@njit(cache=True)
def bounds_of(t: Ints, c: Array) -> Bounds:
    """The last constants, and the arrays of the bounds."""
    settings = BoundSettings(*to_fixed_tuple(c[SETTINGS + GAINS :], BOUND_SETTINGS))
    return Bounds(settings, *part_of(t, Arena, "bounds"))


@njit(cache=True, nogil=True)
def begin_period(t: Ints, c: Array, gaits: Array, actions: Array, first: int, end: int) -> None:
    """Take over gaits (n, 7) and actions (n, 7) of robots first..end-1."""
    gait, settings = part_of(t, Arena, "gait"), settings_of(c)
    errors, record = part_of(t, Arena, "errors"), part_of(t, Arena, "met")
    exchange = part_of(t, Arena, "exchange")
    seen, previous = exchange.observation, exchange.previous_action
    for k in range(first, end):
        if gait.failure[k] == 0:
            errors.period[k] += 1
        accept(gait, k, settings, gaits[k], actions[k], previous[k])
        record.plan[k] = plan_bounds_met(seen[k], gait.plan[k], record.plan[k], record.edges)


@njit(cache=True)
def onboard_of(t: Ints) -> OnboardArrays:
    """The parts of onboard sensing."""
    contacts, true_contacts = part_of(t, Arena, "contacts"), part_of(t, Arena, "judged_contacts")
    sensors, estimate = part_of(t, Arena, "sensors"), part_of(t, Arena, "estimate")
    judged, handles = part_of(t, Arena, "judged"), part_of(t, Arena, "judged_handles")
    return OnboardArrays(contacts, sensors, estimate, judged, true_contacts, handles)


@njit(cache=True)
def escaped(qvel: Array, k: int) -> bool:
    """Whether a velocity of robot k, (n, 20), is not finite or beyond FASTEST."""
    fine = True
    for i in range(qvel.shape[1]):
        fine = fine and abs(qvel[k, i]) <= FASTEST
    return not fine


class Plant(NamedTuple):
    """What torques act on: the parts of the arena that a physics step moves, whoever found the torques."""

    physics: Physics
    gait: Gait
    pushes: Pushes
    contacts: Contacts
    handles: Handles
    errors: RobotErrors
    met: BoundsRecord
    known: SelfModel
    floors: Floor
    judged: Physics
    onboard: bool  # whether the robots act on their own sensors


@njit(cache=True, forceinline=True)
def plant_of(t: Ints) -> Plant:
    """The parts of the arena that a physics step moves."""
    return Plant(
        part_of(t, Arena, "physics"), part_of(t, Arena, "gait"), part_of(t, Arena, "pushes"),
        part_of(t, Arena, "contacts"), part_of(t, Arena, "handles"), part_of(t, Arena, "errors"),
        part_of(t, Arena, "met"), part_of(t, Arena, "known"), part_of(t, Arena, "floors"),
        part_of(t, Arena, "judged"), part_of(t, Arena, "shown").onboard[0] != 0,
    )  # fmt: skip


@njit(cache=True, forceinline=True)
def move(plant: Plant, t: Ints, k: int, met: int, dt: float) -> bool:
    """One physics step of robot k under the torques in `ctrl`; False where its state has overflowed.

    `met` are the bounds that these torques and their plan meet, as bits of `bounds_met`.
    """
    phys, gait, pushes, contacts, handles, errors, record, known, floors, judged, onboard = plant
    apply_pushes(judged, gait, k, pushes, dt)
    note_bounds(record, k, met, pushes.start[k], gait.time[k], dt)
    pass_time(gait, k, dt)
    if floors.places[k, 0] != 0:
        place_tiles(floors, k)
    if errors.physical[k] == 0:
        brake_joints(phys, k, errors.motors, dt)
        advance(handles, k)
    elif onboard:
        advance_onboard(phys, errors, k, handles, onboard_of(t), dt)
    else:
        first_side = (gait.stance[k] + gait.steps[k]) % 2
        advance_with_errors(phys, errors, k, first_side, handles, contacts.force[k], dt)
    if escaped(judged.qvel, k):
        gait.failure[k] = NOT_FINITE
        return False
    scale_mass(known, k, phys)
    feel_joints(known.joints, known.before, phys, gait, k, dt)
    add_losses(known.joints, phys, k)
    count_contacts(contacts, k, dt)
    count_asked(known, k, gait, dt)
    return True


@njit(cache=True)
def gains_of(c: Array) -> Gains:
    """The constants in the middle."""
    return Gains(*to_fixed_tuple(c[SETTINGS : SETTINGS + GAINS], GAINS))


@njit(cache=True, nogil=True)
def physics_steps(t: Ints, c: Array, steps: int, dt: float, first: int, end: int) -> None:
    """Control and physics of robots first..end-1.

    One robot makes all its steps before the next begins, with its data still in the processor's cache. A
    robot that has fallen rests. One whose state overflows falls at once, before control divides by it.
    """
    plant, bounds, gains, settings = plant_of(t), bounds_of(t, c), gains_of(c), settings_of(c)
    phys, gait, record = plant.physics, plant.gait, plant.met
    for k in range(first, end):
        if gait.failure[k] != 0:
            continue
        bounds.grip[0] = plant.known.grip[k]
        for _ in range(steps):
            met = control(phys, gait, k, settings, gains, bounds, record.landing, dt) | record.plan[k]
            if not move(plant, t, k, met, dt):
                break


@njit(cache=True, nogil=True)
def finish_period(t: Ints, c: Array, first: int, end: int) -> None:
    """Falls, commands, observations and margins of robots first..end-1.

    One whose state is not finite keeps the observation that it had.
    """
    phys, gait, settings = part_of(t, Arena, "physics"), part_of(t, Arena, "gait"), settings_of(c)
    command, previous, capture, out, margin, world, truth, com = part_of(t, Arena, "exchange")
    contacts, starts = part_of(t, Arena, "contacts"), part_of(t, Arena, "pushes").start
    errors, record = part_of(t, Arena, "errors"), part_of(t, Arena, "met")
    schedule, known = part_of(t, Arena, "schedule"), part_of(t, Arena, "known")
    judged, felt, shown = (
        part_of(t, Arena, "judged"),
        part_of(t, Arena, "judged_contacts"),
        part_of(t, Arena, "shown"),
    )
    for k in range(first, end):
        check_failure(judged, gait, k, settings)
        if gait.failure[k] == NOT_FINITE:
            continue
        follow(schedule, k, gait.time[k], command[k])
        gait.turn[k] = command[k, TURN]
        span, before = contacts.time[k], (world[k, 0], world[k, 1])
        com[k, 0], com[k, 1] = judged.com[k, 0, 0], judged.com[k, 0, 1]
        learn(known, k, phys, gait, contacts, settings)
        mass = settings.mass * known.mass[k]
        margin[k] = observe(
            judged, gait, k, felt, mass, settings, command[k], previous[k], capture, truth[k], world[k]
        )
        seen = shown.observation[k]
        if shown.onboard[0] != 0:
            told = shown.world[k]
            observe(phys, gait, k, contacts, mass, settings, command[k], previous[k], capture, seen, told)
        show(errors, k, gait.steps[k], span, settings.omega, seen, out[k])
        if span > 0.0 or errors.noise[k, DCM_NOISE] == 0.0:  # otherwise it is seen as it was
            show_known(known, k, gait, span, out[k])
        if not tracks_plan(judged, gait, k, span, settings, before, truth[k], world[k]):
            note_bounds(record, k, DCM_TRACKING, starts[k], gait.time[k] - span, span)


@njit(cache=True, nogil=True)
def whole_period(
    t: Ints, c: Array, gaits: Array, actions: Array, steps: int, dt: float, first: int, end: int
) -> None:
    """A planning period of robots first..end-1, from their actions to their observations."""
    begin_period(t, c, gaits, actions, first, end)
    physics_steps(t, c, steps, dt, first, end)
    finish_period(t, c, first, end)


class PeriodCalls(NamedTuple):
    """The compiled calls of a planning period; which ones says who turns an action into torques."""

    whole: Callable[..., None]
    begin: Callable[..., None]
    steps: Callable[..., None]
    finish: Callable[..., None]


GAIT_CALLS = PeriodCalls(whole_period, begin_period, physics_steps, finish_period)


def substeps(control_hz: float) -> int:
    """Physics steps per planning period; the rate must divide the physics rate."""
    steps = round(1.0 / (control_hz * CONTROL_STEP)) if control_hz > 0 else 0
    if steps < 1 or abs(steps * CONTROL_STEP * control_hz - 1.0) > 1e-9:
        valid = ", ".join(f"{500 / s:g}" for s in (1, 2, 4, 5, 10))
        raise InvalidValueError(
            f"control_hz must divide the physics rate of 500 Hz (such as {valid}), got {control_hz}"
        )
    return steps
