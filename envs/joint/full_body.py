"""`PushRecovery/BipedFullBody-v0`: all joints of a robot, arms included, under position targets.

This is the environment that open humanoid policies act in. A servo on every joint turns the target that it
holds into a torque, in every physics step,

    tau = clip(k (q_0 + r a - q) - d qd, -tau_max, tau_max),

with a in [-1, 1] the action, q_0 the posture, r the reach of an action of 1, k stiffness and d damping: those
of whoever acts, as his `Servos` say. The motor's own largest torque, and of legs and waist its speed, bound
it besides. The observation is the robot's state as its sensors give it, in no order of anybody's network.

Such a policy may stand or walk as it likes, so nothing here asks for steps. Pushes come at times: one at a
gait event comes when the nominal gait of the command would be there. A command to stand is one of velocity
zero. Recovered is judged without regard to feet, see `Steadiness`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, ClassVar, NamedTuple

import mujoco
import numpy as np

from ...controllers import joint_control
from ...controllers.array_table import COMMON, Floats1, Floats2, Floats3, part_of
from ...controllers.errors import InvalidValueError, UnknownNameError, is_finite_number
from ...controllers.jit import njit
from ...controllers.joint_control import JOINT, Joints
from ...controllers.math3 import to_body, vector_in
from ...controllers.model.nominal_gait import NominalStart, standing_start
from ...controllers.validation import require_kind, require_number
from ...controllers.whole_body.kinematics import NU, NV, PELVIS, TRUNK, Array, Physics
from ...controllers.whole_body.limits import JOINT_TORQUE, Bounds, write_torque_range
from ...controllers.whole_body.swing import COMMAND_X, COMMAND_Y, TURN
from ..biped.env import BipedConfig, BipedEnv
from ..biped.period import Actuation, Arena, Felt, Tables, controller_of
from ..biped.posture import SUNK, leaning, posture
from ..episode.episodes import Period
from ..episode.recovery import SPEED_TOLERANCE
from ..episode.vector_env import vector_maker
from ..robots.compiled_robot import FREQUENCY, CompiledRobot, moved_inertia
from ..robots.description import RobotDescription, robot_description
from ..robots.indices import MISSING
from ..scenario.push import GaitEvent, Push
from ..scenario.scenario import Scenario
from ..snapshot import Arrays, RobotSnapshot
from .core import JointCore, standing_posture, write_floor_points
from .env import JointEpisodes

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

BASE = NV - NU  # degrees of freedom of the base


@dataclass(frozen=True)
class Servos:
    """Drives of the joints that an action moves; what is not named keeps its angle as a held joint does."""

    joints: tuple[str, ...]  # by the names of the robot's model
    posture: tuple[float, ...]  # q_0 [rad]
    stiffness: tuple[float, ...]  # k [N m/rad]
    damping: tuple[float, ...]  # d [N m s/rad]
    torque: tuple[float, ...] | None = None  # largest [N m]; None: what the motor gives
    reach: float = 1.0  # r of an action of 1 [rad]

    def __post_init__(self) -> None:
        if twice := sorted({name for name in self.joints if self.joints.count(name) > 1}):
            raise InvalidValueError(f"Servos.joints names a joint once, got {', '.join(twice)} twice")
        for name in ("posture", "stiffness", "damping", "torque"):
            values: Sequence[float] | None = getattr(self, name)
            if values is None and name == "torque":
                continue
            least = -np.inf if name == "posture" else 0.0
            if (
                values is None
                or len(values) != len(self.joints)
                or not all(is_finite_number(value) and value >= least for value in values)
            ):
                kind = "finite" if name == "posture" else "finite and >= 0"
                raise InvalidValueError(
                    f"Servos.{name} must be {len(self.joints)} numbers, one for each joint, {kind}, "
                    f"got {values!r:.200}"
                )
        require_number("Servos.reach [rad]", self.reach, 0.0, open_low=True)


class Drives(NamedTuple):
    """Targets of the M joints of n robots, first the 14 of control, then held ones, and their constants."""

    asked: Floats2  # (n, M) action of the period, in [-1, 1]
    target: Floats2  # (n, M) held [rad]
    imposed: Floats2  # (n, M) target that something else than the policy asks for [rad], NaN: nothing does
    observation: Floats2  # (n, size) that policies see
    posture: Annotated[Floats1, COMMON]  # (M,) q_0 [rad]
    stiffness: Annotated[Floats1, COMMON]  # (M,) k [N m/rad]
    damping: Annotated[Floats1, COMMON]  # (M,) d [N m s/rad]
    largest: Annotated[Floats1, COMMON]  # (M,) torque [N m]; 0 where the robot has no joint
    reach: Annotated[Floats1, COMMON]  # (M,) r [rad]; 0 of a joint that keeps its angle


class FullBodyParts(NamedTuple):
    """Parts beside the arena; the first is that of any `JointCore`."""

    joints: Joints
    drives: Drives


@njit(cache=True, forceinline=True)
def own_of(t: Tables) -> FullBodyParts:
    """Read the parts beside the arena."""
    return FullBodyParts(part_of(t.own, FullBodyParts, "joints"), part_of(t.own, FullBodyParts, "drives"))


@njit(cache=True, forceinline=True)
def follow_servos(phys: Physics, k: int, drives: Drives, bounds: Bounds) -> int:
    """Write the torques of all joints of robot k towards their targets; returns the bounds met, as bits.

    Args:
        phys: of all robots; joint coordinates, rates and torques of all M joints lie in a row.
        k: the robot.
        drives: of all robots.
        bounds: of the 14 motors of control, whose speed counts too.
    """
    met = 0
    write_torque_range(phys, k, bounds.motors, bounds.torque_range)
    for i in range(drives.target.shape[1]):
        if drives.largest[i] == 0.0:
            continue
        lack, rate = drives.target[k, i] - phys.qpos[k, JOINT + i], phys.qvel[k, BASE + i]
        torque = drives.stiffness[i] * lack - drives.damping[i] * rate
        low, high = -drives.largest[i], drives.largest[i]
        if i < NU:
            low, high = max(low, bounds.torque_range[0, i]), min(high, bounds.torque_range[1, i])
        if not low < torque < high:
            met = JOINT_TORQUE
        phys.ctrl[k, i] = min(max(torque, low), high)
    return met


@njit(cache=True)
def begin_servos(t: Tables, c: Array, k: int, gait: Array, action: Array) -> None:
    """Hold the targets that are asked of robot k; gait and action are nobody's."""
    joints, drives = own_of(t)
    held = part_of(t.arena, Arena, "gait")
    if held.failure[k] != 0:
        return
    joints.effort[k] = 0.0
    for i in range(drives.target.shape[1]):
        drives.target[k, i] = drives.posture[i] + drives.reach[i] * drives.asked[k, i]
        if not np.isnan(drives.imposed[k, i]):
            drives.target[k, i] = drives.imposed[k, i]
        if i < NU:
            joints.held[k, i] = drives.asked[k, i]
    seen = part_of(t.arena, Arena, "exchange").observation[k]
    joint_control.hold_nominal(held, k, seen, joints.gait)


@njit(cache=True)
def servo_torques(t: Tables, c: Array, k: int, share: float, dt: float) -> int:
    """Servos of all joints of robot k."""
    (joints, drives), phys, controller = own_of(t), part_of(t.arena, Arena, "physics"), controller_of(t, c)
    joint_control.follow_contacts(phys, part_of(t.arena, Arena, "gait"), k, controller.settings, joints)
    met = follow_servos(phys, k, drives, controller.bounds)
    joint_control.count_effort(phys, k, joints, share)
    return met


QUATERNION, RATE, VELOCITY = slice(0, 4), slice(4, 7), slice(7, 10)  # of the observation
COMMAND, ANGLES = slice(10, 13), 13  # and where the joints' angles begin; their rates follow


@njit(cache=True)
def finish_servos(t: Tables, c: Array, k: int, felt: Felt) -> None:
    """Observe robot k, whose heading is where its pelvis faces."""
    phys, gait = part_of(t.arena, Arena, "physics"), part_of(t.arena, Arena, "gait")
    judged, command = part_of(t.arena, Arena, "judged"), part_of(t.arena, Arena, "exchange").command
    gait.heading[k] = np.arctan2(judged.xmat[k, PELVIS, 3], judged.xmat[k, PELVIS, 0])
    force = part_of(t.arena, Arena, "judged_contacts").force[k]
    write_floor_points(judged, gait, k, force, part_of(t.arena, Arena, "exchange").world[k])
    drives = own_of(t).drives
    o, joints = drives.observation[k], drives.target.shape[1]
    velocity = to_body(phys.xmat, k, PELVIS, vector_in(phys.qvel, k, 0))
    for i in range(4):
        o[QUATERNION.start + i] = phys.qpos[k, 3 + i]
    for i in range(3):
        o[RATE.start + i], o[VELOCITY.start + i] = phys.qvel[k, 3 + i], velocity[i]
    asked = COMMAND.start
    o[asked], o[asked + 1], o[asked + 2] = command[k, COMMAND_X], command[k, COMMAND_Y], command[k, TURN]
    for i in range(joints):
        o[ANGLES + i], o[ANGLES + joints + i] = phys.qpos[k, JOINT + i], phys.qvel[k, BASE + i]


SERVOS = Actuation(begin_servos, servo_torques, finish_servos)


def joint_names(body: CompiledRobot) -> tuple[str | None, ...]:
    """Names of the M joints in the order of observation and action; None for one that the robot lacks."""
    names = [None if joint == MISSING else body.model.joint(joint).name for joint in body.indices.joints[1:]]
    return (*names, *(name for name, _ in body.plan.held))


def own_angles(body: CompiledRobot, robot: Any) -> Array:
    """Angles (M,) of the robot that stands as its plan says [rad]."""
    return np.array([*standing_posture(body, robot), *(angle for _, angle in body.plan.held)])


def largest_torques(body: CompiledRobot) -> Array:
    """Largest torque (M,) of each motor [N m], 0 where the robot has no joint."""
    motors = (*body.indices.motors, *body.indices.held_motors)
    return np.array([0.0 if m == MISSING else body.model.actuator_forcerange[m, 1] for m in motors])


def own_servos(body: CompiledRobot, robot: Any) -> Servos:
    """Servos whose action of 1 asks for the motor's full torque, at the posture in which the robot stands.

    Stiffness and damping as those of `joint_control`.
    """
    names, angles, torque = joint_names(body), own_angles(body, robot), largest_torques(body)
    has = [i for i, name in enumerate(names) if name is not None]
    stiffness = torque / joint_control.TARGET_REACH
    parts = (tuple(values[has].tolist()) for values in
             (angles, stiffness, joint_control.DAMPING_TIME * stiffness))  # fmt: skip
    return Servos(tuple(name for name in names if name), *parts, reach=joint_control.TARGET_REACH)


class FullBodyCore(JointCore):
    """n robots under targets of all their joints."""

    actuation: ClassVar[Actuation] = SERVOS
    servos: Servos | None = None
    own: FullBodyParts
    stride = 0.0  # of the robot that is reset next, see `Scenario.stride` [m]

    def __init__(self, *biped: Any, servos: Servos | None = None):
        """Build the robots: arguments of `BipedCore`, and their drives; None: see `own_servos`."""
        self.servos = servos
        super().__init__(*biped)

    @property
    def drives(self) -> Drives:
        """Targets and constants of all joints."""
        return self.own.drives

    @property
    def asked(self) -> Array:
        """Actions of the period, (n, M) in [-1, 1]."""
        return self.drives.asked

    def _own_parts(self) -> FullBodyParts:
        """Make the parts of robots that hold their posture."""
        return FullBodyParts(self._make_joints(), self._make_drives())

    def _make_drives(self) -> Drives:
        body = self.body
        self.servos = own_servos(body, self.robot) if self.servos is None else self.servos
        names, servos = joint_names(body), self.servos
        if unknown := [name for name in servos.joints if name not in names]:
            raise UnknownNameError(
                f"joint of {body.description.name} in Servos", unknown[0], [name for name in names if name]
            )
        largest, size = largest_torques(body), len(names)
        inertia = joint_inertia(body)
        constants = {
            "posture": own_angles(body, self.robot),
            "stiffness": inertia * FREQUENCY**2, "damping": 2.0 * inertia * FREQUENCY,
            "largest": largest, "reach": np.zeros(size),
        }  # fmt: skip
        places = [names.index(name) for name in servos.joints]
        for name in ("posture", "stiffness", "damping"):
            constants[name][places] = getattr(servos, name)
        constants["reach"][places] = servos.reach
        if servos.torque is not None:
            largest[places] = np.minimum(largest[places], servos.torque)
        seen = np.zeros((self.n, ANGLES + 2 * size))
        asked, target = np.zeros((self.n, size)), np.tile(constants["posture"], (self.n, 1))
        return Drives(asked, target, np.full((self.n, size), np.nan), seen, **constants)

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Reset as `BipedCore` does, the robot at rest in its posture; astride where the scenario says so."""
        drives = self.drives
        drives.asked[k], drives.target[k], drives.imposed[k] = 0.0, drives.posture, np.nan
        if self.stride:
            start = standing_start(self.robot.pelvis_width, self.stride)
        super().reset(k, scenario, start, gait, action)

    def _posture(
        self, com: Array, velocity: Array, soles: Array, lean: tuple[float, float]
    ) -> tuple[Array, Array]:
        if self.stride:
            return posture(self.body, com, np.zeros(3), soles, lean)
        return posed(self.body, self.drives.posture, soles, lean), np.zeros(self.body.model.nv)


def joint_inertia(body: CompiledRobot) -> Array:
    """Inertia that each joint moves, the robot at rest in its reference posture, (M,) [kg m^2]."""
    inertia, indices = moved_inertia(body.in_reference_posture()), body.indices
    dofs = (*indices.dof[BASE:], *indices.held_dof)
    return np.array([0.0 if dof == MISSING else inertia[dof] for dof in dofs])


def posed(body: CompiledRobot, angles: Array, soles: Array, lean: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Coordinates of a robot in a posture, over the middle of soles (2, 3) [m] and on them.

    As a whole it is upright, or leans forward and to the left [rad], on an edge of its soles.
    """
    data, indices = mujoco.MjData(body.model), body.indices
    places = (*indices.qpos[JOINT:], *indices.held_qpos)
    data.qpos[list(indices.qpos[:JOINT])] = 0.0, 0.0, 0.0, *leaning(lean)
    for place, angle in zip(places, angles, strict=True):
        if place != MISSING:
            data.qpos[place] = angle
    mujoco.mj_kinematics(body.model, data)
    (length, width), sites = body.half_sole, list(indices.soles)
    reach = data.site_xmat[sites].reshape(2, 3, 3)[:, 2, :2]  # of the soles' axes upwards
    lowest = (data.site_xpos[sites, 2] - np.abs(reach) @ [length, width]).min()
    middle = 0.5 * (soles[:, :2].sum(axis=0) - data.site_xpos[sites, :2].sum(axis=0))
    data.qpos[list(indices.qpos[:3])] = *middle, soles[:, 2].max() - SUNK - lowest
    return data.qpos.copy()


WINDOW = 1.0  # over which velocities are averaged [s]
UPRIGHT = 0.35  # largest lean of pelvis and trunk of a robot that has recovered, 20 degrees [rad]


class Steadiness(NamedTuple):
    """What recovered means for n robots whose feet nobody asks for.

    A robot has recovered since the first of the moments, without a gap up to now, at which for a whole second
    no push has acted and no command has changed, over which its mean velocity in the axes of its own heading
    was within 0.15 m/s of the command, and at which pelvis and trunk lean by at most 20 degrees.
    """

    ways: Floats3  # (n, W, 2) gone by the end of each of the last W periods, in the axes of the heading [m]
    com: Floats2  # (n, 2) at the end of the last period, in the world [m]
    since: Floats1  # (n,) [s], NaN while it has not

    def begin(self, k: int, com: Array) -> None:
        """Forget robot k, whose CoM is at (2,) [m]."""
        self.ways[k], self.com[k], self.since[k] = 0.0, com, np.nan

    def look(self, moment: Moment) -> Array:
        """Judge the robots at the end of a period; returns the error of their mean velocity (n,) [m/s]."""
        way, (cosine, sine) = moment.com - self.com, (np.cos(moment.heading), np.sin(moment.heading))
        gone = np.stack([cosine * way[:, 0] + sine * way[:, 1], cosine * way[:, 1] - sine * way[:, 0]], 1)
        self.com[:] = moment.com
        last = self.ways[:, -1].copy()
        mean = (last + gone - self.ways[:, 0]) / WINDOW
        self.ways[:, :-1] = self.ways[:, 1:]
        self.ways[:, -1] = last + gone
        error = np.hypot(*(mean - moment.command[:, :2]).T)
        quiet = moment.time - moment.event >= WINDOW - 1e-9
        good = quiet & (error <= SPEED_TOLERANCE) & (moment.lean <= UPRIGHT)
        self.since[:] = np.where(good, np.where(np.isnan(self.since), moment.time, self.since), np.nan)
        return error


class Moment(NamedTuple):
    """n robots at the end of a period."""

    com: Array  # (n, 2) in the world [m]
    heading: Array  # (n,) [rad]
    time: Array  # (n,) since reset [s]
    event: Array  # (n,) when the last push has ended and the command has changed for the last time [s]
    command: Array  # (n, 4) in force
    lean: Array  # (n,) of pelvis or trunk, whichever leans more [rad]


@dataclass(frozen=True)
class FullBodyConfig(BipedConfig):
    """Which robots, and the servos that drive them."""

    servos: Servos | None = None  # None: those of `own_servos`


class FullBodyEpisodes(JointEpisodes):
    """Episodes of n robots under targets of all joints."""

    name = "PushRecovery/BipedFullBody-v0"
    config_of = FullBodyConfig
    core: Any  # a FullBodyCore
    config: FullBodyConfig

    def __init__(self, n: int, config: BipedConfig | None = None, threads: int = 1, **changes: Any):
        """Build the robots, see `BipedEpisodes`."""
        given = BipedConfig() if config is None else require_kind("config", config, BipedConfig)
        config = FullBodyConfig(**(vars(given) | changes))
        servos = None if config.servos is None else require_kind("servos", config.servos, Servos)
        self.core_of = partial(FullBodyCore, servos=servos)  # type: ignore[misc]
        super().__init__(n, replace(config, robot=driven(config.robot)), threads)
        size = self.core.drives.target.shape[1]
        self.action_size, self.observation_size = size, self.core.drives.observation.shape[1]  # type: ignore[misc]
        window = round(WINDOW * self.control_hz)
        self._steady = Steadiness(np.zeros((n, window, 2)), np.zeros((n, 2)), np.full(n, np.nan))

    @property
    def seen(self) -> Array:
        """State (n, 13 + 2 M): see `FullBodyEnv`."""
        return self.core.drives.observation

    @property
    def joints(self) -> tuple[str | None, ...]:
        """Names of the M joints in the order of observation and action."""
        return joint_names(self.core.body)

    def begin(self, k: int, scenario: Scenario) -> None:
        """Put robot k at the beginning of a scenario, all of whose pushes come at times."""
        self.core.stride = scenario.stride
        super().begin(k, self.by_time(scenario))
        self._steady.begin(k, self.core.com[k])

    def restore(self, k: int, snapshot: RobotSnapshot, scenario: Scenario | None = None) -> None:
        """Put robot k where another one was, see `GaitEpisodes`."""
        super().restore(k, snapshot, None if scenario is None else self.by_time(scenario))

    def by_time(self, scenario: Scenario) -> Scenario:
        """The scenario with pushes at times instead of gait events."""
        duration = self.nominal(scenario.command.vx, scenario.command.vy).duration

        def at_time(push: Push) -> Push:
            event = push.start
            if not isinstance(event, GaitEvent):
                return push
            step = event.step_index(scenario.stance_side)
            return replace(push, start=(step + event.fraction) * duration)

        pushes = tuple(map(at_time, scenario.forces))
        return replace(scenario, pushes=pushes, kicks=scenario.jumps, disturbances=())

    def _end_period(self, gaits: Array) -> Period:
        period, state, core = super()._end_period(gaits), self.monitor.state, self.core
        upright = core.true_values("xmat")[:, [PELVIS, TRUNK], 8].min(axis=1)
        lean = np.arccos(np.clip(upright, -1.0, 1.0))
        gait = core.gait
        moment = Moment(core.com, gait.heading, gait.time, self._episodes.event, core.command, lean)
        state.speed_error[:] = self._steady.look(moment)
        state.recovered_at[:] = self._steady.since
        return period

    def _arrays(self, k: int) -> Arrays:
        steady = {f"steadiness.{name}": array for name, array in self._steady._asdict().items()}
        return super()._arrays(k) | steady


def driven(robot: str | RobotDescription) -> RobotDescription:
    """The description of a robot all of whose joints are driven, those that it has fixed included."""
    description = robot_description(robot)
    if description.driven:
        return description
    whole = description if description.whole is None else description.whole()
    return replace(whole, driven=True)


class FullBodyEnv(BipedEnv):
    """A robot all of whose M joints follow targets.

    Observation (13 + 2 M,): quaternion of the pelvis (w, x, y, z), its angular velocity in its own axes
    [rad/s], its velocity in its own axes [m/s], the command (forward and left [m/s], turn [rad/s]), angles
    [rad] and rates [rad/s] of the joints. Action (M,) in [-1, 1]: targets in units of the servos' reach, off
    their posture. `env.unwrapped.episodes.joints` names the joints.
    """

    make_episodes = FullBodyEpisodes

    def __init__(self, servos: Servos | None = None, **biped: Any):
        """Build one robot.

        Args:
            servos: its drives; None: see `own_servos`.
            biped: arguments of `BipedEnv`.
        """
        self.make_episodes = partial(FullBodyEpisodes, servos=servos)
        super().__init__(**biped)


make_full_body_vector = vector_maker(FullBodyEnv, FullBodyEpisodes)
