"""The open teleop-walking-benchmark on robots of this package: a tour of 18 waypoints under 18 punches.

Source: github.com/rhoyn/teleop-walking-benchmark, README of 6d331a85 and main.cpp of 2e8b4286, of which the
constants of the README stand where the two differ. Each task is a run id; its waypoints and punches come from
the benchmark's own random streams. A punch of a joint of the G1 acts where `punch_points` says. The way to a
waypoint is the benchmark's: a velocity proportional to the error, within a robot's limits.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.model.robot import SAME, RobotModel, Similarity
from ...controllers.whole_body.kinematics import PELVIS
from ...envs.biped.core import BipedCore
from ...envs.joint.full_body import joint_names
from ...envs.robots.adapt import AdaptedSpec
from ...envs.robots.compiled_robot import CompiledRobot
from ...envs.robots.indices import MISSING
from ...envs.robots.model_files import model_file
from ...envs.scenario.push import Push
from ...envs.scenario.scenario import FASTEST_TURN, Scenario
from ..rollout.contract import gaitkeeper
from ..rollout.outcome import Outcome

SIDES = "left", "right"
WAIST = 3  # joints of the G1's
LINKS = *3 * ("thigh",), "shank", *2 * ("foot",)  # of a leg that its joints move
ARM = "shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw"
SHOULDER = (0.10, 0.24)  # of the G1, aside and over the waist [m]


class PunchPoint(NamedTuple):
    """A body, and an offset from its CoM in the body's axes [m]."""

    body: str
    offset: tuple[float, float, float]


@lru_cache(maxsize=8)
def punch_points(robot: CompiledRobot) -> tuple[PunchPoint, ...]:
    """Punched points in the order of the G1's joints: left leg, right leg, waist, left arm, right arm.

    A punch of a leg's joint acts at that joint on the link that it moves, whichever axis of the hip it is on
    the thigh. One of the waist acts on the trunk at the waist. One of an arm acts on the arm's link, held or
    in one with a held one; on a robot without the G1's arms it acts on the trunk where the G1 has its
    shoulders.
    """
    data, legs = robot.in_reference_posture(), robot.indices.legs
    axis = next((joint for joint in robot.indices.joints[1:3] if joint != MISSING), None)
    waist = data.xpos[robot.indices.trunk] if axis is None else data.xanchor[axis]
    found = [
        _point(robot, data, f"{side}_{link}", data.xanchor[joint])
        for side, leg in zip(SIDES, legs, strict=True)
        for link, joint in zip(LINKS, leg, strict=True)
    ]
    found += WAIST * [_point(robot, data, "trunk", waist)]
    for side, left in zip(SIDES, (1.0, -1.0), strict=True):
        shoulder = _point(robot, data, "trunk", waist + [0.0, left * SHOULDER[0], SHOULDER[1]])
        found += [_on_arm(robot, data, f"{side}_{part}") or shoulder for part in ARM]
    return tuple(found)


def _on_arm(robot: CompiledRobot, data: mujoco.MjData, part: str) -> PunchPoint | None:
    """The origin of a part of an arm, where its joint is, on the link that it is in one with."""
    first = mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_BODY, f"{part}_link")
    if first == MISSING:
        return None
    names, body = {number: name for name, number in robot.pushed.items()}, first
    while body not in robot.indices.pushed:
        body = int(robot.model.body_parentid[body])
    return _point(robot, data, names[robot.indices.pushed.index(body)], data.xpos[first])


def _point(robot: CompiledRobot, data: mujoco.MjData, body: str, point: NDArray[np.float64]) -> PunchPoint:
    """A point of the world in the axes of a body, as the robot stands in `data`."""
    number = robot.indices.pushed[robot.pushed[body]]
    x, y, z = (data.xmat[number].reshape(3, 3).T @ (point - data.xipos[number])).round(6).tolist()
    return PunchPoint(body, (x + 0.0, y + 0.0, z + 0.0))


WAYPOINTS, PUNCHES = 2, 3  # streams
TWISTER_WORDS = 624  # of a Mersenne twister's state
SEGMENTS, SEGMENT = 18, 5.0  # of the tour, and how long each is [s]
LENGTH = SEGMENTS * SEGMENT  # [s]
RADIUS, AHEAD = 1.0, 0.3  # of the disc that waypoints lie in, and how far ahead its centre is [m]
JOINTS = 29  # of the G1: 0-5 left leg, 6-11 right leg, 12-14 waist, 15-21 left arm, 22-28 right arm
FIRST_PUNCH, PUNCH_DURATION = 0.1, 0.08  # [s]
CEILING = 500.0  # of the punches on the G1 [N]
RAMP = 60.0  # time in which the ceiling rises from a third of that to all of it [s]
G1_MASS = 35.112  # [kg]


class Pose(NamedTuple):
    """Position and heading of the pelvis over the floor; a waypoint is one in the frame of the begin."""

    x: float  # forward [m]
    y: float  # to the left [m]
    yaw: float  # in (-pi, pi] [rad]


class Punch(NamedTuple):
    """One punch as the benchmark draws it, for the G1."""

    joint: int  # index
    direction: tuple[float, float, float]  # of length 1, world axes
    force: float  # [N]


def seed_words(values: Sequence[int]) -> list[int]:
    """State that C++'s `std::seed_seq` gives `std::mt19937` from seeds ([rand.util.seedseq]).

    With s seeds, n = 624, t = 11, p = 306, q = 317 and T(x) = x xor (x >> 27), all modulo 2^32.
    """
    n, p, q, count, mask = TWISTER_WORDS, 306, 317, len(values), 0xFFFFFFFF

    def mixed(word: int) -> int:
        return word ^ (word >> 27)

    words = [0x8B8B8B8B] * n
    for k in range(n):
        first = 1664525 * mixed(words[k] ^ words[(k + p) % n] ^ words[k - 1]) & mask
        more = count if k == 0 else k + values[k - 1] if k <= count else k
        second = (first + more) & mask
        words[(k + p) % n] = (words[(k + p) % n] + first) & mask
        words[(k + q) % n] = (words[(k + q) % n] + second) & mask
        words[k] = second
    for k in range(n):
        total = (words[k] + words[(k + p) % n] + words[k - 1]) & mask
        third = 1566083941 * mixed(total) & mask
        fourth = (third - k) & mask
        words[(k + p) % n] ^= third
        words[(k + q) % n] ^= fourth
        words[k] = fourth
    if words[0] >> 31 and not any(words[1:]):
        words[0] = 1 << 31
    return words


class SeededTwister:
    """A Mersenne twister seeded as `std::seed_seq` seeds it, and the benchmark's draws."""

    def __init__(self, *seeds: int):
        self._generator = np.random.MT19937(0)
        state = self._generator.state
        state["state"] = {"key": np.array(seed_words(seeds), dtype=np.uint32), "pos": TWISTER_WORDS}
        self._generator.state = state

    def raw(self) -> int:
        """The next 32 bits."""
        return int(self._generator.random_raw())

    def unit(self) -> float:
        """In [0, 1), by the upper 24 bits."""
        return (self.raw() >> 8) / 2**24

    def between(self, low: float, high: float) -> float:
        """In [low, high)."""
        return low + (high - low) * self.unit()

    def below(self, count: int) -> int:
        """An integer in [0, count), each as likely."""
        span = 2**32 // count
        while (draw := self.raw()) >= span * count:
            pass
        return draw // span


def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi] [rad]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


def waypoints(run_id: int) -> tuple[Pose, ...]:
    """The 18 waypoints of a task."""
    stream, found = SeededTwister(run_id, WAYPOINTS), []
    for _ in range(SEGMENTS):
        radius = RADIUS * math.sqrt(stream.unit())
        bearing, yaw = 2.0 * math.pi * stream.unit(), 2.0 * math.pi * stream.unit()
        x, y = AHEAD + radius * math.cos(bearing), radius * math.sin(bearing)
        found.append(Pose(x, y, wrapped(yaw)))
    return tuple(found)


def punch_time(index: int) -> float:
    """When a punch begins [s]."""
    return FIRST_PUNCH + SEGMENT * index


def punches(run_id: int) -> tuple[Punch, ...]:
    """The 18 punches of a task."""
    stream, found = SeededTwister(run_id, PUNCHES), []
    for i in range(SEGMENTS):
        joint, z = stream.below(JOINTS), stream.between(-1.0, 1.0)
        phi, flat = stream.between(0.0, 2.0 * math.pi), math.sqrt(1.0 - z * z)
        ceiling = CEILING * (1.0 / 3.0 + 2.0 / 3.0 * min((punch_time(i) - FIRST_PUNCH) / RAMP, 1.0))
        direction = (flat * math.cos(phi), flat * math.sin(phi), z)
        found.append(Punch(joint, direction, ceiling * stream.between(0.5, 1.0)))
    return tuple(found)


def tour_scenario(run_id: int, robot: CompiledRobot) -> Scenario:
    """The punches of a task on a robot; its command is written while it walks."""
    pushes, points, share = [], punch_points(robot), force_share(robot.robot)
    for i, (joint, direction, force) in enumerate(punches(run_id)):
        x, y, z = (round(force * share * part, 3) + 0.0 for part in direction)
        body, offset = points[joint]
        pushes.append(Push((x, y, z), PUNCH_DURATION, round(punch_time(i), 6), body, offset))
    return Scenario(f"tour-{run_id:04d}", tuple(pushes), duration=LENGTH, noise_seed=run_id)


def force_share(robot: RobotModel) -> float:
    """Factor of the forces: the ratio of masses on the biped of 60 kg, 1 on robots that exist."""
    return robot.mass / G1_MASS if Similarity.of(robot) == SAME else 1.0


GAIN = 1.5  # of position and of heading [1/s]
REACHED, LOST = (0.10, 0.05), (0.20, 0.12)  # distance [m], heading [rad]
SLOWEST_X, FASTEST_X, FASTEST_Y = -0.25, 0.5, 0.2  # commands of a robot of 0.8 m [m/s]
ROUNDING = 1e-9  # times are sums of steps [s]


def in_frame(pose: Pose, origin: Pose) -> Pose:
    """A pose as seen from another one; of a target, the error that is left."""
    east, north = pose.x - origin.x, pose.y - origin.y
    cos, sin = math.cos(origin.yaw), math.sin(origin.yaw)
    return Pose(cos * east + sin * north, cos * north - sin * east, wrapped(pose.yaw - origin.yaw))


class Follower:
    """Commands of one robot that walks to one waypoint after the other.

    A waypoint is reached within the bounds of REACHED, and lost again beyond those of LOST; meanwhile the
    command is to rest. Position and heading are reached each for itself. Velocities are `velocity` times as
    large as those of a robot whose CoM is 0.8 m high.
    """

    def __init__(self, velocity: float = 1.0) -> None:
        self._slowest_x, self._fastest_x, self._fastest_y = (
            velocity * speed for speed in (SLOWEST_X, FASTEST_X, FASTEST_Y)
        )
        self._target: Pose | None = None
        self._there = [False, False]  # position, heading

    def command(self, pose: Pose, target: Pose) -> tuple[float, float, float]:
        """Velocity forward and to the left [m/s] and turn [rad/s]."""
        if target != self._target:
            self._target, self._there = target, [False, False]
        forward, left, turn = in_frame(target, pose)
        for i, error in enumerate((math.hypot(forward, left), abs(turn))):
            bound = LOST[i] if self._there[i] else REACHED[i]
            self._there[i] = error < bound
        walk, face = (0.0 if there else GAIN for there in self._there)
        return (
            min(max(walk * forward, self._slowest_x), self._fastest_x),
            min(max(walk * left, -self._fastest_y), self._fastest_y),
            min(max(face * turn, -FASTEST_TURN), FASTEST_TURN),
        )


class TourWatcher:
    """Writes each robot's command from the true pose of its pelvis, as the benchmark's harness does.

    With `arms` it also holds or moves the arms of robots all of whose joints are driven, see `HarnessArms`.
    """

    def __init__(self, arms: Literal["held", "walking"] | None = None) -> None:
        self._tours: dict[int, Tour] = {}
        self._arms: dict[int, HarnessArms] = {}
        self._harness = arms

    def begin(self, core: BipedCore, k: int, scenario: Scenario) -> None:
        """Robot k begins a tour where it stands.

        Raises:
            InvalidValueError: arms that the harness shall drive are held by whole-body control.
        """
        run_id, velocity = int(scenario.id.rpartition("-")[2]), Similarity.of(core.robot).velocity
        self._tours[k] = Tour(waypoints(run_id), pose_of(core, k), velocity, scenario.command.stand)
        if self._harness:
            self._arms[k] = HarnessArms(core, run_id, self._harness == "walking")

    def look(self, core: BipedCore, k: int) -> None:
        """Write the command of robot k; the planning period after the next one is planned on it."""
        core.command[k] = self._tours[k].command(float(core.gait.time[k]), pose_of(core, k))
        if self._harness:
            self._arms[k].move(core, k)

    def end(self, core: BipedCore, k: int, outcome: Outcome) -> dict[str, Any]:
        """Errors at the last look of each segment begun, also the one in which it fell."""
        errors = self._tours.pop(k).errors
        return {
            "position_errors_cm": [round(100.0 * distance, 3) for distance, _ in errors],
            "heading_errors_deg": [round(math.degrees(turn), 3) for _, turn in errors],
        }


class HarnessArms:
    """Arms that the benchmark's harness drives: at its stance, or walking at random from the run id's stream.

    The walk is that of gaitkeeper's `bench_arm_walk`: a new pose every 0.5 s, the right arm as the left one
    in a mirror, hands neither behind the standing ones nor above the chin. The gains are the policy's own.
    """

    def __init__(self, core: Any, run_id: int, walk: bool):
        drives = getattr(core, "drives", None)
        if drives is None:
            raise InvalidValueError(
                "the harness drives the arms only under a policy that drives all joints, such as "
                "holosoma-g1-ppo; planners hold them: leave out --arms"
            )
        bench, model = gaitkeeper("tour"), core.body.model
        names = joint_names(core.body)
        if missing := [name for name in bench.BENCH_ARMS if name not in names]:
            robot = core.body.description.name
            raise InvalidValueError(
                f"the harness drives arms of a G1 of 29 joints; {robot} lacks {missing[0]}"
            )
        if not walk:
            self._columns = [names.index(name) for name in bench.BENCH_ARMS]
            stance = dict(zip(bench.BENCH_MOTORS, bench.BENCH_STANCE, strict=True))
            self._times = np.zeros(1)
            self._angles = np.array([[stance[name] for name in bench.BENCH_ARMS]])
            return
        limits = {name: tuple(model.joint(name).range) for name in bench.BENCH_ARMS}
        spec = core.body.description.spec
        file = model_file(spec.robot.model) if isinstance(spec, AdaptedSpec) else None
        hands = None if file is None else bench.BenchHands.from_mjcf(model, file)
        poses = bench.bench_arm_walk(run_id, LENGTH, limits, hands)
        self._columns = [names.index(name) for name in poses]
        self._times = np.array([time for time, _ in next(iter(poses.values()))])
        self._angles = np.array([[angle for _, angle in rows] for rows in poses.values()]).T

    def move(self, core: Any, k: int) -> None:
        """Let the arms of robot k follow their targets in the coming period."""
        row = min(int(np.searchsorted(self._times, core.gait.time.item(k) + ROUNDING, "right")) - 1,
                  len(self._times) - 1)  # fmt: skip
        core.drives.imposed[k, self._columns] = self._angles[max(row, 0)]


def pose_of(core: BipedCore, k: int) -> Pose:
    """True pose of the pelvis of robot k."""
    state = core.true_state(k)
    (x, y), rotation = state.qpos[k, :2].tolist(), state.xmat[k, PELVIS].tolist()
    return Pose(x, y, math.atan2(rotation[3], rotation[0]))


class Tour:
    """One robot on its way: `errors` has distance [m] and heading error [rad] of each segment begun.

    One that `stands` does so while the follower lets it rest.
    """

    def __init__(self, targets: Sequence[Pose], origin: Pose, velocity: float, stands: bool = False):
        self._targets, self._origin, self._follower = targets, origin, Follower(velocity)
        self._stands = stands
        self.errors: list[tuple[float, float]] = []

    def command(self, time: float, pose: Pose) -> tuple[float, float, float, bool]:
        """Velocity forward and to the left [m/s], turn [rad/s] and whether to stand, at a time and a pose."""
        index = min(int((time + ROUNDING) / SEGMENT), SEGMENTS - 1)
        here, target = in_frame(pose, self._origin), self._targets[index]
        forward, left, turn = in_frame(target, here)
        self.errors[index:] = [(math.hypot(forward, left), abs(turn))]
        command = self._follower.command(here, target)
        return *command, self._stands and not any(command)
