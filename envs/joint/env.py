"""`PushRecovery/BipedJoint-v0` and `PushRecovery/BipedJointResidual-v0`: single and vector form."""

from __future__ import annotations

from typing import Any, ClassVar

from ..biped.env import BipedEnv, BipedEpisodes
from ..biped.robots.description import RobotDescription
from ..episode.env import GaitEnv
from ..episode.vector_env import GaitVectorEnv
from ..scenario.push_distribution import PushDistribution
from .episodes import DEFAULT_GATE, DEFAULT_SCALE, Gate, JointEpisodes, JointResidualEpisodes


class BipedJointEnv(BipedEnv):
    """The biped under joint position targets, which PD control turns into torques; no planner.

    The arguments are those of `BipedEnv`: `control_hz` is the rate of the targets, and of a preset the
    settings of the robot count, touchdown and the nominal gait among them.
    """

    episodes_of: ClassVar[type[BipedEpisodes]] = JointEpisodes


class BipedJointResidualEnv(BipedEnv):
    """The biped under a planner and whole-body control, whose joint torques the action corrects."""

    def __init__(
        self,
        policy: str = "two-stage",
        scale: float = DEFAULT_SCALE,
        render_mode: str | None = None,
        control_hz: float = 100.0,
        preset: str | None = None,
        push_distribution: dict[str, Any] | PushDistribution | None = None,
        robot: str | RobotDescription = "biped",
        profile: str = "exact",
        sensing: str | None = None,
        arm: str = "",
        gate: Gate = DEFAULT_GATE,
    ):
        """Build one biped.

        Args:
            policy: name of the planner below.
            scale: what a residual of 1 adds, as a share of the motor's largest torque, within 0-1.
            render_mode: see `BipedEnv`, and so the other arguments.
            control_hz: rate of planner and residual [Hz].
            preset: of the planner below and of the robot's settings.
            push_distribution: of the scenarios that `reset` draws.
            robot: another one than the biped.
            profile: of the robots in scenarios that `reset` draws.
            sensing: what is seen and controlled in every scenario, the true state or onboard sensors.
            arm: the policy whose own robot it is, where the preset has one.
            gate: (shut, open) [m]: how far the DCM is from the nominal gait where the residual begins to act,
                and where all of it does; None: it always acts.
        """
        episodes = JointResidualEpisodes(
            1, policy, scale, preset, control_hz, 1, robot, profile, sensing, arm, gate
        )
        GaitEnv.__init__(self, episodes, render_mode, push_distribution)
        self.arm = arm


def make_biped_joint_vector(
    num_envs: int = 1,
    autoreset_mode: str = "NextStep",
    threads: int = 1,
    render_mode: str | None = None,
    push_distribution: dict[str, Any] | PushDistribution | None = None,
    **biped: Any,
) -> GaitVectorEnv:
    """Vector entry point of PushRecovery/BipedJoint-v0: `num_envs` bipeds on one core.

    `threads` share the physics; `autoreset_mode` and `render_mode` are those of `GaitVectorEnv`, the others
    those of `BipedJointEnv`.
    """
    episodes = JointEpisodes(num_envs, threads=threads, **biped)
    return GaitVectorEnv(episodes, push_distribution, autoreset_mode, render_mode)


def make_biped_joint_residual_vector(
    num_envs: int = 1,
    autoreset_mode: str = "NextStep",
    threads: int = 1,
    render_mode: str | None = None,
    push_distribution: dict[str, Any] | PushDistribution | None = None,
    **biped: Any,
) -> GaitVectorEnv:
    """Vector entry point of PushRecovery/BipedJointResidual-v0: `num_envs` bipeds on one core.

    `threads` share the physics; `autoreset_mode` and `render_mode` are those of `GaitVectorEnv`, the others
    those of `BipedJointResidualEnv`.
    """
    episodes = JointResidualEpisodes(num_envs, threads=threads, **biped)
    return GaitVectorEnv(episodes, push_distribution, autoreset_mode, render_mode)
