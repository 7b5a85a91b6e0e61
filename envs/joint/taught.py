"""Bipeds under joint targets beside a planner that says what it would ask of the joints: to learn from.

Robots do what `core` does with their targets. A second gait machine, led by the planner's gaits, goes with
each of them: whole-body control finds its torques in every state that the robot comes to, and the target that
gives a torque tau under PD control is

    q + (d / k) qd + tau / k - q_0.

Its mean over the period is what a learner is shown. Where the planner `leads`, its torques move the robot.
The planner is a teacher who knows the true state; the robot is taken for the nominal one.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers import joint_control
from ...controllers.array_table import Floats2, Ints1, first_rows, part_of
from ...controllers.estimation.observe import observe
from ...controllers.jit import njit
from ...controllers.joint_control import Joints
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.model.nominal_gait import NominalStart
from ...controllers.model.observation import OBSERVATION_SIZE, WORLD_SIZE
from ...controllers.policies.two_stage import make_policy
from ...controllers.whole_body.gait_machine import Gait, accept, pass_time, resting_gait
from ...controllers.whole_body.kinematics import NU, NV, Array, Physics
from ..biped.core import BipedCore
from ..biped.env import BipedConfig
from ..biped.period import (
    CONTROL,
    Actuation,
    Arena,
    Felt,
    Tables,
    call_control,
    control_robot,
    controller_of,
    settings_of,
)
from ..episode.episodes import Mask, Period
from ..scenario.scenario import Scenario
from .core import JointCore, begin_targets, finish_targets
from .env import JointEpisodes

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


class Teacher(NamedTuple):
    """The planner beside n robots: its observation of them, and what it would ask of their joints."""

    seen: Floats2  # (n, 36) observation, by the teacher's own gait machine
    previous: Floats2  # (n, 7) its last action
    world: Floats2  # (n, 6) see `observe`
    target: Floats2  # (n, 14) mean over the period, canonical at its beginning, in units of the action
    side: Ints1  # (n,) stance side at the beginning of the period
    landing: Ints1  # (n,) see `control`
    leads: Ints1  # (n,) 1 where its own torques move the robot


class TaughtParts(NamedTuple):
    """`JointParts`, the planner's gait machine and what the planner sees and asks."""

    joints: Joints
    walk: Gait
    teacher: Teacher


_WALK = first_rows(TaughtParts)["walk"]


@njit(cache=True, forceinline=True)
def taught_parts_of(t: Tables) -> TaughtParts:
    """The parts beside the arena."""
    own = t.own
    return TaughtParts(
        part_of(own, TaughtParts, "joints"), part_of(own, TaughtParts, "walk"),
        part_of(own, TaughtParts, "teacher"),
    )  # fmt: skip


@njit(cache=True, forceinline=True)
def add_target(phys: Physics, k: int, joints: Joints, share: float, side: int, asked: Array) -> None:
    """Add the target that gives the torques in `ctrl` of one of 1 / share physics steps to `asked` (14,).

    `asked` is canonical for a robot that stands on side `side`.
    """
    for c in range(NU):
        i = joint_control.own_joint(c, side)
        if joints.largest[i] > 0.0:
            lead = phys.qvel[k, NV - NU + i] * joints.damping[i] + phys.ctrl[k, i]
            target = phys.qpos[k, joint_control.JOINT + i] + lead / joints.stiffness[i] - joints.posture[i]
            asked[c] += joint_control.joint_sign(phys.mirror, i, side) * (share * target / joints.reach[i])


@njit(cache=True)
def begin_taught(t: Tables, c: Array, k: int, gait: Array, action: Array) -> None:
    """Hold the planner's gait (7,), its action (7,), and the targets asked of the joints of robot k."""
    _, walk, teacher = taught_parts_of(t)
    begin_targets(t, c, k, gait, action)
    accept(walk, k, settings_of(c), gait, action, teacher.previous[k])
    robot = part_of(t.arena, Arena, "gait")
    if robot.failure[k] == 0:
        teacher.side[k], teacher.target[k] = robot.stance[k], 0.0


@njit(cache=True)
def taught_torques(t: Tables, c: Array, k: int, share: float, dt: float) -> int:
    """PD control of robot k beside the planner's torques, which move it where the planner leads."""
    (joints, walk, teacher), (settings, _, bounds, _) = taught_parts_of(t), controller_of(t, c)
    phys, control = part_of(t.arena, Arena, "physics"), part_of(t.arena, Arena, "calls").at[CONTROL]
    bounds.grip[0] = bounds.settings.friction
    met = call_control(control, t, c, t.own[_WALK:], teacher.landing, k, dt)
    add_target(phys, k, joints, share, teacher.side[k], teacher.target[k])
    joint_control.follow_contacts(phys, part_of(t.arena, Arena, "gait"), k, settings, joints)
    if teacher.leads[k] == 0:
        met = joint_control.follow_targets(phys, k, joints, bounds)
    joint_control.count_effort(phys, k, joints, share)
    pass_time(walk, k, dt)
    return met


@njit(cache=True)
def finish_taught(t: Tables, c: Array, k: int, felt: Felt) -> None:
    """Observe robot k as under targets, and by the planner's own gait machine."""
    _, walk, teacher = taught_parts_of(t)
    settings, exchange = settings_of(c), part_of(t.arena, Arena, "exchange")
    contacts = part_of(t.arena, Arena, "judged_contacts")
    finish_targets(t, c, k, felt)
    for i in range(3):  # which the observation of the robot has cleared
        contacts.impulse[k, i], contacts.velocity[k, i] = felt.impulse[i], felt.velocity[i]
    contacts.time[k] = felt.time
    walk.turn[k] = part_of(t.arena, Arena, "gait").turn[k]
    observe(
        part_of(t.arena, Arena, "judged"), walk, k, contacts, settings.mass, settings, exchange.command[k],
        teacher.previous[k], exchange.capture, teacher.seen[k], teacher.world[k],
    )  # fmt: skip


TAUGHT = Actuation(begin_taught, taught_torques, finish_taught, control_robot)


class TaughtCore(JointCore):
    """n bipeds under joint targets, and beside each the planner's own gait machine."""

    actuation: ClassVar[Actuation] = TAUGHT

    @property
    def walk(self) -> Gait:
        """The planner's gait machines."""
        return self.own.walk

    @property
    def teacher(self) -> Teacher:
        """The planner's observation, and what it asks."""
        return self.own.teacher

    def _own_parts(self) -> TaughtParts:
        n = self.n
        teacher = Teacher(
            seen=np.zeros((n, OBSERVATION_SIZE)), previous=np.zeros((n, GAIT_SIZE)),
            world=np.zeros((n, WORLD_SIZE)), target=np.zeros((n, NU)), side=np.zeros(n, np.int64),
            landing=np.zeros(n, np.int64), leads=np.zeros(n, np.int64),
        )  # fmt: skip
        return TaughtParts(*super()._own_parts(), resting_gait(n), teacher)

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Reset as `JointCore` does; the planner's gait machine begins where the robot's does."""
        for field in self.walk:
            field[k] = 0
        super().reset(k, scenario, start, gait, action)
        for field, own in zip(self.walk, self.gait, strict=True):
            field[k] = own[k]
        self.teacher.landing[k] = self.teacher.leads[k] = 0
        self.teacher.previous[k] = self.previous_action[k]
        self.teacher.seen[k] = self.truth[k]


class TaughtEpisodes(JointEpisodes):
    """Episodes of n bipeds under joint targets, and after each period what a planner would have asked.

    Its whole-body control finds torques in every state that the robots come to; `targets` gives the same
    torques in the mean of the period. A learner that is asked to come close to them in the states that its
    own actions lead to is taught by DAgger (Ross, Gordon, Bagnell, AISTATS 2011).
    """

    name = "PushRecovery/BipedJoint-v0 with a planner beside it"
    core_of: ClassVar[type[BipedCore]] = TaughtCore
    core: Any  # a TaughtCore

    def __init__(
        self,
        n: int,
        config: BipedConfig | None = None,
        threads: int = 1,
        policy: str = "two-stage",
        **changes: Any,
    ):
        """Build the robots, see `BipedEpisodes`, beside the planner of the name `policy`."""
        super().__init__(n, config, threads, **changes)
        self.policy = policy
        self.planner = make_policy(policy, self.robot, self.limits, self.preset)
        self._plans = np.zeros((n, GAIT_SIZE), np.float32)

    def _options(self) -> dict[str, Any]:
        return {"policy": self.policy}

    @property
    def targets(self) -> Array:
        """Joint targets (n, 14) that the planner would have asked for in the last period, in action units."""
        return self.core.teacher.target

    def lead(self, robots: Mask) -> None:
        """Let the planner's torques move these robots (n,), whatever is asked of their joints."""
        self.core.teacher.leads[:] = robots

    def step(self, actions: NDArray[np.float32]) -> Period:
        """One planning period under targets (n, 14), the planner's plan beside it."""
        core, rows = self.core, np.flatnonzero(self.failure() == 0)
        core.joints.asked[:] = actions
        if len(rows):
            self._plans[rows] = self.planner.predict(core.teacher.seen[rows])[0]
        core.step(self.limits.from_action(self._plans), self._plans.astype(np.float64))
        return self._end_period(core.gait.plan)
