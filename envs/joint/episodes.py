"""Episodes of bipeds whose joints are acted on; begun, judged and ended as those under gaits."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.policies.arms import make_policy
from ...controllers.validation import require_number
from ...controllers.whole_body.kinematics import NU
from ..biped.core import BipedCore
from ..biped.env import BipedEpisodes
from ..biped.robots.description import RobotDescription
from ..episode.episodes import Array, GaitEpisodes, Mask, Period
from ..episode.period_end import end_period
from ..episode.reward import Reward
from ..scenario.scenario import Scenario
from .core import JointCore, JointResidualCore
from .reward import JOINT_REWARD_TERMS, write_rewards

DEFAULT_SCALE = 0.2  # of a motor's largest torque, which a residual of 1 adds


class JointEpisodes(BipedEpisodes):
    """Episodes of n bipeds under joint targets; the arguments are those of `BipedEpisodes`."""

    name = "PushRecovery/BipedJoint-v0"
    core_of: ClassVar[type[BipedCore]] = JointCore
    core: JointCore
    observation_size: ClassVar[int] = JointCore.observation_size
    action_size: ClassVar[int] = NU
    reward_terms: ClassVar[tuple[str, ...]] = JOINT_REWARD_TERMS
    _made_for = GaitEpisodes._made_for  # what is asked of the joints is in no snapshot

    def __init__(self, n: int, *args: Any, **kwargs: Any):
        super().__init__(n, *args, **kwargs)
        self._terms, self._total = np.zeros((n, len(self.reward_terms))), np.zeros(n)
        self._before = np.zeros((n, NU))

    @property
    def seen(self) -> Array:
        """Joint observations (n, 58)."""
        return self.core.joints.observation

    def begin(self, k: int, scenario: Scenario) -> None:
        """As that of `GaitEpisodes`."""
        super().begin(k, scenario)
        self._before[k] = 0.0

    def step(self, actions: NDArray[np.float32]) -> Period:
        """One planning period under targets (n, 14) in [-1, 1]; `planned` is the nominal step's duration."""
        core, nominal = self.core, self.core.gait.plan
        core.joints.asked[:] = actions
        core.step(nominal, core.previous_action)  # which are nobody's
        end_period(self._table, self._constants, nominal, self._ends)
        write_rewards(
            self._episodes.terms, core.truth, nominal, core.joints.effort, core.joints.held, self._before,
            core.settings.apex, self._ends[0], self._terms, self._total,
        )  # fmt: skip
        return self._period

    def _bind(self) -> None:
        super()._bind()
        self._period = Period(Reward(self._total, self._terms), *self._ends)


class JointResidualEpisodes(BipedEpisodes):
    """Episodes of n bipeds under a planner, whose joint torques are corrected.

    The planner is a function of the gait observation, as every arm is, and plans for all robots in one call.
    """

    name = "PushRecovery/BipedJointResidual-v0"
    core_of: ClassVar[type[BipedCore]] = JointResidualCore
    core: JointResidualCore
    observation_size: ClassVar[int] = JointResidualCore.observation_size
    action_size: ClassVar[int] = NU
    _made_for = GaitEpisodes._made_for  # what is asked of the joints is in no snapshot

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

        Raises:
            PushRecoveryError: an unknown policy, or an impossible scale.
        """
        super().__init__(n, preset, control_hz, threads, robot, profile, sensing, arm)
        self.policy, self.scale = policy, require_number("scale", scale, 0.0, 1.0)
        self.planner = make_policy(policy, self.robot, self.limits, self.preset)
        self.core.scale_residual(self.scale)
        self._base = np.zeros((n, GAIT_SIZE), np.float32)
        self._statuses = np.full(n, None, dtype=object)
        self._planned = np.zeros(n, np.bool_)  # whether these two are of this episode

    def alike(self, n: int, threads: int = 1) -> JointResidualEpisodes:
        """Episodes of n such bipeds."""
        own = self.description, self.profile.name, self.core.senses.forced, self.arm
        return JointResidualEpisodes(n, self.policy, self.scale, self.preset, self.control_hz, threads, *own)

    @property
    def seen(self) -> Array:
        """Gait observations, and after them joint observations, (n, 94)."""
        return self.core.joints.observation

    def begin(self, k: int, scenario: Scenario) -> None:
        """As that of `GaitEpisodes`."""
        super().begin(k, scenario)
        self._planned[k] = False

    def step(self, actions: NDArray[np.float32]) -> Period:
        """One planning period: the planner's gait, and residuals (n, 14) in [-1, 1] on its torques."""
        rows = np.flatnonzero(self.failure() == 0)
        self.core.joints.asked[:] = actions
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
