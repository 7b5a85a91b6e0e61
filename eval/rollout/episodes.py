"""The episode loop: scenarios to outcomes, on one robot or on many side by side, bit for bit the same.

What an action of a wrapped environment does to the gait: it is held, or added to a policy's own.

The episode loop: scenarios to outcomes, on one robot or on many side by side.

One episode: environment, policy, scenario -> outcome; nothing else enters.

Robots that share one core: each slot holds an episode, and all move in one planning period.

Many episodes side by side on one core: the outcomes of `rollout`, bit for bit, sooner.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.policies.interface import Policy, as_policy
from ...controllers.policies.learned import NetworkPolicy
from ...controllers.policies.two_stage import RandomPolicy, TwoStagePolicy
from ...envs.biped.limits_record import BoundsReport
from ...envs.episode.episodes import GaitEpisodes, Held, Mask, hold_action
from ...envs.episode.gym_env import GaitEnv, check_action
from ...envs.scenario.scenario import Scenario
from ...envs.wrappers import ActionHold, ResidualAction
from .outcome import NO_BOUNDS, EffortMeter, Ending, Outcome, StepMeter

Actions = NDArray[np.float32]


class ActionRule:
    """`ActionHold` around `ResidualAction`, each where there is one, for many robots; the same bits.

    Args:
        env: the gait environment below.
        residual: the wrapper whose policy acts below; None where actions are gait actions.
        hold: planning periods for which an action is held.
    """

    def __init__(self, env: GaitEnv, residual: ResidualAction | None = None, hold: int = 1):
        self.env, self.residual, self.hold = env, residual, hold

    def gait_actions(self, observations: NDArray[np.float64], actions: Actions) -> Actions:
        """Gait actions (n, 7) that actions (n, 7) mean at observations (n, 36)."""
        if self.residual is None:
            return actions
        return self.residual.act(observations, actions).total


def action_rule(env: gym.Env) -> ActionRule | None:
    """The rule of an environment; None where it has wrappers that are not known to change nothing else."""
    hold, residual, layer = 1, None, env
    while isinstance(layer, gym.Wrapper):
        if residual is None and _steps_as(layer, ActionHold):
            hold *= layer.periods  # type: ignore[attr-defined]
        elif residual is None and _steps_as(layer, ResidualAction):
            residual = layer
        elif type(layer) is not OrderEnforcing:
            return None
        layer = layer.env
    if not isinstance(layer, GaitEnv):
        return None
    if residual is None:
        return ActionRule(layer, None, hold)
    if type(residual.policy) not in {TwoStagePolicy, RandomPolicy}:  # type: ignore[attr-defined]
        return None  # it may remember, or depend on what else is in the batch
    return ActionRule(layer, residual, hold)  # type: ignore[arg-type]


def _steps_as(layer: Any, wrapper: type[gym.Wrapper]) -> bool:
    """Whether a layer is such a wrapper, or differs from it in nothing that acts."""
    return isinstance(layer, wrapper) and all(
        getattr(type(layer), name) is getattr(wrapper, name) for name in ("reset", "step")
    )


MAX_STEPS = 1_000_000  # of an episode; only an environment that never ends gets there
Ints = NDArray[np.int64]
Watch = Callable[[Any], None]  # of the robots, after the start of an episode and after every planning period


class Robots(Protocol):
    """What the loop runs scenarios on; each robot holds one episode at a time."""

    n: int

    def begin(self, k: int, scenario: Scenario) -> None:
        """Begin a scenario with robot k."""
        ...

    def rest(self, k: int) -> None:
        """Robot k is no longer needed."""
        ...

    def observe(self, rows: Ints) -> Any:
        """What the policy is to see of the robots `rows`; asked for once a step."""
        ...

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """Act with the robots `rows`; returns those whose episode has ended, in rising order."""
        ...

    def ending(self, k: int) -> Ending:
        """How the episode of robot k has ended."""
        ...


def run_episodes(
    robots: Robots, policy: Policy, scenarios: Iterable[Scenario], policy_name: str
) -> Iterator[tuple[int, Outcome]]:
    """Run scenarios to their ends; yields (number of the scenario, outcome) as they finish.

    Args:
        robots: what they held before is lost.
        policy: acts for all robots in one call; its state starts anew with each episode.
        scenarios: taken one at a time, when a robot is free: what has been yielded may decide what comes.
        policy_name: for the outcomes.

    Raises:
        InvalidValueError: an episode that never ends.
    """
    # Over 40 lines, as the queue, the robots' states and the ends that are yielded belong to one loop.
    queue, running = enumerate(scenarios), {}
    steps, live = np.zeros(robots.n, np.int64), np.zeros(robots.n, np.bool_)

    def fill(k: int) -> None:
        steps[k], live[k] = 0, False
        if (numbered := next(queue, None)) is None:
            robots.rest(k)
            return
        robots.begin(k, numbered[1])
        running[k], live[k] = numbered, True

    for k in range(robots.n):
        fill(k)
    state: Any = None
    rows = np.flatnonzero(live)
    while len(rows):
        if steps[rows].max() >= MAX_STEPS:
            raise _endless(running[int(rows[steps[rows].argmax()])][1])
        action, state = policy.predict(
            robots.observe(rows), state=state, episode_start=steps[rows] == 0, deterministic=True
        )
        ended = robots.step(rows, action)
        steps[rows] += 1
        for k in ended:
            number, scenario = running.pop(k)
            yield number, Outcome.of(scenario, policy_name, robots.ending(k), int(steps[k]))
            fill(k)
        if ended:
            state = _of_those_left(state, live[rows])
            rows = np.flatnonzero(live)


def _of_those_left(state: Any, left: NDArray[np.bool_]) -> Any:
    """A policy's state without the rows of robots that rest; nothing of it where all do."""
    if state is None or not left.any():
        return None
    return state if left.all() else tuple(part[left] for part in state)


def _endless(scenario: Scenario) -> InvalidValueError:
    return InvalidValueError(f"scenario {scenario.id!r} did not end within {MAX_STEPS} steps")


def planning_period(env: gym.Env) -> float:
    """Simulated time of one environment step [s]: the environment's `dt`, otherwise 10 ms."""
    return float(getattr(env.unwrapped, "dt", 0.01))


def rollout(
    env: gym.Env, policy: Policy, scenario: Scenario, policy_name: str, watch: Watch | None = None
) -> Outcome:
    """Run one scenario to its end.

    The policy's state starts anew, and all randomness is the scenario's: the same scenario and policy give
    the same outcome bit for bit, whatever ran before.

    Args:
        env: any environment of this project, wrapped or not, or one with its options and info.
        policy: acts; it is handed what its `predict` takes, and the scenario where it has a method
            `begin_scenario`, as what replays stored answers has, and what refuses some scenarios.
        scenario: what happens.
        policy_name: for the outcome.
        watch: called with the `GymRobot` after reset and after every step, to look, not to touch.
    """
    policy = as_policy(policy)
    robot = GymRobot(env, watch)
    begin_policy(policy, scenario)
    _, outcome = next(run_episodes(robot, policy, (scenario,), policy_name))
    return outcome


def begin_policy(policy: Policy, scenario: Scenario) -> None:
    """Let a policy that acts alone begin a scenario, where it has something to begin."""
    if hasattr(policy, "reset"):
        policy.reset(seed=scenario.noise_seed)  # type: ignore[attr-defined]
    if hasattr(policy, "begin_scenario"):  # replays by scenario, or does not act in every one
        policy.begin_scenario(scenario)  # type: ignore[attr-defined]


class GymRobot:
    """The one robot of a Gymnasium environment, whose info says how its episode ends."""

    n = 1

    def __init__(self, env: gym.Env, watch: Watch | None = None):
        self.env, self._watch = env, watch
        self.info: dict[str, Any] = {}  # of the last step or reset
        self.ended = False
        self._observation: Any = None
        episodes = getattr(env.unwrapped, "episodes", None)
        self._meter = StepMeter(episodes) if isinstance(episodes, GaitEpisodes) else None
        self._steps, self._total, self._fell = 0, 0.0, False

    def begin(self, k: int, scenario: Scenario) -> None:
        """Reset to a scenario."""
        self._observation, self.info = self.env.reset(
            seed=scenario.noise_seed, options={"scenario": scenario}
        )
        self._steps, self._total, self._fell, self.ended = 0, 0.0, False, False
        if self._meter is not None:
            self._meter.begin(k)
        self._look()

    def rest(self, k: int) -> None:
        """Nothing is left to do."""

    def observe(self, rows: Ints) -> Any:
        """The observation as the environment gives it, not as a batch."""
        return self._observation

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """One environment step."""
        self._observation, reward, terminated, truncated, self.info = self.env.step(actions)
        self._total += float(reward)
        self._steps += 1
        self._fell, self.ended = bool(terminated), bool(terminated or truncated)
        self._look()
        return [0] if self.ended else []

    def ending(self, k: int) -> Ending:
        """What the info of the last step says."""
        info = self.info
        return Ending(
            fell=self._fell,
            time=float(info.get("time", self._steps * planning_period(self.env))),
            recovered_at=info.get("recovered_at"),
            failure_reason=info.get("failure_reason"),
            total_reward=self._total,
            bounds=bounds_met(getattr(self.env.unwrapped, "episodes", None), k),
            measures={} if self._meter is None else self._meter.of(k),
        )

    def _look(self) -> None:
        if self._watch is not None:
            self._watch(self)


def bounds_met(episodes: Any, k: int) -> BoundsReport:
    """The bounds that robot k of the episodes has met; none where its core keeps no record."""
    met = getattr(getattr(episodes, "core", None), "bounds_met", None)
    return NO_BOUNDS if met is None else met(k)


class Slots:
    """The robots of a core, for `run_episodes`.

    Args:
        episodes: of the core; what they held before is lost.
        rule: what an action means, see `action_rule`; an action for one period without it.
        watch: called with the slots after the start of an episode and after every planning period.
    """

    def __init__(self, episodes: GaitEpisodes, rule: ActionRule | None = None, watch: Watch | None = None):
        self.episodes, self.n = episodes, episodes.n
        self._rule, self._watch = rule, watch
        self._hold = 1 if rule is None else rule.hold
        self._actions = np.zeros((episodes.n, episodes.action_size), np.float32)
        self._begun = np.zeros(episodes.n, np.bool_)
        self._total = np.zeros(episodes.n)  # reward
        self._meter = EffortMeter(episodes)
        self._ends: dict[int, Ending] = {}  # by slot; without the reward of the held action

    def begin(self, k: int, scenario: Scenario) -> None:
        """Begin a scenario in slot k."""
        self._total[k] = 0.0
        self._enter(k, scenario)
        self._meter.begin(k)
        self._begun[k] = True
        self._look()

    def _enter(self, k: int, scenario: Scenario) -> None:
        """Put robot k where the scenario begins."""
        self.episodes.begin(k, scenario)

    def rest(self, k: int) -> None:
        """Leave slot k empty; a robot that has fallen rests, so that it costs no physics."""
        if not self._begun[k]:
            self.episodes.begin(k, Scenario("empty"))
            self._begun[k] = True
        self.episodes.failure()[k] = 1

    def observe(self, rows: Ints) -> NDArray[np.float64]:
        """Observations (len(rows), observation_size)."""
        return self.episodes.seen[rows]

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """One action of the episodes in `rows`, for as long as it is held; returns the slots that ended.

        Raises:
            InvalidValueError: actions of another shape or not finite.
        """
        held = check_action(actions, "actions", (len(rows), self.episodes.action_size))
        live = np.zeros(self.n, np.bool_)
        live[rows] = True

        def act(live: Mask) -> Actions:
            self._actions[live] = self._gait_actions(np.flatnonzero(live), held[live[rows]])
            return self._actions

        came = hold_action(self.episodes, live, self._hold, act, self._end, self._after_period)
        self._total[rows] += came.reward[rows]
        return sorted(self._ends)

    def ending(self, k: int) -> Ending:
        """Of the episode that has ended in slot k."""
        ending = self._ends.pop(k)
        return replace(ending, total_reward=float(self._total[k]))

    def _gait_actions(self, rows: Ints, actions: Actions) -> Actions:
        if self._rule is None:
            return actions
        return self._rule.gait_actions(self.episodes.core.observation[rows], actions)

    def _end(self, over: Mask, left: int, came: Held) -> None:
        """Keep what becomes of the slots `over`; within a held action their robots go on."""
        episodes = self.episodes
        for k in np.flatnonzero(over).tolist():
            self._ends[k] = Ending(
                fell=bool(came.failed[k]),
                time=float(episodes.motion().time[k]),
                recovered_at=episodes.monitor.recovered_at(k),
                failure_reason=episodes.failures[episodes.failure()[k]],
                total_reward=0.0,
                bounds=bounds_met(episodes, k),
                measures=self._meter.of(k),
            )

    def _after_period(self) -> None:
        self._meter.look()
        self._look()

    def _look(self) -> None:
        if self._watch is not None:
            self._watch(self)


def batch_episodes(env: gym.Env, n: int, threads: int = 1) -> GaitEpisodes | None:
    """Episodes of n robots as the environment has one; None where it is wrapped or acts in a way of its own.

    Bipeds share `threads`; pendulums cost too little to share.
    """
    while type(env) is OrderEnforcing:
        env = env.env
    own = isinstance(env, GaitEnv) and all(
        getattr(type(env), name) is getattr(GaitEnv, name) for name in ("reset", "step")
    )
    return env.episodes.alike(n, threads) if own else None  # type: ignore[attr-defined]


def plans_batches(policy: Policy) -> bool:
    """Whether an action of the policy is known not to depend on what else is in the batch."""
    return type(policy) in {TwoStagePolicy, RandomPolicy, NetworkPolicy}


def rollout_batch(
    episodes: GaitEpisodes,
    policy: Policy,
    scenarios: Iterable[Scenario],
    policy_name: str,
    rule: ActionRule | None = None,
) -> Iterator[Outcome]:
    """Run scenarios to their ends, one in each slot of the core; yields outcomes as they finish.

    An outcome is that of `rollout` in every field, whatever runs beside it.

    Args:
        episodes: the slots; what they held before is lost.
        policy: one that `plans_batches`.
        scenarios: taken one at a time, when a slot is free: what has been yielded may decide what comes.
        policy_name: for the outcomes.
        rule: what an action means, see `action_rule`; a gait action for one period without it.

    Raises:
        InvalidValueError: actions of another shape or not finite, or an episode that never ends.
    """
    slots = Slots(episodes, rule)
    return (outcome for _, outcome in run_episodes(slots, policy, scenarios, policy_name))


def rollout_all(
    env: gym.Env, policy: Policy, scenarios: Sequence[Scenario], policy_name: str, slots: int
) -> list[Outcome]:
    """Outcomes in the order of the scenarios; up to `slots` side by side where that changes none of them."""
    rule = action_rule(env) if plans_batches(policy) else None
    episodes = None if rule is None else batch_episodes(rule.env, min(slots, max(len(scenarios), 1)))
    if episodes is None:
        return [rollout(env, policy, scenario, policy_name) for scenario in scenarios]
    found = dict(run_episodes(Slots(episodes, rule), policy, scenarios, policy_name))
    return [found[number] for number in range(len(scenarios))]
