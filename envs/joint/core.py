"""n bipeds whose joints are acted on: by targets, or by residuals on the torques of whole-body control.

Joint targets: PD control finds the torques, the contacts say where a step ends. A residual: the planner's
gait goes through gait machine and whole-body control as it does without one, and is added to their torques.
Either is an `Actuation` of the loop of any biped, with a part of its own beside the arena. What the torques
act on, and what judges the robots, is that of any biped.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np

from ...controllers import joint_control
from ...controllers.array_table import part_of
from ...controllers.jit import njit
from ...controllers.joint_control import JOINT, JOINT_OBSERVATION_SIZE, TARGET_REACH, Joints
from ...controllers.math3 import to_world, vector_at, vector_of
from ...controllers.model.nominal_gait import NominalStart
from ...controllers.model.observation import OBSERVATION_SIZE, WORLD_CMP, WORLD_COP
from ...controllers.model.robot import RobotModel
from ...controllers.settings import PlannerConfig
from ...controllers.whole_body.gait_machine import FLOOR, Gait
from ...controllers.whole_body.kinematics import NU, PELVIS, Array, Physics
from ...controllers.whole_body.limits import JOINT_TORQUE, LIMIT_NAMES
from ..biped import period
from ..biped.core import DEFAULT_PLANNER, BipedCore, BipedSettings
from ..biped.limits_record import LimitsReport
from ..biped.period import Actuation, Arena, Felt, Tables
from ..biped.posture import posture
from ..robots.compiled_robot import CompiledRobot
from ..scenario.scenario import Scenario

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

LEAST_FORCE = 1.0  # vertical force [N] below which the robot counts as in flight


class JointParts(NamedTuple):
    """Parts beside the arena of any biped."""

    joints: Joints


@njit(cache=True, forceinline=True)
def joints_of(t: Tables) -> Joints:
    """Read what is asked of the joints."""
    return part_of(t.own, JointParts, "joints")


@njit(cache=True, forceinline=True)
def hold_joints(t: Tables, k: int) -> bool:
    """Hold the action asked of the joints of robot k, in their own order from now on; False: it rests."""
    joints, gait = joints_of(t), part_of(t.arena, Arena, "gait")
    if gait.failure[k] != 0:
        return False
    joint_control.to_own(
        joints.asked[k], part_of(t.arena, Arena, "physics").mirror, gait.stance[k], joints.held[k]
    )
    joints.effort[k] = 0.0
    return True


@njit(cache=True)
def observe_joints_of(t: Tables, c: Array, k: int, planned: bool) -> None:
    """Joint observation of robot k; after that of the gait where a planner acts as well."""
    joints, exchange = joints_of(t), part_of(t.arena, Arena, "exchange")
    seen, known, out = exchange.observation[k], exchange.truth[k], joints.observation[k]
    if period.acts_on_sensors(t):
        known = part_of(t.arena, Arena, "sensed").observation[k]
    if planned:
        out[:OBSERVATION_SIZE] = seen
        out = out[OBSERVATION_SIZE:]
    phys, gait = part_of(t.arena, Arena, "physics"), part_of(t.arena, Arena, "gait")
    noise = joint_control.velocity_noise(seen, known)
    joint_control.observe_joints(
        phys, gait, k, period.settings_of(c), joints, exchange.command[k], noise, out
    )


@njit(cache=True)
def write_floor_points(judged: Physics, gait: Gait, k: int, force: Array, world: Array) -> None:
    """Write CoP and CMP of robot k, which no controller asks for a wrench, in the world, (6,) [m].

    In flight they stay as they are. With F and M the force and the moment of all contacts about the base's
    origin o, the moment about a point of the floor, dz from o, is vertical at

        o + ((dz F_x - M_y) / F_z, (dz F_y + M_x) / F_z, dz),

    and the CMP is where the line along F through the CoM meets the floor.

    Args:
        judged: true state of all robots.
        gait: of which the height of the floor.
        k: the robot.
        force: (20,) generalised forces of the contacts; of the base F in the world and M in its own axes.
        world: written.
    """
    if force[2] < LEAST_FORCE:
        return
    origin, com = vector_at(judged.xpos, k, PELVIS), vector_at(judged.com, k, 0)
    moment = to_world(judged.xmat, k, PELVIS, vector_of(force, 3))
    drop, fall = gait.height[k, FLOOR] - origin[2], gait.height[k, FLOOR] - com[2]
    world[WORLD_COP] = origin[0] + (drop * force[0] - moment[1]) / force[2]
    world[WORLD_COP + 1] = origin[1] + (drop * force[1] + moment[0]) / force[2]
    world[WORLD_CMP] = com[0] + fall * force[0] / force[2]
    world[WORLD_CMP + 1] = com[1] + fall * force[1] / force[2]


@njit(cache=True)
def begin_residual(t: Tables, c: Array, k: int, gait: Array, action: Array) -> None:
    """Hold the planner's gait (7,), its action (7,) and the residual of robot k."""
    hold_joints(t, k)
    period.accept_gait(t, c, k, gait, action)


@njit(cache=True)
def residual_torques(t: Tables, c: Array, k: int, share: float, dt: float) -> int:
    """Whole-body control of robot k, and what is added to its torques."""
    phys, joints, controller = part_of(t.arena, Arena, "physics"), joints_of(t), period.controller_of(t, c)
    met = period.gait_torques(t, c, k, share, dt)
    met |= joint_control.add_residual(phys, k, joints, controller.bounds)
    joint_control.count_effort(phys, k, joints, share)
    return met


@njit(cache=True)
def finish_residual(t: Tables, c: Array, k: int, felt: Felt) -> None:
    """Observe the joints of robot k after its gait."""
    observe_joints_of(t, c, k, True)


RESIDUAL = Actuation(begin_residual, residual_torques, finish_residual, period.control_robot)


@njit(cache=True)
def begin_targets(t: Tables, c: Array, k: int, gait: Array, action: Array) -> None:
    """Hold the joint targets of robot k; gait and action are nobody's."""
    if hold_joints(t, k):
        seen = part_of(t.arena, Arena, "exchange").observation[k]
        joint_control.hold_nominal(part_of(t.arena, Arena, "gait"), k, seen, joints_of(t).gait)


@njit(cache=True)
def target_torques(t: Tables, c: Array, k: int, share: float, dt: float) -> int:
    """PD control of robot k."""
    phys, joints, controller = part_of(t.arena, Arena, "physics"), joints_of(t), period.controller_of(t, c)
    joint_control.follow_contacts(phys, part_of(t.arena, Arena, "gait"), k, controller.settings, joints)
    met = joint_control.follow_targets(phys, k, joints, controller.bounds)
    joint_control.count_effort(phys, k, joints, share)
    return met


@njit(cache=True)
def finish_targets(t: Tables, c: Array, k: int, felt: Felt) -> None:
    """Points on the floor under robot k, and its joints."""
    force = part_of(t.arena, Arena, "judged_contacts").force[k]
    world = part_of(t.arena, Arena, "exchange").world[k]
    write_floor_points(part_of(t.arena, Arena, "judged"), part_of(t.arena, Arena, "gait"), k, force, world)
    observe_joints_of(t, c, k, False)


TARGETS = Actuation(begin_targets, target_torques, finish_targets)

TORQUE = LIMIT_NAMES[JOINT_TORQUE.bit_length() - 1]  # name of the limit


class JointCore(BipedCore):
    """n bipeds under joint targets (n, 14), which PD control turns into torques."""

    actuation: ClassVar[Actuation] = TARGETS
    observation_size: ClassVar[int] = JOINT_OBSERVATION_SIZE

    own: Any  # JointParts, or more of them

    @property
    def joints(self) -> Joints:
        """Actions asked of the joints, and the constants of their drives."""
        return self.own.joints

    @property
    def asked(self) -> Array:
        """Actions of the period, which the next one begins with, (n, joints) in [-1, 1]."""
        return self.joints.asked

    def _own_parts(self) -> Any:
        """Make the parts of robots whose joints have been asked for nothing yet."""
        return JointParts(self._make_joints())

    def _make_joints(self) -> Joints:
        largest, stiffness, damping = joint_control.joint_constants(self.body.motors)
        return Joints(
            asked=np.zeros((self.n, NU)), held=np.zeros((self.n, NU)), lifted=np.zeros(self.n, np.int64),
            air=np.zeros((self.n, 2), np.int64), effort=np.zeros(self.n),
            observation=np.zeros((self.n, self.observation_size)),
            posture=standing_posture(self.body, self.robot), reach=self._reach(largest), stiffness=stiffness,
            damping=damping, largest=largest,
            gait=joint_control.nominal_constants(self.robot, self._limits, 0.0),
        )  # fmt: skip

    def _reach(self, largest: Array) -> Array:
        """Reach (14,) of an action of 1: of targets, how far off the standing posture [rad]."""
        return np.where(largest > 0.0, TARGET_REACH, 0.0)

    def configure(self, settings: BipedSettings, planner: PlannerConfig = DEFAULT_PLANNER) -> None:
        """Set the constants as `BipedCore` does; the planner's delay of touchdown is the nominal gait's."""
        super().configure(settings, planner)
        self.joints.gait[:] = joint_control.nominal_constants(
            self.robot, self._limits, planner.touchdown_delay
        )

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Reset as `BipedCore` does; the joints have been asked for nothing yet."""
        joints = self.joints
        joints.asked[k] = joints.held[k] = joints.effort[k] = 0.0
        joints.lifted[k] = joints.air[k] = 0
        super().reset(k, scenario, start, gait, action)

    def limits_met(self, k: int) -> LimitsReport:
        """The torque limits that robot k has met since its first push began; there is no plan to meet any."""
        report = super().limits_met(k)
        return LimitsReport(*({key: v for key, v in part.items() if key == TORQUE} for part in report))


class JointResidualCore(JointCore):
    """n bipeds under gaits, with a residual (n, 14) on the torques that whole-body control finds for them."""

    actuation: ClassVar[Actuation] = RESIDUAL
    observation_size: ClassVar[int] = OBSERVATION_SIZE + JOINT_OBSERVATION_SIZE

    def _reach(self, largest: Array) -> Array:
        """Torque of a residual of 1 [N m], (14,): none until `scale_residual`."""
        return np.zeros(NU)

    def scale_residual(self, scale: float) -> None:
        """Set what a residual of 1 adds to each torque, as a share of the motor's largest."""
        self.joints.reach[:] = scale * self.joints.largest

    def limits_met(self, k: int) -> LimitsReport:
        """The limits that robot k has met since its first push began, those of its planner among them."""
        return BipedCore.limits_met(self, k)


def standing_posture(body: CompiledRobot, robot: RobotModel) -> Array:
    """Joint angles (14,) [rad], in the order of control, of a robot that stands on both feet.

    The CoM is at its height in the gait; the feet are l_p apart and level, pelvis and trunk upright.
    """
    half = 0.5 * robot.pelvis_width
    soles = np.array([[0.0, half, 0.0], [0.0, -half, 0.0]])
    qpos, _ = posture(body, np.array([0.0, 0.0, robot.com_height]), np.zeros(3), soles)
    own = np.array(body.indices.qpos[JOINT:])
    return np.where(own < 0, 0.0, qpos[own])
