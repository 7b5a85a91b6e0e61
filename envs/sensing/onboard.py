"""Which state control acts on: the true one, or what the robot's own sensors and its estimator tell.

Where it is "onboard" the physics writes into arrays of its own, those that episodes are judged by. Sensors
read them once in a physics step; gait machine, whole-body control, observation and policies see the arrays
that the estimate is written into, and nothing else.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...controllers.compiled.array_table import Floats2, Ints1
from ...controllers.compiled.kernels import njit
from ...controllers.compiled.quaternion import of_rotation, product, rotated
from ...controllers.compiled.vector_3 import add, cross, scaled, vector_in
from ...controllers.estimation.base_estimate import (
    TILT_AT_FIRST,
    VELOCITY_AT_FIRST,
    BaseEstimate,
    begin_estimate,
    empty_base_estimate,
)
from ...controllers.estimation.observe import Contacts, count_contacts
from ...controllers.estimation.strapdown import navigate
from ...controllers.model.observation import OBSERVATION_SIZE, WORLD_SIZE
from ...controllers.model.robot import GRAVITY
from ...controllers.whole_body.kinematics import NU, Array, Physics
from ..physics.stepping import Handles, Simulations
from .data_sheet import SensorSettings
from .sensors import (
    AT_BEGIN,
    GUESS_CHANNEL,
    Sensors,
    attitude,
    axial_noise,
    begin_sensing,
    polar_noise,
    read_feet,
    read_inertial,
    read_joints,
    sensors_of,
)


class Shown(NamedTuple):
    """What control's state looks like, where it is not the true one."""

    onboard: Ints1  # (1,) 1 where robots act on their own sensors
    observation: Floats2  # (n, 36) before the noise of model errors
    world: Floats2  # (n, 6) DCM, CoP and CMP [m]


class OnboardArrays(NamedTuple):
    """The parts of `Sensing`, and control's contacts, as a compiled loop has them."""

    contacts: Contacts
    sensors: Sensors
    estimate: BaseEstimate
    judged: Physics
    judged_contacts: Contacts
    handles: Handles


class Sensing(NamedTuple):
    """The arrays of n robots' sensing; with exact sensing the judged ones are those of control."""

    shown: Shown
    sensors: Sensors
    estimate: BaseEstimate
    judged: Physics  # true state
    judged_contacts: Contacts
    handles: Handles  # that write it


def exact_sensing(physics: Physics, contacts: Contacts, handles: Handles, truth: Array) -> Sensing:
    """Control acts on the true state."""
    none = sensors_of(0, SensorSettings(), np.ones(NU))
    shown = Shown(np.zeros(1, np.int64), truth, np.zeros((0, WORLD_SIZE)))
    return Sensing(shown, none, empty_base_estimate(0), physics, contacts, handles)


def onboard_sensing(
    simulations: Simulations, physics: Physics, contacts: Contacts, present: Array
) -> Sensing:
    """Control acts on what it senses, in the arrays `physics` and `contacts`.

    Args:
        simulations: of the robots.
        physics: arrays of control.
        contacts: of control.
        present: (14,) 1 for a joint that the robot has, otherwise 0.
    """
    n, (arrays, handles) = len(physics.qpos), simulations.outputs_beside()
    beside = {id(own): arrays[name] for name, own in simulations.arrays.items()}
    judged = Physics._make(beside.get(id(field), field) for field in physics)
    true_contacts = Contacts(beside[id(contacts.force)], np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3)))
    shown = Shown(np.ones(1, np.int64), np.zeros((n, OBSERVATION_SIZE)), np.zeros((n, WORLD_SIZE)))
    sensors = sensors_of(n, SensorSettings(), present)
    return Sensing(shown, sensors, empty_base_estimate(n), judged, true_contacts, handles)


def begin_onboard(sensing: Sensing, k: int, physics: Physics, contacts: Contacts, gravity: Array) -> None:
    """Let robot k, put into a state in the arrays of control, sense from now on.

    Its estimate begins off the true state by a tilt and a velocity drawn with the deviations that it states.
    On a slope it is that of a robot which takes the direction of gravity for the vertical.

    Args:
        sensing: of all robots; the robot's seed and stance side are in its sensors.
        k: the robot.
        physics: arrays of control, with the true state.
        contacts: of control.
        gravity: in the world, (3,) [m/s^2].
    """
    for seen, true in zip(physics, sensing.judged, strict=True):
        if seen is not true:
            true[k] = seen[k]
    sensing.judged_contacts.force[k] = contacts.force[k]
    sensing.judged_contacts.time[k] = sensing.judged_contacts.impulse[k] = 0.0
    sensing.shown.observation[k] = 0.0  # a period of no length keeps the push estimate that it finds
    sensors, true = sensing.sensors, sensing.judged
    seed, side = sensors.seed.item(k), sensors.side.item(k)
    sensors.gravity[k] = gravity
    begin_sensing(sensors, k, true, sensing.judged_contacts)
    x, y, _ = axial_noise(seed, AT_BEGIN, GUESS_CHANNEL, side)
    level = of_rotation(cross(tuple(gravity / GRAVITY), (0.0, 0.0, -1.0)))
    tilt = product(of_rotation((TILT_AT_FIRST * x, TILT_AT_FIRST * y, 0.0)), level)
    off = scaled(polar_noise(seed, AT_BEGIN, GUESS_CHANNEL + 2, side), VELOCITY_AT_FIRST)
    velocity = add(rotated(level, vector_in(true.qvel, k, 0)), off)
    begin_estimate(
        sensing.estimate, k, true.qpos[k, :3], np.array(product(tilt, attitude(true, k))), np.array(velocity)
    )
    physics.qpos[k, 3:7], physics.qvel[k, :3] = sensing.estimate.attitude[k], velocity


@njit(cache=True)
def sense(phys: Physics, arrays: OnboardArrays, k: int, step: int, dt: float) -> None:
    """Read the sensors of robot k after a control step, and write where these say that it is.

    What else control reads has to be believed next: kinematics, M and bias of that state.
    """
    contacts, sensors, estimate, judged, judged_contacts, _ = arrays
    count_contacts(judged_contacts, k, dt)
    rate = navigate(estimate, k, read_inertial(sensors, k, step, judged, dt), dt)
    read_joints(sensors, k, step, judged, phys, dt)
    for i in range(3):
        phys.qpos[k, i] = estimate.place[k, i]
        phys.qvel[k, i], phys.qvel[k, 3 + i] = estimate.velocity[k, i], rate[i]
    for i in range(4):
        phys.qpos[k, 3 + i] = estimate.attitude[k, i]
    force, q = read_feet(sensors, k, step, judged, judged_contacts, phys, dt), estimate.attitude[k]
    force = rotated((q[0], q[1], q[2], q[3]), force)
    for i in range(3):
        contacts.force[k, i] = force[i]
