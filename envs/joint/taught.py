"""Bipeds under joint targets beside a planner that says what it would ask of the joints.

A planning period under joint targets, beside which a planner says what it would ask of the joints.

Robots do what `target_calls` does with their targets. A second gait machine, led by the planner's gaits, goes
with each of them: whole-body control finds its torques in every state that the robot comes to, and the target
that gives a torque tau under PD control is

    q + (d / k) qd + tau / k - q_0.

Its mean over the period is what a learner is shown. Where the planner `leads`, its torques move the robot.
The planner is a teacher who knows the true state; the robot is taken for the nominal one.

Bipeds under joint targets with a planner beside them, who says what it would ask: to learn from.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ...controllers.array_table import Floats2, Ints1, part_of
from ...controllers.estimation.observe import Contacts, observe
from ...controllers.jit import njit
from ...controllers.joint_control import (
    JOINT,
    Joints,
    count_effort,
    follow_contacts,
    follow_targets,
    to_canonical,
)
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.model.nominal_gait import NominalStart
from ...controllers.model.observation import OBSERVATION_SIZE, WORLD_SIZE
from ...controllers.policies.two_stage import make_policy
from ...controllers.whole_body.gait_machine import NOT_FINITE, Gait, accept, control, pass_time, resting_gait
from ...controllers.whole_body.kinematics import NU, NV, Array, Ints, Physics
from ..biped.core import BipedCore
from ..biped.period import Arena, PeriodCalls, bounds_of, gains_of, move, plant_of, settings_of
from ..episode.episodes import Mask, Period
from ..scenario.scenario import Scenario
from ..snapshot import Arrays, arrays_of
from .core import JointArena, JointCore, begin_targets, finish_targets
from .env import JointEpisodes

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


KEPT = 7  # impulse, time and velocity of `Contacts`


class Teacher(NamedTuple):
    """What the planner sees of n robots, and what it would ask of their joints."""

    seen: Floats2  # (n, 36) observation, by the teacher's own gait machine
    previous: Floats2  # (n, 7) its last action
    world: Floats2  # (n, 6) see `observe`
    contacts: Floats2  # (n, 7) of the period, which two observers need
    target: Floats2  # (n, 14) mean over the period, canonical at its beginning, in units of the action
    landing: Ints1  # (n,) see `control`
    leads: Ints1  # (n,) 1 where its own torques move the robot


_PARTS: Any = [*get_type_hints(JointArena).items(), ("walk", Gait), ("teacher", Teacher)]
TaughtArena: Any = NamedTuple("TaughtArena", _PARTS)


def make_teacher(n: int) -> Teacher:
    """Of n robots that have not begun."""
    return Teacher(
        seen=np.zeros((n, OBSERVATION_SIZE)), previous=np.zeros((n, GAIT_SIZE)),
        world=np.zeros((n, WORLD_SIZE)), contacts=np.zeros((n, KEPT)), target=np.zeros((n, NU)),
        landing=np.zeros(n, np.int64), leads=np.zeros(n, np.int64),
    )  # fmt: skip


@njit(cache=True, forceinline=True)
def add_target(phys: Physics, k: int, joints: Joints, share: float, own: Array) -> None:
    """Add the target (14,), own order, that gives the torques in `ctrl` of one of 1 / share physics steps."""
    for i in range(NU):
        if joints.largest[i] > 0.0:
            lead = phys.qvel[k, NV - NU + i] * joints.damping[i] + phys.ctrl[k, i]
            target = phys.qpos[k, JOINT + i] + lead / joints.stiffness[i] - joints.posture[i]
            own[i] += share * target / joints.reach[i]


@njit(cache=True, forceinline=True)
def keep_contacts(contacts: Contacts, k: int, kept: Array) -> None:
    """Note what the contacts gave robot k before an observer clears it."""
    for i in range(3):
        kept[i], kept[4 + i] = contacts.impulse[k, i], contacts.velocity[k, i]
    kept[3] = contacts.time[k]


@njit(cache=True, forceinline=True)
def give_contacts(contacts: Contacts, k: int, kept: Array) -> None:
    """Put it back for another observer."""
    for i in range(3):
        contacts.impulse[k, i], contacts.velocity[k, i] = kept[i], kept[4 + i]
    contacts.time[k] = kept[3]


@njit(cache=True, nogil=True)
def begin_taught(t: Ints, c: Array, gaits: Array, actions: Array, first: int, end: int) -> None:
    """Take over the planner's gaits (n, 7) and actions (n, 7), and the targets asked of the joints."""
    walk, teacher = part_of(t, TaughtArena, "walk"), part_of(t, TaughtArena, "teacher")
    settings = settings_of(c)
    begin_targets(t, c, gaits, actions, first, end)
    for k in range(first, end):
        accept(walk, k, settings, gaits[k], actions[k], teacher.previous[k])


@njit(cache=True, nogil=True)
def taught_steps(t: Ints, c: Array, steps: int, dt: float, first: int, end: int) -> None:
    """The planner's torques, PD control and physics of robots first..end-1; otherwise as `target_steps`."""
    plant, bounds, gains, settings = plant_of(t), bounds_of(t, c), gains_of(c), settings_of(c)
    phys, gait, joints = plant.physics, plant.gait, part_of(t, JointArena, "joints")
    walk, teacher = part_of(t, TaughtArena, "walk"), part_of(t, TaughtArena, "teacher")
    own = np.empty(NU)
    for k in range(first, end):
        if gait.failure[k] != 0:
            continue
        bounds.grip[0] = bounds.settings.friction
        own[:] = 0.0
        stance = gait.stance[k]
        for _ in range(steps):
            met = control(phys, walk, k, settings, gains, bounds, teacher.landing, dt)
            add_target(phys, k, joints, 1.0 / steps, own)
            follow_contacts(phys, gait, k, settings, joints)
            if teacher.leads[k] == 0:
                met = follow_targets(phys, k, joints, bounds)
            count_effort(phys, k, joints, 1.0 / steps)
            pass_time(walk, k, dt)
            if not move(plant, t, k, met, dt):
                break
        to_canonical(own, phys.mirror, stance, teacher.target[k])


@njit(cache=True, nogil=True)
def finish_taught(t: Ints, c: Array, first: int, end: int) -> None:
    """`finish_targets`, and the observation by the teacher's gait machine, of robots first..end-1."""
    walk, teacher = part_of(t, TaughtArena, "walk"), part_of(t, TaughtArena, "teacher")
    judged, gait, settings = part_of(t, Arena, "judged"), part_of(t, Arena, "gait"), settings_of(c)
    felt, exchange = part_of(t, Arena, "judged_contacts"), part_of(t, Arena, "exchange")
    for k in range(first, end):
        keep_contacts(felt, k, teacher.contacts[k])
    finish_targets(t, c, first, end)
    for k in range(first, end):
        if gait.failure[k] != NOT_FINITE:
            give_contacts(felt, k, teacher.contacts[k])
            walk.turn[k] = gait.turn[k]
            observe(
                judged, walk, k, felt, settings.mass, settings, exchange.command[k], teacher.previous[k],
                exchange.capture, teacher.seen[k], teacher.world[k],
            )  # fmt: skip


@njit(cache=True, nogil=True)
def whole_taught(
    t: Ints, c: Array, gaits: Array, actions: Array, steps: int, dt: float, first: int, end: int
) -> None:
    """A planning period of robots first..end-1, from targets and gaits to observations."""
    begin_taught(t, c, gaits, actions, first, end)
    taught_steps(t, c, steps, dt, first, end)
    finish_taught(t, c, first, end)


TAUGHT_CALLS = PeriodCalls(whole_taught, begin_taught, taught_steps, finish_taught)


class Beside(NamedTuple):
    """What goes with each robot beside its own state."""

    walk: Gait
    teacher: Teacher


class TaughtCore(JointCore):
    """n bipeds under joint targets, and beside each the planner's own gait machine."""

    calls: ClassVar[PeriodCalls] = TAUGHT_CALLS

    def _more_parts(self) -> Sequence[Any]:
        """Joints, the planner's gait machine and what the planner sees and asks."""
        if not hasattr(self, "teacher"):
            self.walk, self.teacher = resting_gait(self.n), make_teacher(self.n)
        return *super()._more_parts(), self.walk, self.teacher

    def more_arrays(self) -> Arrays:
        """Arrays of n robots beside the arena whose rows are state, by PART.FIELD."""
        return super().more_arrays() | arrays_of(Beside(self.walk, self.teacher), ())

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """As that of `JointCore`; the planner's gait machine begins where the robot's does."""
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

    def __init__(self, n: int, policy: str = "two-stage", **kwargs: Any):
        super().__init__(n, **kwargs)
        self.policy = policy
        self.planner = make_policy(policy, self.robot, self.limits, self.preset)
        self._plans = np.zeros((n, 7), np.float32)

    @property
    def targets(self) -> Array:
        """What the planner would have asked of the joints in the period before, (n, 14), in action units."""
        return self.core.teacher.target

    def lead(self, robots: Mask) -> None:
        """Let the planner's torques move these robots (n,), whatever is asked of their joints."""
        self.core.teacher.leads[:] = robots

    def step(self, actions: NDArray[np.float32]) -> Period:
        """As that of `JointEpisodes`, the planner's plan beside it."""
        core, rows = self.core, np.flatnonzero(self.failure() == 0)
        core.joints.asked[:] = actions
        if len(rows):
            self._plans[rows] = self.planner.predict(core.teacher.seen[rows])[0]
        core.step(self.limits.from_action(self._plans), self._plans.astype(np.float64))
        return self._end_period(core.gait.plan)
