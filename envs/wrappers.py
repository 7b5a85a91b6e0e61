"""Wrappers of the gait environments for one robot and for n: held actions, and residuals on a policy.

`PushRecovery/BipedResidual-v0` is the biped whose action is a learned correction of a policy's.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from ..controllers.errors import InvalidValueError
from ..controllers.model.gait_box import GAIT_SIZE
from ..controllers.policies.interface import Policy, action_and_state, as_policy
from ..controllers.policies.residual import (
    Correction,
    ResidualRule,
    check_residual_scale,
    default_residual_scale,
)
from ..controllers.policies.two_stage import POLICY_NAMES, make_policy
from ..controllers.settings import PlannerConfig
from ..controllers.validation import require_integer, require_kind
from .biped.env import BipedEnv, BipedEpisodes
from .episode.episodes import GaitEpisodes
from .episode.gym_env import check_action, note_hold, note_residual, spaces_of
from .episode.info import Info, put
from .episode.vector_env import Actions, GaitVectorEnv, Mask, vector_maker
from .scenario.scenario import Scenario
from .snapshot import RobotSnapshot

Scale = float | Sequence[float] | NDArray[Any] | None


def _residual(
    of: Any, policy: Policy | str, scale: Scale, preset: str | None, gate: Sequence[float] | None
) -> tuple[ResidualRule, dict[str, Any]]:
    """How residuals correct a policy on the robots of an environment or of episodes.

    Returns:
        The rule, and what it does in the words of a policy file; a policy without a name has none there.
    """
    preset = str(getattr(of, "preset", "")) if preset is None else preset
    below = make_policy(policy, of.robot, of.limits, preset) if isinstance(policy, str) else as_policy(policy)
    factors = default_residual_scale(of.limits) if scale is None else check_residual_scale(scale)
    rule = ResidualRule(below, of.robot, of.limits, factors, gate)
    name, config = getattr(below, "name", None), getattr(below, "config", None)
    return rule, {
        "policy": name if name in POLICY_NAMES else None,
        "preset": preset,
        "scale": tuple(rule.scale.tolist()),
        "config": asdict(config) if isinstance(config, PlannerConfig) else None,
        "gate": rule.gate,
    }


class ActionHold(gym.Wrapper, RecordConstructorArgs):
    """Repeats each action for `periods` steps of the wrapped environment, or to the end of the episode.

    The reward is the sum over the steps, term by term in info["reward_terms"] too; everything else is the
    last step's. Around `ResidualAction` it holds the residual while the planner replans in every period.

    Args:
        env: The environment.
        periods: Steps for which an action is held, >= 1; 2 is 50 Hz on an environment of 100 Hz.
    """

    def __init__(self, env: gym.Env, periods: int = 1):
        self.periods = require_integer("hold", periods, 1)
        RecordConstructorArgs.__init__(self, periods=self.periods)
        gym.Wrapper.__init__(self, env)
        if self.periods > 1:
            self.action_space = note_hold(env.action_space, self.periods)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the wrapped environment with one action until it is due for the next."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        terms = dict(info.get("reward_terms", {}))
        for _ in range(self.periods - 1):
            if terminated or truncated:
                break
            observation, more, terminated, truncated, info = self.env.step(action)
            reward = float(reward) + float(more)
            for name, value in info.get("reward_terms", {}).items():
                terms[name] = terms.get(name, 0.0) + value
        if terms:
            info["reward_terms"] = terms
        return observation, reward, terminated, truncated, info


class ResidualAction(gym.Wrapper, RecordConstructorArgs):
    """The action is a residual on what a policy would do: total = clip(base + scale x g x action, -1, 1).

    Both see the same observation. Where scale x g x action is zero, the base's own bits pass. `info` gains
    baseline_action and residual_action (scale x g x action), both (7,) in units of the gait action, and
    qp_status: the status of the solver of the policy's stage 2, None for a policy without one.

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
        scale: Scale = None,
        preset: str | None = None,
        gate: Sequence[float] | None = None,
    ):
        space = require_kind("env", env, gym.Env).action_space
        if not (isinstance(space, gym.spaces.Box) and space.shape == (GAIT_SIZE,)):
            raise InvalidValueError(f"a gait residual needs an action space Box ({GAIT_SIZE},), got {space}")
        self._rule, meaning = _residual(env.unwrapped, policy, scale, preset, gate)
        self.policy, self.scale, self.gate = self._rule.policy, self._rule.scale, self._rule.gate
        RecordConstructorArgs.__init__(
            self,
            _disable_deepcopy=True,
            policy=policy,
            scale=self.scale.tolist(),
            preset=meaning["preset"] if isinstance(policy, str) else preset,
            gate=None if self.gate is None else list(self.gate),
        )
        gym.Wrapper.__init__(self, env)
        own = gym.spaces.Box(-1.0, 1.0, (GAIT_SIZE,), np.float32)
        self.action_space = note_residual(own, space, meaning)
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
        base, self._policy_state = action_and_state(
            self.policy.predict(
                self._observation, state=self._policy_state, episode_start=np.array([self._episode_start])
            )
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
    return _BuiltInHold(_BuiltInResidual(BipedEnv(**biped), policy, scale, preset, gate), hold)


class _BuiltIn(gym.Wrapper):
    """A wrapper that belongs to the registered environment: the spec makes it, and does not list it again."""

    @property
    def spec(self) -> Any:
        return self.env.spec


class _BuiltInResidual(_BuiltIn, ResidualAction):
    pass


class _BuiltInHold(_BuiltIn, ActionHold):
    pass


class ResidualVectorEnv(GaitVectorEnv):
    """As `ResidualAction` within `ActionHold`, for n robots; the policy plans for all of them in one call.

    `info` gains baseline_action and residual_action (n, 7) and qp_status, masked out where a robot was reset.
    """

    def __init__(
        self,
        episodes: GaitEpisodes,
        policy: Policy | str = "two-stage",
        scale: Scale = None,
        preset: str | None = None,
        gate: Sequence[float] | None = None,
        **vector: Any,
    ):
        """Put a policy below.

        Args:
            episodes: of n robots.
            policy: a name of `make_policy`, or anything with a batched `predict` that remembers nothing.
            scale: see `ResidualAction`.
            preset: the planner's where `policy` is a name; by default that of the episodes.
            gate: (shut, open) [m], see `ResidualAction`.
            vector: arguments of `GaitVectorEnv`; for its `hold` the policy replans in every period.

        Raises:
            PushRecoveryError: as the constructors of `GaitVectorEnv` and `ResidualAction` do.
        """
        super().__init__(episodes, **vector)
        self._rule, meaning = _residual(episodes, policy, scale, preset, gate)
        self.policy, self.scale, self.gate = self._rule.policy, self._rule.scale, self._rule.gate
        below = spaces_of(episodes)[1]
        self.single_action_space = note_hold(note_residual(copy.deepcopy(below), below, meaning), self.hold)
        self._base, self._residual = np.zeros((2, self.num_envs, GAIT_SIZE), np.float32)
        self._statuses = np.full(self.num_envs, None, dtype=object)
        self._planned = np.zeros(self.num_envs, np.bool_)  # whether the three above are of this episode

    def _gait_actions(self, actions: Actions, live: Mask) -> Actions:
        """The policy's actions, corrected; zeros for the robots that wait for their reset."""
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
        put(info, "residual_action", self._residual.copy(), known)
        put(info, "qp_status", self._statuses.copy(), known & (self._statuses != None))  # noqa: E711


make_biped_residual_vector = vector_maker(make_biped_residual, BipedEpisodes, ResidualVectorEnv)
