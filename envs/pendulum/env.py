"""`PushRecovery/Pendulum-v0`: the paper's linear inverted pendulum with flywheel as an environment.

`observe` and `check_failures` make a pendulum's observation, its capture margin and its falls; `PendulumCore`
is what episodes need of n of them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.jit import njit
from ...controllers.model import capturability
from ...controllers.model import observation as layout
from ...controllers.model.gait_box import DURATION, GAIT_SIZE, STEP, GaitLimits
from ...controllers.model.nominal_gait import NominalStart, both_stand, check_double_support
from ...controllers.model.robot import RobotModel
from ...controllers.model.standing import margin_on_both_feet
from ...controllers.validation import require_kind
from ...controllers.whole_body.swing import COMMAND_SIZE
from ..episode.episodes import GaitEpisodes, Ints
from ..episode.gym_env import GaitEnv
from ..episode.period_end import Motion
from ..episode.vector_env import vector_maker
from ..scenario.arrays import (
    NUMBERS,
    assign_changes,
    assign_pushes,
    command_row,
    empty_pushes,
    empty_schedule,
    follow_all,
)
from ..scenario.distribution import PushDistribution
from ..scenario.push import SIDES
from ..scenario.scenario import Scenario
from . import dynamics

_DCM, _COM, _VELOCITY = layout.DCM.start, layout.COM.start, layout.COM_VELOCITY.start
_SWING, _SWING_VELOCITY = layout.SWING_POSITION.start, layout.SWING_VELOCITY.start
_ANGLE, _RATE, _PUSH = layout.TRUNK_ANGLE.start, layout.TRUNK_RATE.start, layout.PUSH_ESTIMATE.start
_COMMAND, _PREVIOUS = layout.COMMAND.start, layout.PREVIOUS_ACTION.start

Array = NDArray[np.float64]
BEYOND = 0.1  # a fall is certain this far outside what can be recovered from [m]
APEX = 0.06  # height of the swing foot in mid-step [m]


@njit(cache=True)
def observe(s, command, previous, p, out, world, first, end):  # pragma: no cover
    """Observations (n, 36) of pendulums first..end-1, canonical frame.

    Writes DCM, CoP and CMP in the world (n, 6) [m], too. The swing foot moves on a quintic of single
    support's phase.
    """
    for k in range(first, end):
        o = out[k]
        o[:] = 0.0
        stands = s.standing[k] != 0
        elapsed = layout.ON_BOTH_FEET if stands else s.time[k] - s.step_start[k]
        swing = s.plan[k, DURATION] - p.double_support
        phase = min(max(elapsed - p.double_support, 0.0) / swing, 1.0)
        blend = phase**3 * (10.0 - 15.0 * phase + 6.0 * phase * phase)
        pace = 30.0 * (phase * (1.0 - phase)) ** 2 / swing
        o[layout.ELAPSED] = elapsed
        for axis in range(2):
            sign = layout.side_sign(s.side[k]) if axis == 1 else 1.0
            o[_COM + axis] = sign * (s.com[k, axis] - s.stance[k, axis])
            o[_VELOCITY + axis] = sign * s.velocity[k, axis]
            o[_DCM + axis] = o[_COM + axis] + o[_VELOCITY + axis] / p.omega
            lift = sign * (s.lift[k, axis] - s.stance[k, axis])
            o[_SWING + axis] = lift + blend * (s.plan[k, STEP + axis] - lift)
            o[_SWING_VELOCITY + axis] = pace * (s.plan[k, STEP + axis] - lift)
            o[_ANGLE + axis] = sign * s.angle[k, axis]
            o[_RATE + axis] = sign * s.rate[k, axis]
            o[_COMMAND + axis] = sign * command[k, axis]
            o[_PUSH + axis] = sign * s.push[k, axis]
            world[k, layout.WORLD_DCM + axis] = s.com[k, axis] + s.velocity[k, axis] / p.omega
            world[k, layout.WORLD_COP + axis] = s.cop[k, axis]
            world[k, layout.WORLD_CMP + axis] = s.cmp[k, axis]
        o[_SWING + 2] = APEX * 16.0 * (phase * (1.0 - phase)) ** 2
        o[_SWING_VELOCITY + 2] = APEX * 32.0 * phase * (1.0 - phase) * (1.0 - 2.0 * phase) / swing
        o[layout.STANCE_CONTACT] = 1.0
        o[layout.SWING_CONTACT] = 1.0 if elapsed == 0.0 or both_stand(elapsed, p.double_support) else 0.0
        for i in range(previous.shape[1]):
            o[_PREVIOUS + i] = previous[k, i]


@njit(cache=True)
def margin_of(o, elapsed, double_support, constants):  # pragma: no cover
    """Capture margin of an observation (36,) as if `elapsed` had passed since the step began [m]."""
    dcm, angle, rate = o[_DCM : _DCM + 2], o[_ANGLE : _ANGLE + 2], o[_RATE : _RATE + 2]
    left = double_support - o[layout.ELAPSED] if both_stand(o[layout.ELAPSED], double_support) else 0.0
    other = o[_SWING : _SWING + 2]
    return capturability.transfer_margin_kernel(elapsed, left, other, dcm, angle, rate, constants)


@njit(cache=True)
def margin_of_standing(o, constants):  # pragma: no cover
    """`margin_on_both_feet` of the observation (36,) of a standing robot [m]."""
    other, dcm = o[_SWING : _SWING + 2], o[_DCM : _DCM + 2]
    return margin_on_both_feet(other, dcm, o[_ANGLE : _ANGLE + 2], o[_RATE : _RATE + 2], constants)


@njit(cache=True)
def check_failures(s, observation, double_support, constants, margins, first, end):  # pragma: no cover
    """Capture margins (n,) [m] of pendulums first..end-1, and those that not even a step now could save."""
    for k in range(first, end):
        o = observation[k]
        if o[layout.ELAPSED] < 0.0:
            margins[k] = margin_of_standing(o, constants)
            if s.failure[k] == 0 and not margins[k] > -BEYOND:
                s.failure[k] = dynamics.DIVERGED if math.isfinite(margins[k]) else dynamics.NOT_FINITE
            continue
        margins[k] = margin_of(o, o[layout.ELAPSED], double_support, constants)
        if s.failure[k] != 0:
            continue
        if not (math.isfinite(o[_DCM]) and math.isfinite(o[_DCM + 1])):
            s.failure[k] = dynamics.NOT_FINITE
        elif margin_of(o, 1e3, double_support, constants) < -BEYOND:
            s.failure[k] = dynamics.DIVERGED


class PendulumCore:
    """n pendulums; arrays are indexed by pendulum, and none depends on another."""

    def __init__(
        self,
        n: int,
        robot: RobotModel,
        limits: GaitLimits,
        control_hz: float = 100.0,
        double_support: float = 0.0,
    ):
        check_double_support(double_support, limits)
        self.n, self.robot, self.limits, self.dt = n, robot, limits, 1.0 / control_hz
        self.physics = dynamics.Physics(
            robot.omega, robot.mass, robot.cmp_per_trunk_acceleration, robot.foot_length / 2,
            robot.foot_width / 2, robot.trunk_torque_max / robot.trunk_inertia, robot.trunk_angle_max,
            double_support, robot.pelvis_width, limits.duration_max,
        )  # fmt: skip
        self.capture = capturability.capture_constants(robot, limits)
        self.state = dynamics.Pendulums(
            com=np.zeros((n, 2)), velocity=np.zeros((n, 2)), angle=np.zeros((n, 2)), rate=np.zeros((n, 2)),
            stance=np.zeros((n, 2)), lift=np.zeros((n, 2)), plan=np.zeros((n, GAIT_SIZE)),
            cop=np.zeros((n, 2)), cmp=np.zeros((n, 2)), push=np.zeros((n, 2)),
            time=np.zeros(n), step_start=np.zeros(n), side=np.zeros(n, np.int64),
            steps=np.zeros(n, np.int64), failure=np.zeros(n, np.int64), heading=np.zeros(n),
            standing=np.zeros(n, np.int64),
        )  # fmt: skip
        self.state.plan[:, DURATION] = limits.duration_max  # of pendulums that have not been reset
        self.pushes = empty_pushes(n, 1)
        self.schedule, self.command = empty_schedule(n), np.zeros((n, COMMAND_SIZE))  # to come, in force
        self.previous_action = np.zeros((n, GAIT_SIZE))
        self.observation = np.zeros((n, layout.OBSERVATION_SIZE))
        self.truth = np.zeros((n, layout.OBSERVATION_SIZE))  # observation without its noise, to judge by
        self.errors = dynamics.no_errors(n, self.dt)
        self.margin = np.zeros(n)
        self.world = np.zeros((n, layout.WORLD_SIZE))  # DCM, CoP and CMP in the world [m]

    def assign(self, k: int, scenario: Scenario) -> None:
        """Give pendulum k the errors, the pushes and the changes of command of a scenario."""
        dynamics.assign_errors(self.errors, k, scenario, self.dt)
        bodies = {push.body: NUMBERS["pelvis"] for push in scenario.forces} | NUMBERS  # which does not matter
        self.pushes = assign_pushes(self.pushes, k, scenario, bodies)
        self.schedule = assign_changes(self.schedule, k, scenario)

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Put pendulum k at the start of a step; `gait` (7,) and `action` (7,) are the nominal ones."""
        self.assign(k, scenario)
        s = self.state
        for field in s:
            field[k] = 0
        s.side[k] = SIDES.index(scenario.stance_side)
        sign = layout.side_sign(s.side[k])
        (x, y), lean = scenario.start.com, scenario.start.lean
        s.com[k], s.angle[k] = (start.com[0] + x, sign * start.com[1] + y), lean
        s.velocity[k] = start.com_velocity[0], sign * start.com_velocity[1]
        s.lift[k] = start.swing[0], sign * start.swing[1]
        s.plan[k] = gait
        s.standing[k] = scenario.command.stand
        self.command[k], self.previous_action[k] = command_row(scenario.command), action
        self._look(k, k + 1)

    def step(self, gaits: Array, actions: Array) -> None:
        """Hold gait variables (n, 7) for one control cycle; `actions` (n, 7) go into the observation."""
        self.state.plan[:] = gaits
        self.previous_action[:] = actions
        dynamics.advance(self.state, self.pushes, self.errors, self.command, self.dt, self.physics)
        self.errors.period[self.state.failure == 0] += 1
        self._look(0, self.n)

    def _look(self, first: int, end: int) -> None:
        """Observe pendulums first..end-1."""
        state, p = self.state, self.physics
        follow_all(self.schedule, state.time, self.command, first, end)
        observe(state, self.command, self.previous_action, p, self.truth, self.world, first, end)
        check_failures(state, self.truth, p.double_support, self.capture, self.margin, first, end)
        dynamics.show(state, self.errors, p, self.dt, self.truth, self.observation, first, end)


class PendulumEpisodes(GaitEpisodes[PendulumCore]):
    """Episodes of n pendulums."""

    failures = dynamics.FAILURES
    has_double_support = stands = True
    force_grid = 10.0
    turns, name = False, "PushRecovery/Pendulum-v0"

    def __init__(
        self,
        n: int,
        robot: RobotModel | None = None,
        limits: GaitLimits | None = None,
        preset: str = "default",
        control_hz: float = 100.0,
    ):
        robot = RobotModel() if robot is None else require_kind("robot", robot, RobotModel)
        limits = GaitLimits.of(robot) if limits is None else limits
        super().__init__(n, robot, limits, preset, control_hz)
        self.core = PendulumCore(self.n, robot, limits, self.control_hz, self.double_support)

    def _clone(self, n: int, threads: int) -> PendulumEpisodes:
        """Episodes of n such pendulums; they cost too little to share threads."""
        return PendulumEpisodes(n, self.robot, self.limits, self.preset, self.control_hz)

    def motion(self) -> Motion:
        """Steps, CoM, time and stance sides."""
        state = self.core.state
        return Motion(state.steps, state.com, state.time, state.side, state.heading)

    def failure(self) -> Ints:
        """Index into FAILURES, (n,)."""
        return self.core.state.failure


class PendulumEnv(GaitEnv):
    """LIPM with flywheel (eqs. 4-9) under a gait action, integrated exactly.

    The swing foot is massless and lands where the action of the moment of touchdown wants it. With a preset
    that has double support it stays on the floor for the first part of the step. A push acts on the CoM: its
    body, its point of attack and its vertical part do not matter here.
    """

    def __init__(
        self,
        render_mode: str | None = None,
        control_hz: float = 100.0,
        preset: str = "default",
        push_distribution: dict[str, Any] | PushDistribution | None = None,
        robot: RobotModel | None = None,
        limits: GaitLimits | None = None,
    ):
        """Build one pendulum.

        Args:
            render_mode: "human", "rgb_array" or None.
            control_hz: planning rate [Hz].
            preset: of the planner that belongs to this environment; its double support is the gait's.
            push_distribution: of the scenarios that `reset` draws, as an object or its dict.
            robot: physical constants; the paper's by default.
            limits: of the action; the paper's for the robot by default.
        """
        episodes = PendulumEpisodes(1, robot, limits, preset, control_hz)
        super().__init__(episodes, render_mode, push_distribution)

    def _make_picture(self, window: bool) -> Any:
        from .view import PendulumView

        return PendulumView(window=window)

    def _draw(self) -> NDArray[np.uint8] | None:
        """Top view of feet, CoM, DCM and push."""
        force = np.zeros(2)
        state, pushes = self.core.state, self.core.pushes
        for i in range(pushes.start.shape[1]):
            if pushes.start[0, i] <= state.time[0] < pushes.start[0, i] + pushes.duration[0, i]:
                force += pushes.force[0, i, :2]
        elapsed = float(self.core.truth[0, layout.ELAPSED])
        return self._picture.draw(state, self.robot, force, both_stand(elapsed, self.double_support))


make_pendulum_vector = vector_maker(PendulumEnv, PendulumEpisodes)  # of PushRecovery/Pendulum-v0
