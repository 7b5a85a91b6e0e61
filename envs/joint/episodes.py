"""Episodes of bipeds whose joints are acted on; begun, judged and ended as those under gaits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.array_table import Floats1, Floats2
from ...controllers.compiled.source_digest import source_digest
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.policies.arms import make_policy
from ...controllers.policies.residual_gate import make_gate
from ...controllers.validation import require_number
from ...controllers.whole_body.kinematics import NU
from ..biped.core import BipedCore
from ..biped.env import BipedEpisodes
from ..biped.robots.description import RobotDescription
from ..episode.episodes import Array, Mask, Period
from ..episode.period_end import end_period
from ..episode.reward import Reward
from ..scenario.scenario import Scenario
from ..snapshot.robot_snapshot import digest_of
from ..snapshot.rows import Arrays, arrays_of
from .core import JointCore, JointResidualCore
from .reward import JOINT_REWARD_TERMS, write_rewards

DEFAULT_SCALE = 0.2  # of a motor's largest torque, which a residual of 1 adds
DEFAULT_GATE = (0.03, 0.10)  # [m] an undisturbed walk stays below the first
Gate = Sequence[float] | None


class JointRewards(NamedTuple):
    """Rewards of the last period of n robots, and what the next ones follow from."""

    terms: Floats2  # (n, 10) in the order of JOINT_REWARD_TERMS
    total: Floats1  # (n,)
    before: Floats2  # (n, 14) what the joints were asked, in the robot's own order


class Rewarded(NamedTuple):
    """The part of a snapshot that these are."""

    joint_rewards: JointRewards


class OnJointsEpisodes(BipedEpisodes):
    """Episodes of n bipeds whose joints are acted on, with a planner below or without."""

    core: Any  # a JointCore

    @property
    def seen(self) -> Array:
        """Joint observations (n, 58); with a planner below, the gait's (n, 36) before them."""
        return self.core.joints.observation

    def _arrays(self, k: int) -> Arrays:
        return super()._arrays(k) | self.core.more_arrays()

    def _made_for(self, scenario: Scenario) -> dict[str, str]:
        code = source_digest(type(self.core).__module__).encode()
        return super()._made_for(scenario) | {"set of drives": digest_of(self.core.more_settings(), code)}


class JointEpisodes(OnJointsEpisodes):
    """Episodes of n bipeds under joint targets; the arguments are those of `BipedEpisodes`."""

    name = "PushRecovery/BipedJoint-v0"
    core_of: ClassVar[type[BipedCore]] = JointCore
    core: JointCore
    observation_size: ClassVar[int] = JointCore.observation_size
    action_size: ClassVar[int] = NU
    reward_terms: ClassVar[tuple[str, ...]] = JOINT_REWARD_TERMS

    def __init__(self, n: int, *args: Any, **kwargs: Any):
        super().__init__(n, *args, **kwargs)
        terms = np.zeros((n, len(self.reward_terms)))
        self._rewards = JointRewards(terms, total=np.zeros(n), before=np.zeros((n, NU)))

    def begin(self, k: int, scenario: Scenario) -> None:
        """As that of `GaitEpisodes`."""
        super().begin(k, scenario)
        self._rewards.before[k] = 0.0

    def step(self, actions: NDArray[np.float32]) -> Period:
        """One planning period under targets (n, 14) in [-1, 1]; `planned` is the nominal step's duration."""
        core = self.core
        core.joints.asked[:] = actions
        core.step(core.gait.plan, core.previous_action)  # which are nobody's
        return self._judge()

    def _judge(self) -> Period:
        """What came of the period."""
        core, nominal = self.core, self.core.gait.plan
        end_period(self._table, self._constants, nominal, self._ends)
        write_rewards(
            self._episodes.terms, core.truth, nominal, core.joints.effort, core.joints.held,
            self._rewards.before, core.settings.apex, self._ends[0], self._rewards.terms, self._rewards.total,
        )  # fmt: skip
        return self._period

    def _bind(self) -> None:
        super()._bind()
        self._period = Period(Reward(self._rewards.total, self._rewards.terms), *self._ends)

    def _arrays(self, k: int) -> Arrays:
        return super()._arrays(k) | arrays_of(Rewarded(self._rewards), ())


class JointResidualEpisodes(OnJointsEpisodes):
    """Episodes of n bipeds under a planner, whose joint torques are corrected.

    The planner is a function of the gait observation, as every arm is, and plans for all robots in one call.
    What it last planned is no state of a robot: one that is put back is planned for anew. While the gate, a
    function of the same observation, is shut, the planner's walk passes bit for bit.
    """

    name = "PushRecovery/BipedJointResidual-v0"
    core_of: ClassVar[type[BipedCore]] = JointResidualCore
    core: JointResidualCore
    observation_size: ClassVar[int] = JointResidualCore.observation_size
    action_size: ClassVar[int] = NU

    def __init__(
        self,
        n: int,
        policy: str = "two-stage",
        scale: float = DEFAULT_SCALE,
        preset: str | None = None,
        control_hz: float = 100.0,
        threads: int = 1,
        robot: str | RobotDescription = "biped",
        profile: str = "exact",
        sensing: str | None = None,
        arm: str = "",
        gate: Gate = DEFAULT_GATE,
    ):
        """Put a planner below.

        Args:
            n: number of robots.
            policy: name of what plans, for `make_policy`.
            scale: what a residual of 1 adds, as a share of the motor's largest torque, within 0-1.
            preset: see `BipedEpisodes`, and so the other arguments.
            control_hz: planning rate [Hz].
            threads: that share the physics.
            robot: whose joints they are.
            profile: of the robots in scenarios that are drawn.
            sensing: above what a scenario says of it.
            arm: the policy whose own robot they are.
            gate: (shut, open) of `ResidualGate` [m], which residuals are multiplied by; None: always open.

        Raises:
            PushRecoveryError: an unknown policy, or an impossible scale or gate.
        """
        super().__init__(n, preset, control_hz, threads, robot, profile, sensing, arm)
        self.policy, self.scale = policy, require_number("scale", scale, 0.0, 1.0)
        self.planner = make_policy(policy, self.robot, self.limits, self.preset)
        self.core.scale_residual(self.scale)
        self.gate = make_gate(self.planner, self.robot, self.limits, gate)
        self._base = np.zeros((n, GAIT_SIZE), np.float32)
        self._statuses = np.full(n, None, dtype=object)
        self._planned = np.zeros(n, np.bool_)  # whether these two are of this episode

    def alike(self, n: int, threads: int = 1) -> JointResidualEpisodes:
        """Episodes of n such bipeds."""
        own = self.description, self.profile.name, self.core.senses.forced, self.arm
        gate = None if self.gate is None else self.gate.band
        return JointResidualEpisodes(
            n, self.policy, self.scale, self.preset, self.control_hz, threads, *own, gate
        )

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

    def told_of_planner(self) -> dict[str, tuple[NDArray[Any], Mask]]:
        """The planner's action and what the solver of its stage 2 said."""
        solved = self._planned & (self._statuses != None)  # noqa: E711
        return {"baseline_action": (self._base, self._planned), "qp_status": (self._statuses, solved)}
