"""n bipeds whose joints are acted on: targets, or residuals on the torques of whole-body control.

What actions on the joints add to the arena of bipeds: a part of the address table, and its two uses.

CoP and CMP of a robot that no controller asks for a wrench: from the forces that the floor gives it.

A planning period under a residual on joint torques: whole-body control finds them, the residual is added.

The planner's gait goes through gait machine and whole-body control as it does without a residual.

A planning period under joint targets: PD control finds the torques, the contacts say where a step ends.

What the torques act on is that of any biped (`biped.period.move`), and so is what judges it.

n bipeds whose joints are acted on: what `BipedCore` has, and who turns those actions into torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, get_type_hints

import numpy as np

from ...controllers.array_table import part_of
from ...controllers.jit import njit
from ...controllers.joint_control import (
    JOINT,
    JOINT_OBSERVATION_SIZE,
    TARGET_REACH,
    Joints,
    add_residual,
    count_effort,
    follow_contacts,
    follow_targets,
    hold_nominal,
    joint_constants,
    nominal_constants,
    observe_joints,
    to_own,
    velocity_noise,
)
from ...controllers.math3 import to_world, vector_at, vector_of
from ...controllers.model.nominal_gait import NominalStart
from ...controllers.model.observation import OBSERVATION_SIZE, WORLD_CMP, WORLD_COP
from ...controllers.model.robot import RobotModel
from ...controllers.settings import PlannerConfig
from ...controllers.whole_body.gait_machine import FLOOR, NOT_FINITE, Gait, GaitSettings, control
from ...controllers.whole_body.inverse_dynamics import Gains
from ...controllers.whole_body.kinematics import NU, PELVIS, Array, Ints, Physics
from ...controllers.whole_body.limits import BOUNDS, JOINT_TORQUE, BoundSettings
from ..biped.core import DEFAULT_PLANNER, BipedCore
from ..biped.limits_record import BoundsReport
from ..biped.period import (
    Arena,
    PeriodCalls,
    begin_period,
    bounds_of,
    finish_period,
    gains_of,
    move,
    plant_of,
    settings_of,
)
from ..biped.posture import posture
from ..robots.compiled_robot import CompiledRobot
from ..scenario.scenario import Scenario
from ..snapshot import Arrays, arrays_of

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


# The arena of any biped, and after it what is asked of the joints.
_PARTS: Any = [*get_type_hints(Arena).items(), ("joints", Joints)]
JointArena: Any = NamedTuple("JointArena", _PARTS)


@njit(cache=True)
def take_over(t: Ints, first: int, end: int) -> None:
    """Hold the actions asked of the joints of robots first..end-1, in their own order from now on."""
    joints, gait = part_of(t, JointArena, "joints"), part_of(t, Arena, "gait")
    mirror = part_of(t, Arena, "physics").mirror
    for k in range(first, end):
        if gait.failure[k] == 0:
            to_own(joints.asked[k], mirror, gait.stance[k], joints.held[k])
            joints.effort[k] = 0.0


@njit(cache=True)
def observe_all(t: Ints, c: Array, first: int, end: int, planned: bool) -> None:
    """Joint observations of robots first..end-1; after that of the gait where a planner acts as well.

    One whose state is not finite keeps the observation that it had.
    """
    phys, gait, settings = part_of(t, Arena, "physics"), part_of(t, Arena, "gait"), settings_of(c)
    joints, exchange = part_of(t, JointArena, "joints"), part_of(t, Arena, "exchange")
    known = part_of(t, Arena, "shown").observation
    for k in range(first, end):
        if gait.failure[k] == NOT_FINITE:
            continue
        seen, out = exchange.observation[k], joints.observation[k]
        if planned:
            out[:OBSERVATION_SIZE] = seen
            out = out[OBSERVATION_SIZE:]
        noise = velocity_noise(seen, known[k])
        observe_joints(phys, gait, k, settings, joints, exchange.command[k], noise, out)


LEAST = 1.0  # vertical force [N] below which the robot counts as in flight


@njit(cache=True)
def write_floor_points(judged: Physics, gait: Gait, k: int, force: Array, world: Array) -> None:
    """Write CoP and CMP of robot k in the world, (6,) [m]; in flight they stay as they are.

    With F and M the force and the moment of all contacts about the base's origin o, the moment about a point
    of the floor, dz from o, is vertical at

        o + ((dz F_x - M_y) / F_z, (dz F_y + M_x) / F_z, dz),

    and the CMP is where the line along F through the CoM meets the floor.

    Args:
        judged: true state of all robots.
        gait: of which the height of the floor.
        k: the robot.
        force: (20,) generalised forces of the contacts; of the base F in the world and M in its own axes.
        world: written.
    """
    if force[2] < LEAST:
        return
    origin, com = vector_at(judged.xpos, k, PELVIS), vector_at(judged.com, k, 0)
    moment = to_world(judged.xmat, k, PELVIS, vector_of(force, 3))
    drop, fall = gait.height[k, FLOOR] - origin[2], gait.height[k, FLOOR] - com[2]
    world[WORLD_COP] = origin[0] + (drop * force[0] - moment[1]) / force[2]
    world[WORLD_COP + 1] = origin[1] + (drop * force[1] + moment[0]) / force[2]
    world[WORLD_CMP] = com[0] + fall * force[0] / force[2]
    world[WORLD_CMP + 1] = com[1] + fall * force[1] / force[2]


# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


@njit(cache=True, nogil=True)
def begin_residual(t: Ints, c: Array, gaits: Array, actions: Array, first: int, end: int) -> None:
    """Take over the planner's gaits (n, 7) and actions (n, 7), and the residuals, of robots first..end-1."""
    take_over(t, first, end)
    begin_period(t, c, gaits, actions, first, end)


@njit(cache=True, nogil=True)
def residual_steps(t: Ints, c: Array, steps: int, dt: float, first: int, end: int) -> None:
    """Whole-body control, what is added to it, and physics of robots first..end-1; as `physics_steps`."""
    plant, bounds, gains, settings = plant_of(t), bounds_of(t, c), gains_of(c), settings_of(c)
    phys, gait, record, joints = plant.physics, plant.gait, plant.met, part_of(t, JointArena, "joints")
    for k in range(first, end):
        if gait.failure[k] != 0:
            continue
        bounds.grip[0] = plant.known.grip[k]
        for _ in range(steps):
            met = control(phys, gait, k, settings, gains, bounds, record.landing, dt) | record.plan[k]
            met |= add_residual(phys, k, joints, bounds)
            count_effort(phys, k, joints, 1.0 / steps)
            if not move(plant, t, k, met, dt):
                break


@njit(cache=True, nogil=True)
def finish_residual(t: Ints, c: Array, first: int, end: int) -> None:
    """`finish_period` and both observations of robots first..end-1."""
    finish_period(t, c, first, end)
    observe_all(t, c, first, end, True)


@njit(cache=True, nogil=True)
def whole_residual(
    t: Ints, c: Array, gaits: Array, actions: Array, steps: int, dt: float, first: int, end: int
) -> None:
    """A planning period of robots first..end-1 under gaits and a residual on their torques."""
    begin_residual(t, c, gaits, actions, first, end)
    residual_steps(t, c, steps, dt, first, end)
    finish_residual(t, c, first, end)


RESIDUAL_CALLS = PeriodCalls(whole_residual, begin_residual, residual_steps, finish_residual)


# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


@njit(cache=True, nogil=True)
def begin_targets(t: Ints, c: Array, gaits: Array, actions: Array, first: int, end: int) -> None:
    """Take over joint targets of robots first..end-1; `gaits` and `actions` are nobody's."""
    joints, seen = part_of(t, JointArena, "joints"), part_of(t, Arena, "exchange").observation
    gait, errors = part_of(t, Arena, "gait"), part_of(t, Arena, "errors")
    take_over(t, first, end)
    for k in range(first, end):
        if gait.failure[k] == 0:
            errors.period[k] += 1
            hold_nominal(gait, k, seen[k], joints.gait)


@njit(cache=True, nogil=True)
def target_steps(t: Ints, c: Array, steps: int, dt: float, first: int, end: int) -> None:
    """PD control and physics of robots first..end-1; otherwise as `physics_steps`."""
    plant, bounds, settings = plant_of(t), bounds_of(t, c), settings_of(c)
    phys, gait, joints = plant.physics, plant.gait, part_of(t, JointArena, "joints")
    for k in range(first, end):
        if gait.failure[k] != 0:
            continue
        for _ in range(steps):
            follow_contacts(phys, gait, k, settings, joints)
            met = follow_targets(phys, k, joints, bounds)
            count_effort(phys, k, joints, 1.0 / steps)
            if not move(plant, t, k, met, dt):
                break


@njit(cache=True, nogil=True)
def finish_targets(t: Ints, c: Array, first: int, end: int) -> None:
    """`finish_period`, points on the floor and joint observations of robots first..end-1."""
    judged, gait = part_of(t, Arena, "judged"), part_of(t, Arena, "gait")
    felt, world = part_of(t, Arena, "judged_contacts"), part_of(t, Arena, "exchange").world
    finish_period(t, c, first, end)
    for k in range(first, end):
        if gait.failure[k] != NOT_FINITE:
            write_floor_points(judged, gait, k, felt.force[k], world[k])
    observe_all(t, c, first, end, False)


@njit(cache=True, nogil=True)
def whole_targets(
    t: Ints, c: Array, gaits: Array, actions: Array, steps: int, dt: float, first: int, end: int
) -> None:
    """A planning period of robots first..end-1, from their targets to their observations."""
    begin_targets(t, c, gaits, actions, first, end)
    target_steps(t, c, steps, dt, first, end)
    finish_targets(t, c, first, end)


TARGET_CALLS = PeriodCalls(whole_targets, begin_targets, target_steps, finish_targets)


TORQUE = BOUNDS[JOINT_TORQUE.bit_length() - 1]  # name of the bound
COMMON = {f"joints.{name}" for name in ("posture", "reach", "stiffness", "damping", "largest", "gait")}


class OnJoints(NamedTuple):
    """What robots have whose joints are acted on, besides the arena of any biped."""

    joints: Joints


class JointCore(BipedCore):
    """n bipeds under joint targets (n, 14), which PD control turns into torques."""

    calls: ClassVar[PeriodCalls] = TARGET_CALLS
    observation_size: ClassVar[int] = JOINT_OBSERVATION_SIZE

    def _more_parts(self) -> Sequence[Any]:
        """What is asked of the joints; made before the first address table, in which it lies last."""
        if not hasattr(self, "joints"):
            self.joints = self._make_joints()
        return (self.joints,)

    def _make_joints(self) -> Joints:
        largest, stiffness, damping = joint_constants(self.body.motors)
        return Joints(
            asked=np.zeros((self.n, NU)), held=np.zeros((self.n, NU)), lifted=np.zeros(self.n, np.int64),
            air=np.zeros((self.n, 2), np.int64), effort=np.zeros(self.n),
            observation=np.zeros((self.n, self.observation_size)),
            posture=standing_posture(self.body, self.robot), reach=self._reach(largest), stiffness=stiffness,
            damping=damping, largest=largest, gait=nominal_constants(self.robot, self._limits, 0.0),
        )  # fmt: skip

    def _reach(self, largest: Array) -> Array:
        """What an action of 1 asks of each joint, (14,): of targets, how far off the standing posture."""
        return np.where(largest > 0.0, TARGET_REACH, 0.0)

    def more_arrays(self) -> Arrays:
        """Arrays of n robots beside the arena whose rows are state, by PART.FIELD."""
        return arrays_of(OnJoints(self.joints), COMMON)

    def more_settings(self) -> bytes:
        """What all robots have in common, beside that of any biped."""
        found = arrays_of(OnJoints(self.joints), ())
        return b"".join(found[name].tobytes() for name in sorted(COMMON))

    def configure(
        self,
        settings: GaitSettings,
        gains: Gains,
        bounds: BoundSettings,
        planner: PlannerConfig = DEFAULT_PLANNER,
    ) -> None:
        """As that of `BipedCore`; the planner's delay of touchdown is the nominal gait's."""
        super().configure(settings, gains, bounds, planner)
        self.joints.gait[:] = nominal_constants(self.robot, self._limits, planner.touchdown_delay)

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """As that of `BipedCore`; the joints have been asked for nothing yet."""
        joints = self.joints
        joints.asked[k] = joints.held[k] = joints.effort[k] = 0.0
        joints.lifted[k] = joints.air[k] = 0
        super().reset(k, scenario, start, gait, action)

    def bounds_met(self, k: int) -> BoundsReport:
        """The torque limits that robot k has met since its first push began; there is no plan to meet any."""
        report = super().bounds_met(k)
        return BoundsReport(*({key: v for key, v in part.items() if key == TORQUE} for part in report))


class JointResidualCore(JointCore):
    """n bipeds under gaits, with a residual (n, 14) on the torques that whole-body control finds for them."""

    calls: ClassVar[PeriodCalls] = RESIDUAL_CALLS
    observation_size: ClassVar[int] = OBSERVATION_SIZE + JOINT_OBSERVATION_SIZE

    def _reach(self, largest: Array) -> Array:
        """Torque of a residual of 1 [N m], (14,): none until `scale_residual`."""
        return np.zeros(NU)

    def scale_residual(self, scale: float) -> None:
        """Set what a residual of 1 adds to each torque, as a share of the motor's largest."""
        self.joints.reach[:] = scale * self.joints.largest

    def bounds_met(self, k: int) -> BoundsReport:
        """The limits that robot k has met since its first push began, those of its planner among them."""
        return BipedCore.bounds_met(self, k)


def standing_posture(body: CompiledRobot, robot: RobotModel) -> Array:
    """Joint angles (14,) [rad], in the order of control, of a robot that stands on both feet.

    The CoM is at its height in the gait; the feet are l_p apart and level, pelvis and trunk upright.
    """
    half = 0.5 * robot.pelvis_width
    soles = np.array([[0.0, half, 0.0], [0.0, -half, 0.0]])
    qpos, _ = posture(body, np.array([0.0, 0.0, robot.com_height]), np.zeros(3), soles)
    own = np.array(body.indices.qpos[JOINT:])
    return np.where(own < 0, 0.0, qpos[own])
