"""Learned corrections on top of a policy: the residual action space and its registered environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.policies.arms import make_policy
from ...controllers.policies.interface import Policy, as_policy
from ...controllers.policies.residual import check_residual_scale, default_residual_scale
from ...controllers.policies.residual_rule import Correction, ResidualRule
from ...controllers.validation import require_kind
from ..episode.env import check_action
from ..scenario.scenario import Scenario
from ..snapshot.robot_snapshot import RobotSnapshot
from .action_hold import ActionHold


class ResidualAction(gym.Wrapper, RecordConstructorArgs):
    """The action is a residual on what a policy would do: total = clip(base + scale x g x action, -1, 1).

    Both see the same observation. Where scale x g x action is zero, the base's own bits pass. `info` gains
    baseline_action and residual_action (scale x g x action), both (7,) in units of the gait action, and
    qp_status: what the solver of the policy's stage 2 said, None for a policy without one.

    Args:
        env: A gait environment.
        policy: What acts below: anything with predict(observation), or a name of `make_policy`.
        scale: One number or seven, in action units, >= 0; by default (0.12 m, 0.10 m, 0.15 s, 0.06 m,
            0.03 m, 12 rad/s^2, 12 rad/s^2) in the environment's limits.
        preset: The planner's preset where `policy` is a name; by default the environment's.
        gate: (shut, open) of the DCM's error against the nominal gait [m], between which g goes from 0 to 1,
            see `ResidualGate`; None: g is 1.

    Raises:
        InvalidValueError: The environment's action is not the gait action, scale or gate is impossible, or
            what is given as the environment or the policy is none.
        UnknownNameError: No policy or preset of that name.
    """

    def __init__(
        self,
        env: gym.Env,
        policy: Policy | str = "two-stage",
        scale: float | Sequence[float] | NDArray[Any] | None = None,
        preset: str | None = None,
        gate: Sequence[float] | None = None,
    ):
        space = require_kind("env", env, gym.Env).action_space
        if not (isinstance(space, gym.spaces.Box) and space.shape == (GAIT_SIZE,)):
            raise InvalidValueError(f"a gait residual needs an action space Box ({GAIT_SIZE},), got {space}")
        unwrapped: Any = env.unwrapped
        if scale is None:
            self.scale = default_residual_scale(unwrapped.limits)
        else:
            self.scale = check_residual_scale(scale)
        if isinstance(policy, str):
            preset = str(unwrapped.preset) if preset is None else preset
            self.policy: Policy = make_policy(policy, unwrapped.robot, unwrapped.limits, preset)
        else:
            self.policy = as_policy(policy)
        self._rule = ResidualRule(self.policy, unwrapped.robot, unwrapped.limits, self.scale, gate)
        self.gate = self._rule.gate
        recorded = None if self.gate is None else list(self.gate)
        RecordConstructorArgs.__init__(
            self,
            _disable_deepcopy=True,
            policy=policy,
            scale=self.scale.tolist(),
            preset=preset,
            gate=recorded,
        )
        gym.Wrapper.__init__(self, env)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (GAIT_SIZE,), np.float32)
        self._observation: NDArray[Any] | None = None
        self._policy_state: Any = None
        self._episode_start = True

    @property
    def opening(self) -> float:
        """How far the gate stands open at the last observation, in [0, 1]."""
        return 1.0 if self._observation is None else self._rule.opening(self._observation[None]).item()

    def act(self, observations: NDArray[np.float64], learned: NDArray[np.float32]) -> Correction:
        """Gait actions of learned ones (n, 7) at observations (n, 36), as `step` forms them; see the rule."""
        return self._rule.act(observations, learned)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset the environment and the policy's memory."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._observation = np.array(observation)  # the caller may write into theirs
        self._policy_state, self._episode_start = None, True
        return observation, info

    def restore(
        self, snapshot: RobotSnapshot, scenario: Scenario | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """`restore` of the environment; the policy below, as after a reset, has nothing to remember.

        Raises:
            InvalidValueError: the policy below has a memory, which no snapshot holds.
        """
        if self._policy_state is not None:
            raise InvalidValueError(
                "a robot is put back only above a policy without memory: predict gave a state"
            )
        observation, info = self.env.get_wrapper_attr("restore")(snapshot, scenario)
        self._observation, self._episode_start = np.array(observation), True
        return observation, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """One planning period with the policy's action corrected by `action`, (7,) in [-1, 1]."""
        if self._observation is None:
            raise gym.error.ResetNeeded("call reset before step")
        residual = check_action(action, "residual action")
        base, self._policy_state = self.policy.predict(
            self._observation, state=self._policy_state, episode_start=np.array([self._episode_start])
        )
        self._episode_start = False
        correction = self._rule.correct(self._observation[None], np.array(base)[None], residual[None])
        observation, reward, terminated, truncated, info = self.env.step(correction.total[0])
        self._observation = np.array(observation)
        info["baseline_action"] = correction.base[0]
        info["residual_action"] = correction.shift[0]
        info["qp_status"] = next(iter(getattr(self.policy, "statuses", ())), None)
        return observation, reward, terminated, truncated, info


def make_biped_residual(
    policy: str = "two-stage",
    scale: float | Sequence[float] | None = None,
    preset: str | None = None,
    hold: int = 1,
    gate: Sequence[float] | None = None,
    **biped: Any,
) -> gym.Env:
    """Entry point of PushRecovery/BipedResidual-v0: the biped, its action a residual on a named policy.

    Args:
        policy: Name of the policy below, for `make_policy`.
        scale: See `ResidualAction`; a list, so that the spec serialises to JSON.
        preset: The planner's preset; by default the biped's.
        hold: Planning periods for which a residual is held.
        gate: See `ResidualAction`.
        biped: Keywords of PushRecovery/Biped-v0 (render_mode, control_hz, ...).
    """
    from ..biped.env import BipedEnv

    return build_residual(BipedEnv(**biped), policy, scale, preset, hold, gate)


def build_residual(
    env: gym.Env,
    policy: str = "two-stage",
    scale: float | Sequence[float] | None = None,
    preset: str | None = None,
    hold: int = 1,
    gate: Sequence[float] | None = None,
) -> gym.Env:
    """A residual environment for an entry point; its spec holds the keywords and not the wrappers."""
    return _BuiltInHold(_BuiltInResidual(env, policy, scale, preset, gate), hold)


class _BuiltIn(gym.Wrapper):
    """A wrapper that belongs to the registered environment: the spec makes it, and does not list it again."""

    @property
    def spec(self) -> Any:
        return self.env.spec


class _BuiltInResidual(_BuiltIn, ResidualAction):
    pass


class _BuiltInHold(_BuiltIn, ActionHold):
    pass
