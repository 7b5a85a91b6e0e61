"""Gait state machine of n bipeds: touchdown, swing foot, CoM task; compiled, every physics step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.np.numpy_support import carray

from ..array_table import Floats1, Floats2, Ints1
from ..jit import njit
from ..math3 import ZERO, Vector, cross, stack_floats, subtract, vector_at, vector_of
from ..model import observation
from ..model.gait_box import COP, DURATION, GAIT_SIZE, STEP, TRUNK
from ..model.nominal_gait import both_stand
from ..model.observation import (
    ON_BOTH_FEET,
    canonical,
    canonical_frame,
    heading_frame,
    in_world,
    point_in_world,
)
from ..model.standing import THROWN, may_settle, stays_on_other_foot
from . import kinematics, limits, swing
from .inverse_dynamics import Gains, Task, whole_body_torque
from .kinematics import PELVIS, Array, Heading, Ints, Physics, sole_position
from .limits import LANDED_LATE, TOUCHDOWN_ERROR, Bounds
from .swing import PELVIS_YAW
from .two_feet import standing_torque

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

FAILURES = ("", "com_height", "pelvis_tilt", "not_finite")
TOO_LOW, TILTED, NOT_FINITE = range(1, len(FAILURES))
LOWEST = 0.6  # of the CoM's height
STEEPEST = 0.5  # cosine of the pelvis' lean
FLOOR = 3  # column of `Gait.height`: the floor under the stance sole
SINKING = 5.0  # fastest that the CoM's reference falls in double support, so that the feet keep load [m/s^2]
MOMENT = 3  # first column of a wrench's moment
Point = tuple[float, float]  # on the floor, world axes [m]


class Gait(NamedTuple):
    """State of the gait machine of n robots."""

    stance: Ints1  # (n,) 0 left, 1 right
    steps: Ints1  # (n,) completed steps
    elapsed: Floats1  # (n,) since the step began [s]; ON_BOTH_FEET while the robot stands
    time: Floats1  # (n,) since reset [s]
    heading: Floats1  # (n,) of the stance sole and the canonical frame [rad]
    swing: Floats2  # (n, 9) reference of the swing sole: position, velocity, acceleration
    height: Floats2  # (n, 4) reference of the CoM's height, its velocity, acceleration; floor's height
    plan: Floats2  # (n, 7) gait variables, held for a planning period
    failure: Ints1  # (n,) index into FAILURES
    wrench: Floats2  # (n, 6) that the last torque asks of the stance sole
    turn: Floats1  # (n,) commanded [rad/s]
    stand: Floats1  # (n,) 1: commanded to stand
    yaw: Floats2  # (n, 7) references of swing sole and pelvis beyond the heading, see `turn_references`
    rise: Floats1  # (n,) of the floor from the stance sole to the next foothold, where that is known [m]
    course: Floats1  # (n,) heading to keep while no turn is commanded [rad]


class GaitSettings(NamedTuple):
    """Constants of the gait machine."""

    omega: float  # [1/s]
    com_height: float  # [m]
    cmp_gain: float  # j / (m g) [m s^2]
    mass: float  # [kg]
    feet_apart: float  # l_p: lateral distance of feet that stand [m]
    apex: float  # height of the swing sole in mid-step [m]
    landing_delay: float  # the swing sole aims at the floor this long after T [s]
    commit: float  # from T - this place and time stay, but for a step that ends later still [s]
    early: float  # contact counts as touchdown from T - this [s]
    early_load: float  # with this load [N]
    forced_load: float  # or with this load, late in the step
    forced_phase: float  # fraction of T from which forced_load counts
    descent: float  # of the swing foot when late [m/s]
    settled: float  # the floor is taken for as high as the stance sole is this long after touchdown [s]
    reach: float  # longest leg, hip to ankle [m]
    height_drop: float  # how far the CoM is lowered for a long step [m]
    height_lead: float  # the CoM is at the height of the step this long before T [s]
    height_time: float  # shortest horizon of the height reference [s]
    twist_max: float = math.pi  # a pelvis that is twisted off its yaw by more turns the next sole, too [rad]
    turn_back: float = 0.0  # yaw by which a step at most turns back while no turn is commanded [rad]
    double_support: float = 0.0  # both feet bear load for this long from touchdown on [s]


def resting_gait(n: int) -> Gait:
    """Make the state of n robots that have not begun."""
    return Gait(
        stance=np.zeros(n, np.int64), steps=np.zeros(n, np.int64), elapsed=np.zeros(n), time=np.zeros(n),
        heading=np.zeros(n), swing=np.zeros((n, 9)), height=np.zeros((n, 4)), plan=np.zeros((n, GAIT_SIZE)),
        failure=np.zeros(n, np.int64), wrench=np.zeros((n, 6)), turn=np.zeros(n), stand=np.zeros(n),
        yaw=np.zeros((n, swing.SIZE)), rise=np.zeros(n), course=np.zeros(n),
    )  # fmt: skip


@njit(cache=True)
def accept(gait: Gait, k: int, s: GaitSettings, asked: Array, action: Array, previous: Array) -> None:
    """Hold the asked gait (7,) for one robot, and its action (7,) as the previous one.

    A swing foot about to land is committed: place and time of the step stay, unless the asked step is far
    enough from landing for the foot to go elsewhere.
    """
    landing = max(gait.plan[k, DURATION], asked[DURATION]) - gait.elapsed[k]
    first = COP if landing < s.commit else STEP
    for i in range(first, asked.shape[0]):
        gait.plan[k, i] = asked[i]
        previous[i] = action[i]


@njit(cache=True)
def other_sole(phys: Physics, gait: Gait, k: int) -> Point:
    """Centre of the other sole from that of the stance sole, canonical frame [m]."""
    stance = gait.stance[k]
    sole, foot = sole_position(phys, k, stance), sole_position(phys, k, 1 - stance)
    return canonical(canonical_frame(gait.heading[k], stance), foot[0] - sole[0], foot[1] - sole[1])


@njit(cache=True, forceinline=True)
def take_heading(gait: Gait, k: int) -> None:
    """Take the heading of the new stance sole, which is kept once no turn is commanded any more."""
    gait.heading[k] += swing.exchange_soles(gait.yaw[k])
    if gait.turn[k] != 0.0:
        gait.course[k] = gait.heading[k]


@njit(cache=True, forceinline=True)
def touch_down(phys: Physics, gait: Gait, k: int, double_support: float = 0.0) -> None:
    """Exchange the feet; what is held of the plan is mirrored into the new frame.

    Its CoP is the centre of the new stance sole, in double support [s] that of the old one.
    """
    old = gait.stance[k]
    gait.stance[k] = 1 - old
    gait.steps[k] += 1
    gait.elapsed[k] = gait.rise[k] = 0.0
    take_heading(gait, k)
    gait.swing[k] = 0.0
    gait.swing[k, 0], gait.swing[k, 1], gait.swing[k, 2] = sole_position(phys, k, old)
    gait.height[k, 0] -= sole_position(phys, k, 1 - old)[2] - gait.swing[k, 2]  # it is over the stance sole
    gait.plan[k, COP : COP + 2] = 0.0
    if double_support > 0.0:
        gait.plan[k, COP], gait.plan[k, COP + 1] = other_sole(phys, gait, k)
    gait.plan[k, TRUNK + 1] = -gait.plan[k, TRUNK + 1]


@njit(cache=True)
def landing_error(phys: Physics, gait: Gait, k: int) -> int:
    """TOUCHDOWN_ERROR where the swing foot has landed off the planned place or time, otherwise 0."""
    stance, plan = gait.stance[k], gait.plan[k]
    sole, foot = sole_position(phys, k, stance), sole_position(phys, k, 1 - stance)
    frame = canonical_frame(gait.heading[k], stance)
    x, y = point_in_world(frame, sole[0], sole[1], plan[STEP], plan[STEP + 1])
    late = abs(gait.elapsed[k] - plan[DURATION]) > LANDED_LATE
    off = math.hypot(foot[0] - x, foot[1] - y) > limits.LANDED_OFF or late
    return TOUCHDOWN_ERROR if off else 0


@njit(cache=True, forceinline=True)
def has_landed(load: float, elapsed: float, duration: float, s: GaitSettings) -> bool:
    """Touchdown of the swing foot: loaded near T, or loaded heavily late in the step."""
    if elapsed >= duration - s.early:
        return load > s.early_load
    return elapsed > s.forced_phase * duration and load > s.forced_load


@njit(cache=True, forceinline=True)
def lowest_height(rise: float, s: GaitSettings) -> float:
    """Least height of the CoM over the stance sole [m]; half of a fall of the floor to the target lower."""
    return s.com_height - s.height_drop + min(0.5 * rise, 0.0)


@njit(cache=True, forceinline=True)
def reach_height(
    phys: Physics, k: int, stance: int, sole: Vector, target: Point, travel: Point, rise: float,
    s: GaitSettings,
) -> tuple[float, Point]:  # fmt: skip
    """CoM height [m] at which both legs reach their soles at touchdown, and the target, moved within reach.

    A leg of length r whose hip is d beside its ankle lets the hip be sqrt(r^2 - d^2) above it. On a floor
    that rises by z to the target, the CoM is to be z / 2 higher over the stance sole: halfway on the plane
    through both, on which its horizontal motion is the level pendulum's (Kajita et al. 2001, IROS).
    """
    height, reach = s.com_height + 0.5 * rise, s.reach**2
    for leg in range(2):
        hip_x, hip_y, hip_z = vector_at(phys.xanchor, k, kinematics.LEG_JOINT[leg])
        above = hip_z - phys.com[k, 0, 2] - phys.ankle_height[0]  # of the hip over the CoM, less the ankle's
        under = 0.0 if leg == stance else rise
        farthest = max(reach - (s.com_height - s.height_drop + above - under) ** 2, 0.0)
        foot_x, foot_y = (sole[0], sole[1]) if leg == stance else target
        dx, dy = foot_x - hip_x - travel[0], foot_y - hip_y - travel[1]
        aside = dx * dx + dy * dy
        if leg != stance and aside > farthest:
            excess = 1.0 - math.sqrt(farthest / aside)
            target = target[0] - dx * excess, target[1] - dy * excess
        elif leg == stance:
            aside = max(aside, (sole[0] - hip_x) ** 2 + (sole[1] - hip_y) ** 2)  # now
        height = min(height, under + math.sqrt(reach - min(aside, farthest)) - above)
    return max(height, lowest_height(rise, s)), target


@njit(cache=True, forceinline=True)
def com_cmp_offset_and_deficit(
    place: Point, speed: Point, plan: Array, sign: float, growth: float, s: GaitSettings
) -> tuple[Point, Point]:
    """Offset of the CoM from the planned CMP, acceleration = omega^2 offset (eq. 4), and `missing_cmp`.

    Along the heading and to the left, from the stance sole [m]. The DCM's goal is that of stepping in place,
    u_T + b with b = -W / (1 + exp(omega T)) aside.
    """
    cmp_x = plan[COP] + s.cmp_gain * plan[TRUNK]
    cmp_y = sign * (plan[COP + 1] + s.cmp_gain * plan[TRUNK + 1])
    goal_y = sign * plan[STEP + 1] * (1.0 - 1.0 / (1.0 + math.exp(s.omega * plan[DURATION])))
    missing_x = limits.missing_cmp(place[0] + speed[0] / s.omega, plan[STEP], cmp_x, growth)
    missing_y = limits.missing_cmp(place[1] + speed[1] / s.omega, goal_y, cmp_y, growth)
    return (place[0] - cmp_x, place[1] - cmp_y), (missing_x, missing_y)


@njit(cache=True, inline="always")
def move_references(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, sole: Vector, facing: Heading, target: Point,
    travel: Point, remaining: float, dt: float,
) -> int:  # fmt: skip
    """Move the references of CoM height, swing sole and yaw on by a physics step dt; bits of the bounds met.

    Given are the stance sole's centre and heading, where the swing sole is to land, how far the CoM travels
    until then [m] and the time that remains [s].
    """
    rise = gait.rise[k]
    height, place = reach_height(phys, k, gait.stance[k], sole, target, travel, rise, s)
    met = limits.LEG_REACH if place != target or height <= lowest_height(rise, s) else 0
    lift, horizon = gait.height[k], max(remaining - s.height_lead, s.height_time)
    if both_stand(gait.elapsed[k], s.double_support):  # the quintic's peak is 10 / sqrt(3) distance / time^2
        horizon = max(horizon, math.sqrt(10.0 / math.sqrt(3.0) * abs(height - lift[0]) / SINKING))
    lift[0], lift[1], lift[2] = swing.quintic_step(lift[0], lift[1], lift[2], height, 0.0, horizon, dt)
    if gait.elapsed[k] < s.settled:
        lift[FLOOR] = sole[2]
    landing_floor = lift[FLOOR] + rise
    gait.swing[k, 2] -= landing_floor
    landing, turned = gait.plan[k, DURATION] + s.landing_delay, gait.yaw[k, swing.SWING]
    aloft, flight = gait.elapsed[k] - s.double_support, landing - s.double_support
    apex = s.apex + max(-rise, 0.0)  # over the higher of both floors
    phase = swing.apex_phase_of(rise)
    swing.swing_update(gait.swing[k], place[0], place[1], aloft, flight, dt, apex, s.descent, phase)
    gait.swing[k, 2] += landing_floor
    twist = -kinematics.upright_error(phys.xmat, k, PELVIS, facing)[2] - gait.yaw[k, PELVIS_YAW]
    astray = gait.heading[k] - gait.course[k] if gait.turn[k] == 0.0 else 0.0
    given = swing.given_yaw(twist, s.twist_max) + swing.yaw_back(astray, s.turn_back)
    swing.turn_references(gait.yaw[k], gait.turn[k], landing, remaining, s.commit, given, dt)
    if both_stand(gait.elapsed[k], s.double_support):  # the other sole stays where it is
        gait.swing[k] = 0.0
        gait.swing[k, 0], gait.swing[k, 1], gait.swing[k, 2] = sole_position(phys, k, 1 - gait.stance[k])
        gait.yaw[k, swing.SWING : PELVIS_YAW] = turned, 0.0, 0.0
    return met


@njit(cache=True)
def torque_on_both_feet(
    phys: Physics, gait: Gait, k: int, task: Task, climb: float, most: float, gains: Gains, both: Bounds
) -> int:
    """`standing_torque`, within what the motors give; the wrench kept is that of both feet."""
    wrench, other = gait.wrench[k], carray(stack_floats(6), (6,))
    met = standing_torque(phys, k, task, climb, most, gains, both, wrench, other, phys.ctrl[k])
    limits.clip_torque(phys.ctrl[k], both.torque_range)
    sole, foot = sole_position(phys, k, task.stance), sole_position(phys, k, 1 - task.stance)
    moment = cross(subtract(foot, sole), vector_of(other, 0))
    for i in range(3):
        wrench[i], wrench[3 + i] = wrench[i] + other[i], wrench[3 + i] + other[3 + i] + moment[i]
    return met


@njit(cache=True, inline="always")
def walk(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, gains: Gains, bounds: Bounds, both: Bounds, dt: float
) -> int:
    """Swing foot, CoM acceleration of the pendulum and whole-body torque of one robot.

    In double support, t seconds after touchdown, the other foot bears at most the share 2 (1 - t / d) of the
    load: twice what it has in the undisturbed transfer, and nothing when it lifts. Returns the bounds met, as
    bits of `limits_met`.
    """
    stance, plan = gait.stance[k], gait.plan[k]
    ahead, sign = observation.heading_frame(gait.heading[k]), observation.side_sign(stance)
    frame = observation.Frame(ahead.cos, ahead.sin, sign)
    sole, com = sole_position(phys, k, stance), vector_at(phys.com, k, 0)
    velocity = kinematics.com_velocity(phys, k)
    remaining = max(plan[DURATION] - gait.elapsed[k], 0.0)
    growth = math.exp(s.omega * remaining)
    place = canonical(ahead, com[0] - sole[0], com[1] - sole[1])
    speed = canonical(ahead, velocity[0], velocity[1])
    (offset_x, offset_y), missing = com_cmp_offset_and_deficit(place, speed, plan, sign, growth, s)
    offset_x, offset_y = observation.in_world(ahead, offset_x, offset_y)
    target = point_in_world(frame, sole[0], sole[1], plan[STEP], plan[STEP + 1])
    # travel of the CoM until touchdown, were the CMP to stay
    rise, run = 0.5 * (growth + 1.0 / growth) - 1.0, 0.5 * (growth - 1.0 / growth) / s.omega
    travel = offset_x * rise + velocity[0] * run, offset_y * rise + velocity[1] * run
    facing = ahead.cos, ahead.sin
    met = move_references(phys, gait, k, s, sole, facing, target, travel, remaining, dt)
    acceleration = s.omega**2 * offset_x, s.omega**2 * offset_y
    waist = plan[TRUNK], -sign * plan[TRUNK + 1]
    yaws = vector_of(gait.yaw[k], swing.SWING), vector_of(gait.yaw[k], PELVIS_YAW)
    planned = (plan[COP], sign * plan[COP + 1]), missing
    task = Task(
        stance, acceleration, vector_of(gait.height[k], 0), facing, gait.swing[k], waist, *yaws, *planned
    )
    if both_stand(gait.elapsed[k], s.double_support):
        most = min(2.0 * (1.0 - gait.elapsed[k] / s.double_support), 1.0)
        return met | torque_on_both_feet(phys, gait, k, task, velocity[2], most, gains, both)
    met |= whole_body_torque(phys, k, task, velocity[2], gains, bounds, gait.wrench[k], phys.ctrl[k])
    limits.clip_torque(phys.ctrl[k], bounds.torque_range)
    return met


@njit(cache=True)
def may_stand(phys: Physics, gait: Gait, k: int, s: GaitSettings, both: Bounds) -> bool:
    """Whether a robot that has touched down is told to stand, and can (`may_settle`)."""
    if gait.stand[k] == 0.0:
        return False
    ahead, stance = heading_frame(gait.heading[k]), gait.stance[k]
    sole, foot = sole_position(phys, k, stance), sole_position(phys, k, 1 - stance)
    com, velocity = vector_at(phys.com, k, 0), kinematics.com_velocity(phys, k)
    other_x, other_y = canonical(ahead, foot[0] - sole[0], foot[1] - sole[1])
    x = com[0] - sole[0] + velocity[0] / s.omega
    y = com[1] - sole[1] + velocity[1] / s.omega
    x, y = canonical(ahead, x, y)
    half_x, half_y = both.settings.cop_x_max, both.settings.cop_y_max
    return may_settle(other_x, other_y, x, y, half_x, half_y, s.feet_apart)


@njit(cache=True)
def choose_stance(phys: Physics, gait: Gait, k: int, thrown: bool) -> tuple[Vector, Vector]:
    """Let a standing robot's stance foot be the one nearer to the CoP asked for, or the other one.

    Returns the positions of stance sole and other sole. A stance foot that was `thrown` off the floor is none
    any more, whatever was asked.
    """
    old = gait.stance[k]
    sole, foot = sole_position(phys, k, old), sole_position(phys, k, 1 - old)
    if not stays_on_other_foot(gait.plan[k], *other_sole(phys, gait, k), thrown):
        return sole, foot
    gait.stance[k] = 1 - old
    take_heading(gait, k)
    gait.height[k, 0] -= foot[2] - sole[2]
    return foot, sole


@njit(cache=True)
def lift_off(phys: Physics, gait: Gait, k: int) -> None:
    """Let a standing robot's step begin, on the foot nearer to the CoP asked for (`stays_on_other_foot`)."""
    _, foot = choose_stance(phys, gait, k, False)
    gait.swing[k] = 0.0
    gait.swing[k, 0], gait.swing[k, 1], gait.swing[k, 2] = foot
    gait.elapsed[k] = 0.0


@njit(cache=True)
def stand(phys: Physics, gait: Gait, k: int, s: GaitSettings, gains: Gains, both: Bounds, dt: float) -> int:
    """CoM acceleration of the pendulum and whole-body torque of a robot on both feet; the bounds met."""
    sole, foot = sole_position(phys, k, gait.stance[k]), sole_position(phys, k, 1 - gait.stance[k])
    if phys.load[k, gait.stance[k]] == 0.0 and sole[2] > foot[2] + THROWN:
        sole, foot = choose_stance(phys, gait, k, True)
    stance, plan = gait.stance[k], gait.plan[k]
    ahead, sign = heading_frame(gait.heading[k]), observation.side_sign(stance)
    com, velocity, lift = vector_at(phys.com, k, 0), kinematics.com_velocity(phys, k), gait.height[k]
    height, _ = reach_height(phys, k, stance, sole, (foot[0], foot[1]), (0.0, 0.0), 0.0, s)
    lift[0], lift[1], lift[2] = swing.quintic_step(lift[0], lift[1], lift[2], height, 0.0, s.height_time, dt)
    lift[FLOOR] = sole[2]
    x, y = canonical(ahead, com[0] - sole[0], com[1] - sole[1])
    x -= plan[COP] + s.cmp_gain * plan[TRUNK]
    y -= sign * (plan[COP + 1] + s.cmp_gain * plan[TRUNK + 1])
    x, y = in_world(ahead, x, y)
    acceleration, waist = (s.omega**2 * x, s.omega**2 * y), (plan[TRUNK], -sign * plan[TRUNK + 1])
    pelvis = 0.5 * gait.yaw[k, swing.SWING], 0.0, 0.0
    task = Task(
        stance, acceleration, vector_of(lift, 0), (ahead.cos, ahead.sin), gait.swing[k], waist, ZERO, pelvis,
        (0.0, 0.0), (0.0, 0.0),
    )  # fmt: skip
    return torque_on_both_feet(phys, gait, k, task, velocity[2], 1.0, gains, both)


@njit(cache=True, inline="always")
def control(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, gains: Gains, bounds: Bounds, both: Bounds,
    landing: Ints, dt: float,
) -> int:  # fmt: skip
    """One physics step's torques of one robot, written to phys.ctrl; returns the bounds met, as bits.

    `landing` (n,) keeps TOUCHDOWN_ERROR while the robot stands on a foot that landed off its plan.
    """
    aloft, flight = gait.elapsed[k] - s.double_support, gait.plan[k, DURATION] - s.double_support
    if has_landed(phys.load[k, 1 - gait.stance[k]], aloft, flight, s):
        landing[k] = landing_error(phys, gait, k)
        touch_down(phys, gait, k, s.double_support)
        if may_stand(phys, gait, k, s, both):
            gait.elapsed[k] = ON_BOTH_FEET
    if gait.elapsed[k] < 0.0:
        return stand(phys, gait, k, s, gains, both, dt)
    if s.double_support > 0.0 and not both_stand(gait.elapsed[k], s.double_support):
        # a plan of double support is held until the period ends
        for axis, half in enumerate((both.settings.cop_x_max, both.settings.cop_y_max)):
            gait.plan[k, COP + axis] = min(max(gait.plan[k, COP + axis], -half), half)
    met = walk(phys, gait, k, s, gains, bounds, both, dt) | landing[k]
    if gait.elapsed[k] > gait.plan[k, DURATION] + LANDED_LATE:
        met |= TOUCHDOWN_ERROR
    return met


@njit(cache=True, forceinline=True)
def pass_time(gait: Gait, k: int, dt: float) -> None:
    """Let one physics step go by."""
    if gait.elapsed[k] >= 0.0:
        gait.elapsed[k] += dt
    gait.time[k] += dt


@njit(cache=True)
def check_failure(phys: Physics, gait: Gait, k: int, s: GaitSettings) -> None:
    """Mark a robot that has fallen: CoM too low, or pelvis leaning by more than 60 degrees."""
    if gait.failure[k] != 0:
        return
    height = phys.com[k, 0, 2] - sole_position(phys, k, gait.stance[k])[2]
    if not np.isfinite(height):
        gait.failure[k] = NOT_FINITE
    elif height < LOWEST * s.com_height:
        gait.failure[k] = TOO_LOW
    elif phys.xmat[k, PELVIS, 8] < STEEPEST:
        gait.failure[k] = TILTED
