"""Sensors of n robots, and the state that control acts on: the true one or the estimated one.

The sensors are gyro, accelerometer, joint encoders and force sensors in the feet; docs/hardware.md says where
their figures come from. Every reading is made of the true state of this moment and of numbers that count the
physics steps (`scenario.noise`), so it depends on no other robot and on no order. What is noise of the left
side, or about an axis that a mirror turns round, is mirrored with the stance side of step 0.

Where a robot acts on its own sensors, the physics writes into arrays of its own, those that episodes are
judged by. Sensors read them once in a physics step; gait machine, whole-body control, observation and
policies see the arrays that the estimate is written into, and nothing else. Which estimate that is, the
scenario says: `scenario.SENSING` names every `Estimator`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from importlib import import_module
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ..controllers import math3
from ..controllers.array_table import COMMON, Floats1, Floats2, Ints1
from ..controllers.estimation.base_estimate import TILT_AT_FIRST, VELOCITY_AT_FIRST, Estimator, Inertial
from ..controllers.estimation.observe import Contacts
from ..controllers.jit import njit
from ..controllers.joint_control import JOINT, own_joint
from ..controllers.math3 import Quaternion, Vector, add, subtract, vector_in, vector_of
from ..controllers.model.observation import OBSERVATION_SIZE, WORLD_SIZE
from ..controllers.model.robot import GRAVITY
from ..controllers.validation import require_choice
from ..controllers.whole_body.kinematics import NU, Array, Physics
from .scenario.noise import normal_pair
from .scenario.scenario import EXACT_SENSING, SENSING
from .simulation import Handles, Simulations

_DEGREE = math.pi / 180.0
BANDWIDTH = 250.0  # of white noise in samples 2 ms apart [Hz]


class SensorSettings(NamedTuple):
    """Standard deviations unless said otherwise; noise is white, of one sample every 2 ms."""

    rate_noise: float = 0.007 * _DEGREE * math.sqrt(BANDWIDTH)  # of the gyro [rad/s]
    rate_bias: float = 0.05 * _DEGREE  # left after calibration at rest [rad/s]
    rate_walk: float = 2e-5  # of that bias [rad/s / sqrt(s)]
    rate_scale: float = 0.001  # error over the rate
    rate_range: float = 2000.0 * _DEGREE  # largest rate measured [rad/s]
    force_noise: float = 120e-6 * GRAVITY * math.sqrt(BANDWIDTH)  # of the accelerometer [m/s^2]
    force_bias: float = 3e-3 * GRAVITY  # left after calibration [m/s^2]
    force_walk: float = 1e-4  # of that bias [m/s^2 / sqrt(s)]
    force_scale: float = 0.005  # error over the specific force
    force_range: float = 16.0 * GRAVITY  # largest specific force measured [m/s^2]
    angle_resolution: float = 2.0 * math.pi / 2**17  # step of an encoder at the joint [rad]
    angle_noise: float = 2e-5  # [rad]
    angle_offset: float = 5e-4  # of its zero [rad]
    load_noise: float = 2.0  # of a force sensor in a foot, each axis [N]
    load_lag: float = 0.001  # time constant of its filter [s]
    load_least: float = 8.0  # a smaller load is reported as none [N]


SETTINGS = len(SensorSettings._fields)


# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


# Channels of noise; those below belong to the model errors
GUESS_CHANNEL, BIAS_CHANNEL, SCALE_CHANNEL, OFFSET_CHANNEL = 100, 104, 108, 111  # once, at the reset
GYRO_CHANNEL, FORCE_CHANNEL, WALK_CHANNEL, LOAD_CHANNEL, ENCODER_CHANNEL = 120, 122, 124, 128, 131
AT_BEGIN = -1  # step of what is drawn once, at the reset
WALK_EVERY = 50  # physics steps in which a bias stays
BASE = 6  # degrees of freedom of the base


class Sensors(NamedTuple):
    """Settings and state of the sensors of n robots."""

    settings: Annotated[Floats1, COMMON]  # (SETTINGS,) a `SensorSettings`
    present: Annotated[Floats1, COMMON]  # (14,) 1 for a joint that the robot has, otherwise 0
    seed: Ints1  # (n,)
    side: Ints1  # (n,) stance side of step 0
    gravity: Floats2  # (n, 3) in the world's axes, tilted on a slope [m/s^2]
    turn: Floats2  # (n, 3) rate of the floor, in whose axes the robot is told [rad/s]
    before: Floats2  # (n, 3) true velocity of the base at the last reading, world axes [m/s]
    faced: Floats2  # (n, 4) true attitude of the base then
    rate_bias: Floats2  # (n, 3) [rad/s]
    rate_scale: Floats2  # (n, 3) reading over rate
    force_bias: Floats2  # (n, 3) [m/s^2]
    force_scale: Floats2  # (n, 3) reading over specific force
    offset: Floats2  # (n, 14) of the encoders' zeros [rad]
    angle: Floats2  # (n, 14) that they reported last [rad]
    load: Floats2  # (n, 2) filtered normal force under each sole [N]
    floor: Floats2  # (n, 3) filtered sum of the floor's forces, in the axes of the base [N]


def sensors_of(n: int, settings: SensorSettings, present: Array) -> Sensors:
    """Arrays of n robots; `present` (14,) is 1 for the joints that they have."""
    sizes = {
        "gravity": 3, "turn": 3, "before": 3, "faced": 4, "rate_bias": 3, "rate_scale": 3, "force_bias": 3,
        "force_scale": 3, "offset": NU, "angle": NU, "load": 2, "floor": 3,
    }  # fmt: skip
    numbers = {name: np.zeros((n, size)) for name, size in sizes.items()}
    return Sensors(np.array(settings), present, np.zeros(n, np.int64), np.zeros(n, np.int64), **numbers)


@njit(cache=True)
def settings_of(sensors: Sensors) -> SensorSettings:
    """The settings."""
    return SensorSettings(*to_fixed_tuple(sensors.settings, SETTINGS))


@njit(cache=True)
def axial_noise(seed: int, step: int, channel: int, side: int) -> Vector:
    """Three normal numbers about the axes; a mirror turns x and z round. Takes two channels."""
    (x, y), (z, _) = normal_pair(seed, step, channel), normal_pair(seed, step, channel + 1)
    sign = 1.0 - 2.0 * side
    return sign * x, y, sign * z


@njit(cache=True)
def polar_noise(seed: int, step: int, channel: int, side: int) -> Vector:
    """Three normal numbers along the axes; a mirror turns y round. Takes two channels."""
    (x, y), (z, _) = normal_pair(seed, step, channel), normal_pair(seed, step, channel + 1)
    return x, (1.0 - 2.0 * side) * y, z


@njit(cache=True)
def joint_noise(sensors: Sensors, phys: Physics, k: int, step: int, first: int, out: Array) -> None:
    """Write normal numbers of the 14 joints, (14,): waist, stance leg of step 0, the other leg."""
    seed, side = sensors.seed[k], sensors.side[k]
    for pair in range(NU // 2):
        a, b = normal_pair(seed, step, first + pair)
        for i in range(2):
            own = own_joint(2 * pair + i, side)
            sign = phys.mirror[own] if side == 1 else 1.0
            out[own] = sensors.present[own] * sign * (a if i == 0 else b)


@njit(cache=True)
def begin_sensing(sensors: Sensors, k: int, true: Physics, contacts: Contacts) -> None:
    """Draw the lasting errors of the sensors of robot k, whose true state is given, and read them once."""
    s, seed, side = settings_of(sensors), sensors.seed[k], sensors.side[k]
    rate = axial_noise(seed, AT_BEGIN, BIAS_CHANNEL, side)
    force = polar_noise(seed, AT_BEGIN, BIAS_CHANNEL + 2, side)
    (a, b), (c, d) = (
        normal_pair(seed, AT_BEGIN, SCALE_CHANNEL),
        normal_pair(seed, AT_BEGIN, SCALE_CHANNEL + 1),
    )
    e, f = normal_pair(seed, AT_BEGIN, SCALE_CHANNEL + 2)
    rate_scale, force_scale = (a, b, c), (d, e, f)
    for i in range(3):
        sensors.rate_bias[k, i], sensors.force_bias[k, i] = s.rate_bias * rate[i], s.force_bias * force[i]
        sensors.rate_scale[k, i] = 1.0 + s.rate_scale * rate_scale[i]
        sensors.force_scale[k, i] = 1.0 + s.force_scale * force_scale[i]
        sensors.before[k, i] = true.qvel[k, i]
    joint_noise(sensors, true, k, AT_BEGIN, OFFSET_CHANNEL, sensors.offset[k])
    for i in range(NU):
        sensors.offset[k, i] *= s.angle_offset
        sensors.angle[k, i] = round_to(true.qpos[k, JOINT + i] + sensors.offset[k, i], s.angle_resolution)
    keep_attitude(sensors, k, attitude(true, k))
    down = math3.rotated(math3.conjugate(attitude(true, k)), vector_in(contacts.force, k, 0))
    for i in range(3):
        sensors.floor[k, i] = down[i]
    for leg in range(2):
        sensors.load[k, leg] = true.load[k, leg]


@njit(cache=True, forceinline=True)
def attitude(phys: Physics, k: int) -> Quaternion:
    """Quaternion of a base."""
    return phys.qpos[k, 3], phys.qpos[k, 4], phys.qpos[k, 5], phys.qpos[k, 6]


@njit(cache=True, forceinline=True)
def keep_attitude(sensors: Sensors, k: int, q: Quaternion) -> None:
    """Remember the attitude that the gyro counts from."""
    for i in range(4):
        sensors.faced[k, i] = q[i]


@njit(cache=True, forceinline=True)
def round_to(value: float, resolution: float) -> float:
    """The nearest whole number of steps."""
    return resolution * math.floor(value / resolution + 0.5)


@njit(cache=True)
def read_inertial(sensors: Sensors, k: int, step: int, true: Physics, dt: float) -> Inertial:
    """Gyro and accelerometer at the base's origin over the physics step that robot k has just made."""
    s, seed, side = settings_of(sensors), sensors.seed[k], sensors.side[k]
    rate_noise = axial_noise(seed, step, GYRO_CHANNEL, side)
    force_noise = polar_noise(seed, step, FORCE_CHANNEL, side)
    if step % WALK_EVERY == 0:
        walk = math.sqrt(WALK_EVERY * dt)
        rate_walk = axial_noise(seed, step, WALK_CHANNEL, side)
        force_walk = polar_noise(seed, step, WALK_CHANNEL + 2, side)
        for i in range(3):
            sensors.rate_bias[k, i] += s.rate_walk * walk * rate_walk[i]
            sensors.force_bias[k, i] += s.force_walk * walk * force_walk[i]
    velocity, before = vector_in(true.qvel, k, 0), vector_in(sensors.before, k, 0)
    felt = subtract(math3.scaled(subtract(velocity, before), 1.0 / dt), vector_in(sensors.gravity, k, 0))
    now, faced = attitude(true, k), sensors.faced[k]
    turned = math3.product(math3.conjugate((faced[0], faced[1], faced[2], faced[3])), now)
    force, rate = math3.rotated(math3.conjugate(now), felt), math3.scaled(math3.rotation_of(turned), 1.0 / dt)
    floor = vector_in(sensors.turn, k, 0)
    if floor != math3.ZERO:
        rate = add(rate, math3.rotated(math3.conjugate(now), floor))
    keep_attitude(sensors, k, now)
    reading = np.empty(6)
    for i in range(3):
        sensors.before[k, i] = velocity[i]
        value = sensors.rate_scale[k, i] * rate[i] + sensors.rate_bias[k, i] + s.rate_noise * rate_noise[i]
        reading[i] = min(max(value, -s.rate_range), s.rate_range)
        value = sensors.force_scale[k, i] * force[i] + sensors.force_bias[k, i]
        value += s.force_noise * force_noise[i]
        reading[3 + i] = dt * min(max(value, -s.force_range), s.force_range)
    return Inertial(vector_of(reading, 0), vector_of(reading, 3))


@njit(cache=True)
def read_joints(sensors: Sensors, k: int, step: int, true: Physics, out: Physics, dt: float) -> None:
    """Write the encoders' angles of the joints, and their difference quotient, into another state."""
    s, noise = settings_of(sensors), np.empty(NU)
    joint_noise(sensors, true, k, step, ENCODER_CHANNEL, noise)
    for i in range(NU):
        value = true.qpos[k, JOINT + i] + sensors.offset[k, i] + s.angle_noise * noise[i]
        value = round_to(value, s.angle_resolution)
        out.qpos[k, JOINT + i], out.qvel[k, BASE + i] = value, (value - sensors.angle[k, i]) / dt
        sensors.angle[k, i] = value
    for i in range(JOINT + NU, true.qpos.shape[1]):  # joints that are held
        out.qpos[k, i], out.qvel[k, i - 1] = true.qpos[k, i], true.qvel[k, i - 1]


@njit(cache=True)
def read_feet(
    sensors: Sensors, k: int, step: int, true: Physics, contacts: Contacts, out: Physics, dt: float
) -> Vector:
    """Write the loads of the soles into another state; returns the floor's force in the base's axes [N].

    Filtered by load_lag y' = x - y, with the force of the whole step.
    """
    s, seed, side = settings_of(sensors), sensors.seed[k], sensors.side[k]
    share = 1.0 - math.exp(-dt / s.load_lag)
    first, second = normal_pair(seed, step, LOAD_CHANNEL)
    for leg in range(2):
        sensors.load[k, leg] += share * (true.load[k, leg] - sensors.load[k, leg])
        value = sensors.load[k, leg] + s.load_noise * (first if leg == side else second)
        out.load[k, leg] = value if value >= s.load_least else 0.0
    noise = polar_noise(seed, step, LOAD_CHANNEL + 1, side)
    force = math3.rotated(math3.conjugate(attitude(true, k)), vector_in(contacts.force, k, 0))
    for i in range(3):
        sensors.floor[k, i] += share * (force[i] - sensors.floor[k, i])
    return (
        sensors.floor[k, 0] + s.load_noise * noise[0],
        sensors.floor[k, 1] + s.load_noise * noise[1],
        sensors.floor[k, 2] + s.load_noise * noise[2],
    )


class SensedObservation(NamedTuple):
    """Observation of robots that act on their own sensors, by their estimate."""

    observation: Floats2  # (n, 36) before the noise of model errors
    world: Floats2  # (n, 6) DCM, CoP and CMP [m]


class Sensing(NamedTuple):
    """The arrays of n robots' sensing; with exact sensing the judged ones are those of control."""

    sensed: SensedObservation
    sensors: Sensors
    judged: Physics  # true state
    judged_contacts: Contacts
    judged_handles: Handles  # that write it


class Sense(NamedTuple):
    """One of the ways in which robots of a core know their state: arrays, estimator and its estimate."""

    sensing: Sensing
    estimator: Estimator | None  # None: they act on the true state
    estimate: Any  # of `estimator`


class Senses:
    """The sensing of n robots, each its own: `kinds` holds exact sensing, then every estimator in use.

    Robots with sensors share arrays, which are made for the first of them.
    """

    def __init__(self, n: int, exact: Sensing, make_sensing: Callable[[], Sensing], forced: str | None):
        """Let all robots act on the true state, or on what is forced on them.

        Args:
            n: number of robots.
            exact: arrays of exact sensing.
            make_sensing: makes those of robots with sensors.
            forced: sensing of every robot, whatever its scenario says; None: what that says.

        Raises:
            UnknownNameError: for another sensing.
        """
        if forced is not None:
            require_choice("sensing", forced, list(SENSING))
        self.forced = forced
        self.kinds = [Sense(exact, None, ())]
        self._n, self._make, self._names = n, make_sensing, [EXACT_SENSING]
        self._kind = np.full(n, self._kind_of(forced or EXACT_SENSING))
        self._runs = [(0, n)]

    def _kind_of(self, name: str) -> int:
        """Index of a sensing in `kinds`; it comes with the first robot that has it."""
        if name not in self._names:
            module, _, attribute = str(SENSING[name]).partition(":")
            estimator: Estimator = getattr(import_module(module), attribute)
            sensing = self._make() if len(self.kinds) == 1 else self.last
            self.kinds.append(Sense(sensing, estimator, estimator.make(self._n)))
            self._names.append(name)
        return self._names.index(name)

    @property
    def last(self) -> Sensing:
        """Arrays of robots with sensors, once there are any; until then the exact ones."""
        return self.kinds[-1].sensing

    @property
    def onboard(self) -> NDArray[np.bool_]:
        """Which robots act on their own sensors, (n,)."""
        return self._kind > 0

    def of(self, k: int) -> int:
        """Which of `kinds` robot k has; 0 is the exact one."""
        return int(self._kind[k])

    def assign(self, k: int, sensing: str) -> bool:
        """Give robot k the sensing of a scenario; returns whether a kind has come with it."""
        before = len(self.kinds)
        self._kind[k] = self._kind_of(self.forced or sensing)
        changes = np.flatnonzero(np.diff(self._kind)) + 1
        self._runs = list(pairwise([0, *changes.tolist(), self._n]))
        return len(self.kinds) > before

    def runs(self, first: int, end: int) -> Iterator[tuple[int, int, int]]:
        """(kind, first, end) of neighbours that sense alike, over the robots first..end-1."""
        for start, stop in self._runs:
            if start < end and stop > first:
                yield self.of(start), max(start, first), min(stop, end)


def exact_sensing(physics: Physics, contacts: Contacts, handles: Handles) -> Sensing:
    """Control acts on the true state."""
    sensed = SensedObservation(np.zeros((0, OBSERVATION_SIZE)), np.zeros((0, WORLD_SIZE)))
    return Sensing(sensed, sensors_of(0, SensorSettings(), np.ones(NU)), physics, contacts, handles)


def onboard_sensing(
    simulations: Simulations, physics: Physics, contacts: Contacts, present: Array
) -> Sensing:
    """Control acts on an estimate, in the arrays `physics` and `contacts`."""
    n, (arrays, handles) = len(physics.qpos), simulations.outputs_beside()
    beside = {id(own): arrays[name] for name, own in simulations.arrays.items()}
    judged = Physics._make(beside.get(id(field), field) for field in physics)
    true_contacts = Contacts(beside[id(contacts.force)], np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3)))
    sensed = SensedObservation(np.zeros((n, OBSERVATION_SIZE)), np.zeros((n, WORLD_SIZE)))
    return Sensing(sensed, sensors_of(n, SensorSettings(), present), judged, true_contacts, handles)


def begin_onboard(sense: Sense, k: int, physics: Physics, contacts: Contacts, gravity: Array) -> None:
    """Let robot k, put into a state in the arrays of control, sense from now on.

    Its estimate begins off the true state by a tilt and a velocity drawn with the deviations that it states.
    On a slope it is that of a robot which takes the direction of gravity for the vertical.

    Args:
        sense: with an estimator; the robot's seed and stance side are in its sensors.
        k: the robot.
        physics: arrays of control, with the true state.
        contacts: of control.
        gravity: in the world, (3,) [m/s^2].
    """
    (sensed, sensors, true, true_contacts, _), estimator, estimate = sense
    for seen, own in zip(physics, true, strict=True):
        if seen is not own:
            own[k] = seen[k]
    true_contacts.force[k] = contacts.force[k]
    true_contacts.time[k] = true_contacts.impulse[k] = 0.0
    sensed.observation[k] = 0.0  # a period of no length keeps the push estimate that it finds
    seed, side = sensors.seed.item(k), sensors.side.item(k)
    sensors.gravity[k], sensors.turn[k] = gravity, 0.0
    begin_sensing(sensors, k, true, true_contacts)
    x, y, _ = axial_noise(seed, AT_BEGIN, GUESS_CHANNEL, side)
    level = math3.of_rotation(math3.cross(tuple(gravity / GRAVITY), (0.0, 0.0, -1.0)))
    tilt = math3.product(math3.of_rotation((TILT_AT_FIRST * x, TILT_AT_FIRST * y, 0.0)), level)
    off = math3.scaled(polar_noise(seed, AT_BEGIN, GUESS_CHANNEL + 2, side), VELOCITY_AT_FIRST)
    velocity = np.array(math3.add(math3.rotated(level, vector_in(true.qvel, k, 0)), off))
    turned = np.array(math3.product(tilt, attitude(true, k)))
    if estimator is not None:
        estimator.begin(estimate, k, true.qpos[k, :3], turned, velocity)
    physics.qpos[k, 3:7], physics.qvel[k, :3] = turned, velocity


@njit(cache=True)
def read_joints_and_feet(
    phys: Physics, contacts: Contacts, sensors: Sensors, judged: Physics, judged_contacts: Contacts,
    k: int, step: int, dt: float,
) -> None:  # fmt: skip
    """Read encoders and force sensors of robot k into what control knows of it, its base in `phys` already.

    What else control reads has to be computed next: kinematics, M and bias of that state.
    """
    read_joints(sensors, k, step, judged, phys, dt)
    force = math3.rotated(attitude(phys, k), read_feet(sensors, k, step, judged, judged_contacts, phys, dt))
    for i in range(3):
        contacts.force[k, i] = force[i]
