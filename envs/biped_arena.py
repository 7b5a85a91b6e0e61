"""All arrays of n bipeds behind one address table, and the compiled calls of a planning period."""

# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.np.unsafe.ndarray import to_fixed_tuple

from .address_table import address_table, floats_1, floats_2, floats_3, ints_1, ints_2
from .biped_gait import Gait, GaitSettings, accept, check_failures, control
from .biped_kinematics import Array, Ints, Physics
from .biped_observation import Contacts, count_contacts, observe
from .push_batch import Pushes
from .whole_body import Gains
from .wrench_bounds import Bounds, BoundSettings

SETTINGS, GAINS, BOUND_SETTINGS = len(GaitSettings._fields), len(Gains._fields), len(BoundSettings._fields)


class View(NamedTuple):
    """What goes in and out besides the state of the robots."""

    command: Array  # (n, 2) [m/s]
    previous_action: Array  # (n, 7)
    capture: Array  # constants of the capture margin
    observation: Array  # (n, 36), written
    margin: Array  # (n,) capture margin [m], written
    world: Array  # (n, 6) DCM, CoP and CMP in the world [m], written


class Arena(NamedTuple):
    """Everything that the compiled loop reads and writes."""

    physics: Physics
    gait: Gait
    pushes: Pushes
    bounds: Bounds
    mass_entries: Ints  # (nM, 2) rows and columns of the sparse mass matrix
    view: View
    contacts: Contacts


def arena_table(arena: Arena) -> Ints:
    """Address table in the order in which the functions below read it."""
    bounds = arena.bounds
    robots = [*arena.physics, *arena.gait, *arena.pushes]
    return address_table([*robots, *bounds[1:], arena.mass_entries, *arena.view, *arena.contacts])


def arena_constants(settings: GaitSettings, gains: Gains, bounds: BoundSettings) -> Array:
    """All scalar constants in one array."""
    return np.array([*settings, *gains, *bounds])


@njit(cache=True)
def physics_of(t: Ints) -> Physics:
    """Rows 0-11."""
    return Physics(
        floats_2(t[0]), floats_2(t[1]), floats_3(t[2]), floats_3(t[3]), floats_3(t[4]), floats_3(t[5]),
        floats_3(t[6]), floats_2(t[7]), floats_2(t[8]), floats_2(t[9]), floats_2(t[10]), floats_3(t[11]),
    )  # fmt: skip


@njit(cache=True)
def gait_of(t: Ints) -> Gait:
    """Rows 12-21."""
    return Gait(
        ints_1(t[12]), ints_1(t[13]), floats_1(t[14]), floats_1(t[15]), floats_1(t[16]), floats_2(t[17]),
        floats_1(t[18]), floats_2(t[19]), ints_1(t[20]), floats_2(t[21]),
    )  # fmt: skip


@njit(cache=True)
def pushes_of(t: Ints) -> Pushes:
    """Rows 22-29."""
    return Pushes(
        floats_3(t[22]), floats_2(t[23]), floats_2(t[24]), ints_2(t[25]), floats_2(t[26]), ints_2(t[27]),
        floats_3(t[28]), floats_3(t[29]),
    )  # fmt: skip


@njit(cache=True)
def contacts_of(t: Ints) -> Contacts:
    """Rows 44-47."""
    return Contacts(floats_2(t[44]), floats_2(t[45]), floats_1(t[46]), floats_2(t[47]))


@njit(cache=True)
def settings_of(c: Array) -> GaitSettings:
    """The first constants."""
    return GaitSettings(*to_fixed_tuple(c[:SETTINGS], SETTINGS))


@njit(cache=True)
def begin_period(t: Ints, c: Array, gaits: Array, actions: Array) -> None:
    """Take over gaits (n, 7) and actions (n, 7); row 39 is the previous action."""
    gait, settings, previous = gait_of(t), settings_of(c), floats_2(t[39])
    for k in range(gait.time.shape[0]):
        accept(gait, k, settings, gaits[k], actions[k], previous[k])


@njit(cache=True)
def control_step(t: Ints, c: Array, dt: float) -> None:
    """One physics step's torques and pushes of every robot; rows 30-37 are the bounds' and the index."""
    gains = Gains(*to_fixed_tuple(c[SETTINGS : SETTINGS + GAINS], GAINS))
    bound_settings = BoundSettings(*to_fixed_tuple(c[SETTINGS + GAINS :], BOUND_SETTINGS))
    bounds = Bounds(
        bound_settings, floats_1(t[30]), floats_1(t[31]), ints_1(t[32]), floats_2(t[33]), floats_1(t[34]),
        floats_1(t[35]), floats_1(t[36]),
    )  # fmt: skip
    control(physics_of(t), gait_of(t), pushes_of(t), settings_of(c), gains, bounds, ints_2(t[37]), dt)


@njit(cache=True)
def measure_step(t: Ints, dt: float) -> None:
    """What the sensors sum up over the physics step just made, of every robot."""
    count_contacts(contacts_of(t), dt)


@njit(cache=True)
def finish_period(t: Ints, c: Array) -> None:
    """Falls, observations and capture margins of every robot; rows 38-43 are the view's."""
    physics, gait, settings = physics_of(t), gait_of(t), settings_of(c)
    check_failures(physics, gait, settings)
    observe(
        physics, gait, contacts_of(t), settings, ints_2(t[37]), floats_2(t[38]), floats_2(t[39]),
        floats_1(t[40]), floats_2(t[41]), floats_1(t[42]), floats_2(t[43]),
    )  # fmt: skip
