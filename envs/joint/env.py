"""`PushRecovery/BipedJoint-v0` and `PushRecovery/BipedJointResidual-v0`: rewards, episodes, environments.

Reward terms under joint targets are those of the gait that need no plan, `alive`, `fall`, `dcm`, `margin` and
`trunk` of `episode.period_end`, and what makes a gait of targets; each is one number a planning period.
Episodes are begun, judged and ended as those under gaits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.array_table import COMMON, Floats1, Floats2
from ...controllers.jit import njit, source_digest
from ...controllers.model.gait_box import DURATION, GAIT_SIZE
from ...controllers.model.observation import (
    COM_VELOCITY,
    COMMAND,
    ELAPSED,
    HEADING_ERROR,
    SWING_POSITION,
    side_sign,
)
from ...controllers.policies.interface import Policy
from ...controllers.policies.residual import DEFAULT_GATE, make_gate
from ...controllers.policies.two_stage import make_policy
from ...controllers.validation import require_number
from ...controllers.whole_body.kinematics import NU
from ..biped.core import BipedCore
from ..biped.env import BipedConfig, BipedEnv, BipedEpisodes
from ..episode.episodes import Mask, Period
from ..episode.period_end import REWARD_TERMS, Reward, end_period
from ..episode.vector_env import vector_maker
from ..scenario.scenario import IN_PLACE, Command, Scenario
from ..snapshot import Arrays, RobotSnapshot, arrays_of, digest_of
from .core import JointCore, JointResidualCore

Array = NDArray[np.float64]

FROM_GAIT = ("alive", "fall", "dcm", "margin", "trunk")
JOINT_REWARD_TERMS = (*FROM_GAIT, "velocity", "heading", "swing", "effort", "smoothness")
TAKEN = np.array([REWARD_TERMS.index(name) for name in FROM_GAIT])
OWN = len(FROM_GAIT)  # where the terms begin that are made here

_VELOCITY, _COMMAND, _SWING_HEIGHT = COM_VELOCITY.start, COMMAND.start, SWING_POSITION.start + 2
LATE = 1.25  # share of the nominal step from which a swing foot earns nothing
CLEARANCE = 0.02  # error of the swing foot's height at which its reward has fallen to 1/e [m]


@njit(cache=True)
def velocity(obs, failed):  # pragma: no cover
    """exp(-|v - v_command|^2 / (0.5 m/s)^2), v the CoM's."""
    squared = (obs[_VELOCITY] - obs[_COMMAND]) ** 2 + (obs[_VELOCITY + 1] - obs[_COMMAND + 1]) ** 2
    return 0.0 if failed else math.exp(-squared / 0.25)


@njit(cache=True)
def heading(obs):  # pragma: no cover
    """-(yaw of the pelvis over the heading [rad])^2, at least -1."""
    return max(-(obs[HEADING_ERROR] ** 2), -1.0)


@njit(cache=True)
def swing(obs, duration, apex, failed):  # pragma: no cover
    """exp(-(z - apex sin(pi t / T))^2 / CLEARANCE^2) until T, z = 0 until 1.25 T, nothing later.

    Pays for a foot that rises and comes down in the time of the nominal step (as the feet's phase in MuJoCo
    Playground's gaits), and for nothing when no step comes.

    z is the height of the swing sole, t the time in the step, T the nominal `duration` [s], `apex` [m].
    """
    phase = obs[ELAPSED] / duration
    if failed or phase > LATE:
        return 0.0
    wanted = apex * math.sin(math.pi * phase) if phase < 1.0 else 0.0
    return math.exp(-(((obs[_SWING_HEIGHT] - wanted) / CLEARANCE) ** 2))


@njit(cache=True)
def effort(squares):  # pragma: no cover
    """-0.05 sum (tau / largest)^2, the mean of the period."""
    return -0.05 * squares


@njit(cache=True)
def smoothness(held, before):  # pragma: no cover
    """-0.02 |a - a_before|^2 of the joints' actions (14,)."""
    total = 0.0
    for i in range(held.shape[0]):
        total += (held[i] - before[i]) ** 2
    return -0.02 * total


@njit(cache=True)
def write_rewards(
    gait_terms, truth, plan, squares, held, before, apex, failed, terms, total
):  # pragma: no cover
    """Write terms (n, 10) in the order of JOINT_REWARD_TERMS and their sums (n,); `before` becomes `held`.

    Args:
        gait_terms: (n, 7) in the order of REWARD_TERMS.
        truth: observations (n, 36) without noise, with the command itself.
        plan: nominal steps (n, 7).
        squares: effort (n,).
        held: actions (n, 14) of the period.
        before: of the period before, written.
        apex: height of the swing sole in mid-step [m].
        failed: (n,).
        terms: written.
        total: written.
    """
    for k in range(total.shape[0]):
        row, obs = terms[k], truth[k]
        for i in range(OWN):
            row[i] = gait_terms[k, TAKEN[i]]
        row[OWN], row[OWN + 1] = velocity(obs, failed[k]), heading(obs)
        row[OWN + 2] = swing(obs, plan[k, DURATION], apex, failed[k])
        row[OWN + 3], row[OWN + 4] = effort(squares[k]), smoothness(held[k], before[k])
        total[k] = 0.0
        for i in range(row.shape[0]):
            total[k] += row[i]
        for i in range(held.shape[1]):
            before[k, i] = held[k, i]


DEFAULT_SCALE = 0.2  # of a motor's largest torque, which a residual of 1 adds
Gate = Sequence[float] | None


class JointRewards(NamedTuple):
    """Rewards of the last period of n robots, and what the next ones follow from."""

    terms: Floats2  # (n, 10) in the order of JOINT_REWARD_TERMS
    total: Floats1  # (n,)
    before: Floats2  # (n, 14) what the joints were asked, in the robot's own order


class OnJointsEpisodes(BipedEpisodes):
    """Episodes of n bipeds whose joints are acted on, with a planner below or without."""

    core: Any  # a JointCore

    @property
    def seen(self) -> Array:
        """Joint observations (n, 58); with a planner below, the gait's (n, 36) before them."""
        return self.core.joints.observation

    def _made_for(self, scenario: Scenario) -> dict[str, str]:
        code = source_digest(type(self.core).__module__).encode()
        common = arrays_of(self.core.own, (), only=COMMON)
        drives = digest_of(*(array.tobytes() for _, array in sorted(common.items())), code)
        return super()._made_for(scenario) | {"set of drives": drives}


def stepping(scenario: Scenario) -> Scenario:
    """The scenario with steps in place wherever a command is to stand."""

    def moving(command: Command) -> Command:
        return IN_PLACE if command.stand else command

    changes = tuple(replace(change, command=moving(change.command)) for change in scenario.changes)
    return replace(scenario, command=moving(scenario.command), changes=changes, stride=0.0)


class JointEpisodes(OnJointsEpisodes):
    """Episodes of n bipeds under joint targets, which step in place where they are to stand."""

    name = "PushRecovery/BipedJoint-v0"
    walks = stands = has_double_support = False
    core_of: ClassVar[type[BipedCore]] = JointCore
    core: JointCore
    observation_size: ClassVar[int] = JointCore.observation_size
    action_size: ClassVar[int] = NU
    reward_terms: tuple[str, ...] = JOINT_REWARD_TERMS

    def __init__(self, n: int, config: BipedConfig | None = None, threads: int = 1, **changes: Any):
        """Build the robots, see `BipedEpisodes`."""
        super().__init__(n, config, threads, **changes)
        terms = np.zeros((n, len(self.reward_terms)))
        self._rewards = JointRewards(terms, total=np.zeros(n), before=np.zeros((n, NU)))

    def begin(self, k: int, scenario: Scenario) -> None:
        """Put robot k at the beginning of a scenario, see `GaitEpisodes`."""
        super().begin(k, stepping(scenario))
        self._rewards.before[k] = 0.0

    def restore(self, k: int, snapshot: RobotSnapshot, scenario: Scenario | None = None) -> None:
        """Put robot k where another one was, see `GaitEpisodes`."""
        super().restore(k, snapshot, None if scenario is None else stepping(scenario))

    def step(self, actions: NDArray[np.float32]) -> Period:
        """One planning period under targets in [-1, 1]; `planned` is the nominal step's duration."""
        core = self.core
        core.asked[:] = actions
        core.step(core.gait.plan, core.previous_action)  # which are nobody's
        return self._end_period(core.gait.plan)

    def _end_period(self, gaits: Array) -> Period:
        core = self.core
        end_period(self._table, self._constants, gaits, self._ends)
        truth, command = core.truth.copy(), core.command  # that of the truth is a planner's, turned ahead
        truth[:, _COMMAND] = command[:, 0]
        truth[:, _COMMAND + 1] = side_sign(core.gait.stance) * command[:, 1]
        write_rewards(
            self._episodes.terms, truth, gaits, core.joints.effort, core.joints.held, self._rewards.before,
            core.gait_settings.apex, self._ends[0], self._rewards.terms, self._rewards.total,
        )  # fmt: skip
        return self._with_added_terms()

    def _bind(self) -> None:
        super()._bind()
        self._period = Period(Reward(self._rewards.total, self._rewards.terms), *self._ends)

    def _arrays(self, k: int) -> Arrays:
        rewards = {f"joint_rewards.{name}": array for name, array in self._rewards._asdict().items()}
        return super()._arrays(k) | rewards


class JointResidualEpisodes(OnJointsEpisodes):
    """Episodes of n bipeds under a planner, whose joint torques are corrected.

    The planner is a function of the gait observation, as every variant is, and plans for all robots in one
    call. What it last planned is no state of a robot: one that is put back is planned for anew. While the
    gate, a function of the same observation, is shut, the planner's walk passes bit for bit.
    """

    name = "PushRecovery/BipedJointResidual-v0"
    core_of: ClassVar[type[BipedCore]] = JointResidualCore
    core: JointResidualCore
    observation_size: ClassVar[int] = JointResidualCore.observation_size
    action_size: ClassVar[int] = NU

    def __init__(
        self,
        n: int,
        config: BipedConfig | None = None,
        threads: int = 1,
        policy: str = "two-stage",
        scale: float = DEFAULT_SCALE,
        gate: Gate = DEFAULT_GATE,
        **changes: Any,
    ):
        """Put a planner below.

        Args:
            n: number of robots.
            config: which, see `BipedEpisodes`.
            threads: that share the physics.
            policy: name of what plans, for `make_policy`.
            scale: what a residual of 1 adds, as a share of the motor's largest torque, within 0-1.
            gate: (shut, open) of `ResidualGate` [m]: how far the DCM is from the nominal gait where residuals
                begin to act, and where all of them does; None: they always act.
            changes: of single fields of the config.

        Raises:
            PushRecoveryError: an unknown policy, or an impossible scale or gate.
        """
        super().__init__(n, config, threads, **changes)
        self.policy, self.scale = policy, require_number("scale", scale, 0.0, 1.0)
        self.planner = make_policy(policy, self.robot, self.limits, self.preset)
        self.core.scale_residual(self.scale)
        self.gate = make_gate(self.planner, self.robot, self.limits, gate)
        self._base = np.zeros((n, GAIT_SIZE), np.float32)
        self._statuses = np.full(n, None, dtype=object)
        self._planned = np.zeros(n, np.bool_)  # whether these two are of this episode

    def _options(self) -> dict[str, Any]:
        gate = None if self.gate is None else self.gate.band
        return {"policy": self.policy, "scale": self.scale, "gate": gate}

    def action_settings(self) -> dict[str, Any]:
        """The planner below, and how much of a residual is added when."""
        gate = None if self.gate is None else list(self.gate.band)
        return {"planner": self.policy, "scale": self.scale, "gate": gate}

    def _made_for(self, scenario: Scenario) -> dict[str, str]:
        band = "without a gate" if self.gate is None else f"with the gate {self.gate.band}"
        return super()._made_for(scenario) | {"planner below": f"{self.policy} {band}"}

    def _assign(self, k: int, scenario: Scenario) -> None:
        super()._assign(k, scenario)
        self._planned[k] = False

    def step(self, actions: NDArray[np.float32]) -> Period:
        """One planning period: the planner's gait, and residuals (n, 14) in [-1, 1] on its torques."""
        rows = np.flatnonzero(self.failure() == 0)
        opening = 1.0 if self.gate is None else self.gate(self.core.observation)
        self.core.joints.asked[:] = opening * actions
        if len(rows):
            self._base[rows] = self.planner.predict(self.core.observation[rows])[0]
            statuses = getattr(self.planner, "statuses", ())
            self._statuses[rows] = statuses if len(statuses) == len(rows) else None
            self._planned[rows] = True
        return super().step(self._base)

    def walk(self, planner: Policy) -> Period:
        """One planning period of the planner within, uncorrected."""
        return self.step(np.zeros((self.n, NU), np.float32))

    def planner_info(self) -> dict[str, tuple[NDArray[Any], Mask]]:
        """The planner's action and what the solver of its stage 2 said."""
        solved = self._planned & (self._statuses != None)  # noqa: E711
        return {"baseline_action": (self._base, self._planned), "qp_status": (self._statuses, solved)}


class BipedJointEnv(BipedEnv):
    """The biped under joint position targets, which PD control turns into torques; no planner.

    The arguments are those of `BipedEnv`: `control_hz` is the rate of the targets, and of a preset the
    settings of the robot count, touchdown and the nominal gait among them.
    """

    make_episodes = JointEpisodes


class BipedJointResidualEnv(BipedEnv):
    """The biped under a planner and whole-body control, whose joint torques the action corrects."""

    def __init__(
        self,
        policy: str = "two-stage",
        scale: float = DEFAULT_SCALE,
        gate: Gate = DEFAULT_GATE,
        **biped: Any,
    ):
        """Build one biped; arguments are those of `JointResidualEpisodes` and of `BipedEnv`."""
        self.make_episodes = partial(JointResidualEpisodes, policy=policy, scale=scale, gate=gate)
        super().__init__(**biped)


make_biped_joint_vector = vector_maker(BipedJointEnv, JointEpisodes)
make_biped_joint_residual_vector = vector_maker(BipedJointResidualEnv, JointResidualEpisodes)
