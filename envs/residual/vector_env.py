"""n robots whose action is a residual on a policy: `PushRecovery/BipedResidual-v0` in vector form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.policies.arms import make_policy
from ...controllers.policies.interface import Policy, as_policy
from ...controllers.policies.residual import check_residual_scale, default_residual_scale
from ...controllers.policies.residual_rule import ResidualRule
from ..episode.episodes import GaitEpisodes
from ..episode.info import Info, put
from ..episode.vector_env import Actions, GaitVectorEnv, Mask
from ..scenario.push_distribution import PushDistribution


class ResidualVectorEnv(GaitVectorEnv):
    """As `ResidualAction` within `ActionHold`, for n robots; the policy plans for all of them in one call.

    `info` gains baseline_action and residual_action (n, 7) and qp_status, masked out where a robot was reset.
    """

    def __init__(
        self,
        episodes: GaitEpisodes,
        policy: Policy | str = "two-stage",
        scale: float | Sequence[float] | NDArray[Any] | None = None,
        preset: str | None = None,
        hold: int = 1,
        gate: Sequence[float] | None = None,
        *,
        push_distribution: dict[str, Any] | PushDistribution | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ):
        """Put a policy below.

        Args:
            episodes: of n robots.
            policy: a name of `make_policy`, or anything with a batched `predict` that remembers nothing.
            scale: see `ResidualAction`.
            preset: the planner's where `policy` is a name; by default that of the episodes.
            hold: planning periods for which a residual is held while the policy replans.
            gate: (shut, open) [m], see `ResidualAction`.
            push_distribution: of the scenarios that are drawn.
            autoreset_mode: see `GaitVectorEnv`.
            render_mode: None.

        Raises:
            PushRecoveryError: as the constructors of `GaitVectorEnv` and `ResidualAction` do.
        """
        super().__init__(episodes, push_distribution, autoreset_mode, render_mode, hold)
        robot, limits = episodes.robot, episodes.limits
        self.scale = default_residual_scale(limits) if scale is None else check_residual_scale(scale)
        if isinstance(policy, str):
            policy = make_policy(policy, robot, limits, episodes.preset if preset is None else preset)
        self.policy: Policy = as_policy(policy)
        self._rule = ResidualRule(self.policy, robot, limits, self.scale, gate)
        self.gate = self._rule.gate
        self._base, self._residual = np.zeros((2, self.num_envs, GAIT_SIZE), np.float32)
        self._statuses = np.full(self.num_envs, None, dtype=object)
        self._planned = np.zeros(self.num_envs, np.bool_)  # whether the three above are of this episode

    def _gait_actions(self, actions: Actions, live: Mask) -> Actions:
        """What the policy does, corrected; zeros for the robots that wait for their reset."""
        rows = np.flatnonzero(live)
        total = np.zeros_like(actions)
        if not len(rows):
            return total
        total[rows], self._base[rows], self._residual[rows] = self._rule.act(
            self.core.observation[rows], actions[rows]
        )
        statuses = getattr(self.policy, "statuses", ())
        self._statuses[rows] = statuses if len(statuses) == len(rows) else None
        self._planned[rows] = True
        return total

    def _note_begin(self, k: int, scenario: Any) -> None:
        super()._note_begin(k, scenario)
        self._planned[k] = False

    def _more_info(self, info: Info, rows: Mask) -> None:
        known = rows & self._planned
        put(info, "baseline_action", self._base.copy(), known)
        put(info, "residual_action", self._residual.copy(), known.copy())
        put(info, "qp_status", self._statuses.copy(), known & (self._statuses != None))  # noqa: E711


def make_biped_residual_vector(
    num_envs: int = 1,
    autoreset_mode: str = "NextStep",
    threads: int = 1,
    policy: str = "two-stage",
    scale: float | Sequence[float] | None = None,
    preset: str | None = None,
    hold: int = 1,
    gate: Sequence[float] | None = None,
    control_hz: float = 100.0,
    push_distribution: dict[str, Any] | PushDistribution | None = None,
    render_mode: str | None = None,
    robot: Any = "biped",
    profile: str = "exact",
    sensing: str | None = None,
    arm: str = "",
) -> ResidualVectorEnv:
    """Vector entry point of PushRecovery/BipedResidual-v0: `num_envs` bipeds on one core.

    `threads` share the physics; `autoreset_mode` and `render_mode` are those of `GaitVectorEnv`, the others
    those of `make_biped_residual`.
    """
    from ..biped.env import BipedEpisodes

    body = {"robot": robot, "profile": profile, "sensing": sensing, "arm": arm}
    return ResidualVectorEnv(
        BipedEpisodes(num_envs, control_hz=control_hz, threads=threads, **body),
        policy, scale, preset, hold, gate,
        push_distribution=push_distribution, autoreset_mode=autoreset_mode, render_mode=render_mode,
    )  # fmt: skip
