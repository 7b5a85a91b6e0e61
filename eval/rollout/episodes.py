"""The episode loop: scenarios to outcomes, on one robot or on many side by side, bit for bit the same.

`run_episodes` runs on anything that is `Robots`: the one robot of a Gymnasium environment (`GymRobot`), or
all that share a core (`Slots`). Whoever looks on is an `Observer`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.policies.interface import Policy, action_and_state, as_policy, declares
from ...envs.biped.limits_record import LimitsReport
from ...envs.episode.episodes import GaitEpisodes, Held, Mask, hold_action
from ...envs.episode.gym_env import GaitEnv, check_action
from ...envs.scenario.scenario import Scenario
from ...envs.wrappers import ActionHold, ResidualAction
from .outcome import NO_LIMITS, EffortMeter, Ending, Outcome

Actions = NDArray[np.float32]


@dataclass(frozen=True)
class ActionRule:
    """`ActionHold` around `ResidualAction`, each where there is one, for many robots; the same bits."""

    env: GaitEnv  # below
    residual: ResidualAction | None = None  # whose policy acts below; None: actions are gait actions
    hold: int = 1  # planning periods for which an action is held

    def gait_actions(self, observations: NDArray[np.float64], actions: Actions) -> Actions:
        """Gait actions (n, 7) that actions (n, 7) mean at observations (n, 36)."""
        if self.residual is None:
            return actions
        return self.residual.act(observations, actions).total


def action_rule(env: gym.Env) -> ActionRule | None:
    """The rule of an environment; None where it has wrappers that are not known to change nothing else.

    A policy below has to be `batchable` and to remember nothing.
    """
    hold, layer = 1, env
    residual: Any = None
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
    if residual is None or all(declares(residual.policy, name) for name in ("batchable", "memoryless")):
        return ActionRule(layer, residual, hold)
    return None


def _steps_as(layer: Any, wrapper: type[gym.Wrapper]) -> bool:
    """Whether a layer is such a wrapper, or differs from it in nothing that acts."""
    return isinstance(layer, wrapper) and all(
        getattr(type(layer), name) is getattr(wrapper, name) for name in ("reset", "step")
    )


MAX_STEPS = 1_000_000  # of an episode; only an environment that never ends gets there
Ints = NDArray[np.int64]
Watch = Callable[[Any], None]  # of the robots, after the start of an episode and after every step


class Observer:
    """Looks on at an episode loop; whoever watches overrides what is of use.

    It is handed the robots that the loop runs on, whose `episodes` are those of the core; a `GymRobot` also
    has `env`, `info` and `ended`.
    """

    def begin(self, robots: Any, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario; where nothing else is said, looked at as after a step."""
        self.after_step(robots, np.array([k]))

    def after_step(self, robots: Any, rows: Ints) -> None:
        """The robots `rows` have acted, and none that has ended has begun anew."""

    def end(self, robots: Any, k: int, outcome: Outcome) -> None:
        """The episode of robot k has ended, and nothing has moved it since."""


class _Calling(Observer):
    def __init__(self, watch: Watch):
        self._watch = watch

    def after_step(self, robots: Any, rows: Ints) -> None:
        self._watch(robots)


class Robots(Protocol):
    """The robots of an episode loop; each holds one episode at a time."""

    n: int

    def begin(self, k: int, scenario: Scenario) -> None:
        """Begin a scenario with robot k."""
        ...

    def rest(self, k: int) -> None:
        """Robot k is no longer needed."""
        ...

    def observe(self, rows: Ints) -> Any:
        """Observations of the robots `rows`, for the policy; asked for once a step."""
        ...

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """Act with the robots `rows`; returns those whose episode has ended, in rising order."""
        ...

    def ending(self, k: int) -> Ending:
        """The end of robot k's episode."""
        ...


def run_episodes(
    robots: Robots,
    policy: Policy,
    scenarios: Iterable[Scenario],
    policy_name: str,
    watch: Observer | Watch | None = None,
) -> Iterator[tuple[int, Outcome]]:
    """Run scenarios to their ends; yields (number of the scenario, outcome) as they finish.

    Args:
        robots: what they held before is lost.
        policy: acts for all robots in one call; its state starts anew with each episode.
        scenarios: taken one at a time, when a robot is free: what has been yielded may decide what comes.
        policy_name: for the outcomes.
        watch: looks on; a function is called with the robots after each start and each step.

    Raises:
        InvalidValueError: an episode that never ends.
    """
    observer = watch if isinstance(watch, Observer) else Observer() if watch is None else _Calling(watch)
    queue, running = enumerate(scenarios), {}
    steps, live = np.zeros(robots.n, np.int64), np.zeros(robots.n, np.bool_)

    def fill(k: int) -> None:
        steps[k], live[k] = 0, False
        if (numbered := next(queue, None)) is None:
            robots.rest(k)
            return
        robots.begin(k, numbered[1])
        running[k], live[k] = numbered, True
        observer.begin(robots, k, numbered[1])

    for k in range(robots.n):
        fill(k)
    state: Any = None
    rows = np.flatnonzero(live)
    while len(rows):
        if steps[rows].max() >= MAX_STEPS:
            scenario = running[int(rows[steps[rows].argmax()])][1]
            raise InvalidValueError(f"scenario {scenario.id!r} did not end within {MAX_STEPS} steps")
        action, state = action_and_state(
            policy.predict(
                robots.observe(rows), state=state, episode_start=steps[rows] == 0, deterministic=True
            )
        )
        ended = robots.step(rows, action)
        steps[rows] += 1
        observer.after_step(robots, rows)
        for k in ended:
            number, scenario = running.pop(k)
            outcome = Outcome.of(scenario, policy_name, robots.ending(k), int(steps[k]))
            observer.end(robots, k, outcome)
            yield number, outcome
            fill(k)
        if ended:
            state = _of_those_left(state, live[rows])
            rows = np.flatnonzero(live)


def _of_those_left(state: Any, left: NDArray[np.bool_]) -> Any:
    """A policy's state without the rows of robots that rest; nothing of it where all do."""
    if state is None or not left.any():
        return None
    return state if left.all() else tuple(part[left] for part in state)


def planning_period(env: gym.Env) -> float:
    """Simulated time of one environment step [s]: the environment's `dt`, otherwise 10 ms."""
    return float(getattr(env.unwrapped, "dt", 0.01))


def rollout(
    env: gym.Env, policy: Policy, scenario: Scenario, policy_name: str, watch: Observer | Watch | None = None
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
        watch: looks on; a function is called with the `GymRobot` after reset and after every step.
    """
    policy = as_policy(policy)
    begin_policy(policy, scenario)
    with GymRobot(env) as robot:
        _, outcome = next(run_episodes(robot, policy, (scenario,), policy_name, watch))
    return outcome


def begin_policy(policy: Policy, scenario: Scenario) -> None:
    """Let a policy that acts alone begin a scenario, where it has something to begin."""
    if hasattr(policy, "reset"):
        policy.reset(seed=scenario.noise_seed)  # type: ignore[attr-defined]
    if hasattr(policy, "begin_scenario"):
        policy.begin_scenario(scenario)  # type: ignore[attr-defined]


class GymRobot:
    """The one robot of a Gymnasium environment, whose info says how its episode ends.

    A context manager: within it a robot of this project is measured at every planning period of its own,
    also within an action that is held, and the running means of wrappers stay as they are.
    """

    n = 1

    def __init__(self, env: gym.Env):
        self.env = env
        self.info: dict[str, Any] = {}  # of the last step or reset
        self.ended = False
        self.episodes: Any = getattr(env.unwrapped, "episodes", None)
        self._meter = EffortMeter(self.episodes) if isinstance(env.unwrapped, GaitEnv) else None
        self._observation: Any = None
        self._steps, self._total, self._fell = 0, 0.0, False
        self.reward = np.zeros(1)  # of the last step
        self._learning: list[Any] = []  # wrappers whose running means wait

    def __enter__(self) -> Self:
        layer: Any = self.env
        while isinstance(layer, gym.Wrapper):
            if getattr(layer, "update_running_mean", False) is True:
                layer.update_running_mean = False  # type: ignore[attr-defined]
                self._learning.append(layer)
            layer = layer.env
        if self._meter is not None:
            self.env.unwrapped.after_period.append(self._meter.look)  # type: ignore[attr-defined]
        return self

    def __exit__(self, *_: object) -> None:
        while self._learning:
            self._learning.pop().update_running_mean = True
        if self._meter is not None:
            self.env.unwrapped.after_period.remove(self._meter.look)  # type: ignore[attr-defined]

    def begin(self, k: int, scenario: Scenario) -> None:
        """Reset to a scenario."""
        self._observation, self.info = self.env.reset(
            seed=scenario.noise_seed, options={"scenario": scenario}
        )
        self._steps, self._total, self._fell, self.ended = 0, 0.0, False, False
        if self._meter is not None:
            self._meter.begin(k)

    def rest(self, k: int) -> None:
        """Nothing is left to do."""

    def observe(self, rows: Ints) -> Any:
        """The observation as the environment gives it, not as a batch."""
        return self._observation

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """One environment step."""
        self._observation, reward, terminated, truncated, self.info = self.env.step(actions)
        self.reward[0] = reward
        self._total += float(reward)
        self._steps += 1
        self._fell, self.ended = bool(terminated), bool(terminated or truncated)
        return [0] if self.ended else []

    def ending(self, k: int) -> Ending:
        """End of the episode by the info of the last step."""
        info = self.info
        return Ending(
            fell=self._fell,
            time=float(info.get("time", self._steps * planning_period(self.env))),
            recovered_at=info.get("recovered_at"),
            failure_reason=info.get("failure_reason"),
            total_reward=self._total,
            bounds=limits_met(self.episodes, k),
            measures={} if self._meter is None else self._meter.of(k),
        )


def limits_met(episodes: Any, k: int) -> LimitsReport:
    """Bounds that robot k of the episodes has met; none where its core keeps no record."""
    met = getattr(getattr(episodes, "core", None), "limits_met", None)
    return NO_LIMITS if met is None else met(k)


class Slots:
    """The robots of a core, which all move in one planning period; each slot holds an episode.

    Args:
        episodes: of the core; what they held before is lost.
        rule: what an action means, see `action_rule`; an action for one period without it.
        enter: puts robot k where a scenario begins; by default `episodes.begin`.
    """

    def __init__(
        self,
        episodes: GaitEpisodes,
        rule: ActionRule | None = None,
        enter: Callable[[int, Scenario], None] | None = None,
    ):
        self.episodes, self.n = episodes, episodes.n
        self._rule, self._enter = rule, enter or episodes.begin
        self._hold = 1 if rule is None else rule.hold
        self._actions = np.zeros((episodes.n, episodes.action_size), np.float32)
        self._begun = np.zeros(episodes.n, np.bool_)
        self.reward = np.zeros(episodes.n)  # of the last step
        self._total = np.zeros(episodes.n)  # since the episode began
        self._meter = EffortMeter(episodes)
        self._ends: dict[int, Ending] = {}  # by slot; without the reward of the held action

    def begin(self, k: int, scenario: Scenario) -> None:
        """Begin a scenario in slot k."""
        self._total[k] = 0.0
        self._enter(k, scenario)
        self._meter.begin(k)
        self._begun[k] = True

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

        done = hold_action(self.episodes, live, self._hold, act, self._end, self._meter.look)
        self.reward[rows] = done.reward[rows]
        self._total[rows] += done.reward[rows]
        return sorted(self._ends)

    def ending(self, k: int) -> Ending:
        """The end of the episode in slot k."""
        ending = self._ends.pop(k)
        return replace(ending, total_reward=float(self._total[k]))

    def _gait_actions(self, rows: Ints, actions: Actions) -> Actions:
        if self._rule is None:
            return actions
        return self._rule.gait_actions(self.episodes.core.observation[rows], actions)

    def _end(self, over: Mask, left: int, done: Held) -> None:
        """Keep the ends of the slots `over`; within a held action their robots go on."""
        episodes = self.episodes
        for k in np.flatnonzero(over).tolist():
            self._ends[k] = Ending(
                fell=bool(done.failed[k]),
                time=float(episodes.motion().time[k]),
                recovered_at=episodes.monitor.recovered_at(k),
                failure_reason=episodes.failures[episodes.failure()[k]],
                total_reward=0.0,
                bounds=limits_met(episodes, k),
                measures=self._meter.of(k),
            )


def batch_episodes(env: gym.Env, n: int, threads: int = 1) -> GaitEpisodes | None:
    """Episodes of n robots as the environment has one; None where it is wrapped or acts in a way of its own.

    Bipeds share `threads`; pendulums cost too little to share.
    """
    while type(env) is OrderEnforcing:
        env = env.env
    own = isinstance(env, GaitEnv) and all(
        getattr(type(env), name) is getattr(GaitEnv, name) for name in ("reset", "step")
    )
    return env.episodes.clone(n, threads) if own else None  # type: ignore[attr-defined]


def plans_batches(policy: Policy) -> bool:
    """Whether an action of the policy does not depend on what else is in the batch, see `Policy`."""
    return declares(policy, "batchable")


def rollout_batch(
    episodes: GaitEpisodes,
    policy: Policy,
    scenarios: Iterable[Scenario],
    policy_name: str,
    rule: ActionRule | None = None,
) -> Iterator[Outcome]:
    """Outcomes of `run_episodes` on `Slots` as they finish, for a policy that `plans_batches`.

    An outcome is that of `rollout` in every field, whatever runs beside it.
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
