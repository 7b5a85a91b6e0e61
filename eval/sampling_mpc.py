"""`sampling-mpc`: the planner, and corrections of it that a simulation of the robot says it needs."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker

from ..controllers.errors import InvalidValueError
from ..controllers.files import read_file
from ..controllers.model.gait_box import GAIT_SIZE
from ..controllers.model.observation import ELAPSED
from ..controllers.validation import require_number
from ..envs.biped.env import BipedEnv, BipedEpisodes
from ..envs.scenario.model_errors import EXACT_MODEL
from ..envs.scenario.scenario import EXACT_SENSING, Scenario
from ..envs.snapshot import RobotSnapshot
from .search import Actions, Array, CrossEntropy, Forecast, SearchSettings, SequenceRule, begun, state_of

NAME = "sampling-mpc"  # of the policy
TIMES_THE_PLANNER = 25.0  # that an episode takes, about


@dataclass(frozen=True)
class SamplingMpcSettings(SearchSettings):
    """Settings of a `SamplingMpcPolicy`; `generations` are those of one planning period.

    Raises:
        InvalidValueError: a field that is impossible.
    """

    most_generations: ClassVar[int] = 1000

    horizon: float = 1.5  # how far ahead an attempt is simulated [s]
    check_period: float = 0.1  # a robot that was pushed is simulated anew this often [s] ...
    watch_time: float = 2.0  # ... for this long [s]
    outlast: float = 1.0  # a push that acts is taken to last longer by this share of its time so far

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_positive("horizon", "check_period", "watch_time")
        require_number("SamplingMpcSettings.outlast", self.outlast, 0.0, 10.0)


def sampling_mpc_source() -> bytes:
    """Text of the modules that sampling MPC is made of, with their names; outcomes hang on it."""
    paths = [Path(__file__).with_name(name) for name in ("search.py", "sampling_mpc.py")]
    return b"\0".join(path.name.encode() + b"\0" + read_file(path) for path in paths)


PLANNER = "two-stage"  # that is corrected


class Memory(NamedTuple):
    """Memory of the robot from one planning period to the next."""

    plan: Actions  # (steps, 7) corrections, the first row for the present step
    elapsed: float  # of that step, when last looked at [s]
    expected: Array  # (nq + nv,) where the robot is now, if nothing has happened to it
    since_push: int  # planning periods since something did; NEVER
    stands: bool  # whether the plan keeps it up, as far as is known
    mean: Array  # (steps, 7) of the plans to try next, where it does not
    spread: Array  # (steps, 7) their standard deviation


NEVER = 10**9


class SamplingMpcPolicy:
    """Model predictive control by sampling, with the simulation as the model, about the two-stage planner.

    In every planning period the robot is where a copy of it has been simulated to be, unless something pushes
    it. From a push on the planner's future is simulated over the horizon, again every `check_period`. Where
    the robot falls in it, corrections of the planner's seven decisions, a row for each of the next steps, are
    searched for by the cross-entropy method on copies of the robot (Kobilarov 2012), a generation or more in
    every planning period, the best plan so far among each. The plan is the best of those that keep it up in
    the first generation that has any, and until then the best of the generation. A robot that nothing pushes
    walks under the planner's own actions, bit for bit.

    It knows model and state as they are, and nothing of what is to come. Bodies that collide (`collisions`)
    do so in its copies, too.

    Args:
        env: single environment of a biped, under plain gait actions; it acts on the robot in this one alone.
        settings: of the search.

    Raises:
        InvalidValueError: another environment.
    """

    def __init__(self, env: gym.Env, settings: SamplingMpcSettings | None = None):
        self.settings = s = SamplingMpcSettings() if settings is None else settings
        self._robot = _episodes_of(env)
        biped = self._robot
        self._rule = SequenceRule.of(biped, PLANNER, s.scale)
        self._every, self._watch, periods = (
            max(1, round(time * biped.control_hz)) for time in (s.check_period, s.watch_time, s.horizon)
        )
        self._one, self._many = (
            Forecast(biped.clone(n), self._rule, periods, s.outlast) for n in (1, s.population)
        )

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Memory]:
        """Action (7,) for the robot in the environment, observed as (36,), and what to hand in next time.

        Without a state a push is not noticed, and the action is the planner's.

        Raises:
            InvalidValueError: the observation is not that of the robot in the environment, or that robot is
                not the one that the simulation knows.
        """
        seen = np.asarray(observation, np.float64)[None]
        if not np.array_equal(seen[0], self._robot.seen[0]):
            raise InvalidValueError(
                f"policy {NAME!r} acts on the robot of the environment that it was made with, and this "
                "observation is another one's"
            )
        now = self._robot.state_snapshot(0)
        if state is None or (episode_start is not None and np.any(episode_start)):
            self.begin_scenario(now.scenario)
            state = self._at_first()
        memory = self._moved_on(Memory(*state), seen[0, ELAPSED].item())
        if self._has_to_check(memory):
            memory = self._checked(memory, now)
        actions, _ = self._rule.act(seen, begun(memory.plan[None]))
        return actions[0], memory._replace(expected=self._one.after(now, actions))

    def begin_scenario(self, scenario: Scenario) -> None:
        """Refuse a robot that the simulation does not know.

        Raises:
            InvalidValueError: it has errors of the model other than `collisions`, or acts on its own sensors.
        """
        exact = replace(scenario.errors, collisions=False) == EXACT_MODEL
        if not exact or (self._robot.core.senses.forced or scenario.sensing) != EXACT_SENSING:
            raise InvalidValueError(
                f"policy {NAME!r} simulates the robot as it is and starts from its true state: it acts on "
                f"exact robots alone, and scenario {scenario.id!r} has errors of the model or own sensors"
            )

    def _at_first(self) -> Memory:
        plan = np.zeros((self.settings.steps, GAIT_SIZE), np.float32)
        none = plan.astype(np.float64)
        return Memory(plan, -np.inf, state_of(self._robot), NEVER, True, mean=none, spread=none)

    def _moved_on(self, memory: Memory, elapsed: float) -> Memory:
        """The plan from the present step on, and whether the robot is where it was to be."""
        if elapsed < memory.elapsed:
            memory = memory._replace(
                plan=_next_step(memory.plan, 0.0),
                mean=_next_step(memory.mean, 0.0),
                spread=_next_step(memory.spread, self.settings.spread),
            )
        pushed = not np.array_equal(memory.expected, state_of(self._robot))
        return memory._replace(elapsed=elapsed, since_push=0 if pushed else min(memory.since_push + 1, NEVER))

    def _has_to_check(self, memory: Memory) -> bool:
        since = memory.since_push
        return since <= self._watch and (since == 1 or since % self._every == 0 or not memory.stands)

    def _checked(self, memory: Memory, now: RobotSnapshot) -> Memory:
        """With a plan that keeps the robot up, where one is known or found."""
        if self._one.run(now, memory.plan[None]).stands[0]:
            return memory._replace(stands=True)
        if memory.stands:
            fresh = np.full_like(memory.spread, self.settings.spread)
            memory = memory._replace(mean=memory.plan.astype(np.float64), spread=fresh)
        return self._searched(memory, now)

    def _searched(self, memory: Memory, now: RobotSnapshot) -> Memory:
        """With the best plan that is found; a search that finds none goes on in the next planning period."""
        s, shape = self.settings, memory.plan.shape
        entropy = s.seed, now.scenario.noise_seed, round(now.time * self._robot.control_hz)
        rng = np.random.default_rng(np.random.SeedSequence(entropy))
        method = CrossEntropy(rng, memory.mean.ravel(), memory.spread.ravel(), s)
        best, most, stands = memory.plan, -np.inf, False
        for _ in range(s.generations):
            drawn = method.ask()
            drawn[0], drawn[1] = best.ravel(), 0.0
            tried = drawn.reshape(-1, *shape)
            future = self._many.run(now, tried)
            values = future.values + s.horizon * future.stands
            if values.max() > most:
                best, most = tried[values.argmax()].copy(), values.max()
            stands = bool(future.stands.any())
            if stands:
                break
            method.tell(drawn, values)
        mean, spread = method.mean.reshape(shape), method.spread.reshape(shape)
        return memory._replace(plan=best, stands=stands, mean=mean, spread=spread)


def _episodes_of(env: Any) -> BipedEpisodes:
    """The robot's; wrappers may hold or change actions, of which the copies would know nothing."""
    layer = env
    while type(layer) in (OrderEnforcing, PassiveEnvChecker):
        layer = layer.env
    episodes = getattr(layer, "episodes", None)
    if not (isinstance(layer, BipedEnv) and type(episodes) is BipedEpisodes):
        raise InvalidValueError(
            f"policy {NAME!r} acts on one biped under plain gait actions, such as PushRecovery/Biped-v0, got "
            f"{env}"
        )
    return episodes


def _next_step(rows: np.ndarray, fill: float) -> np.ndarray:
    """Rows (steps, 7) from the next step on."""
    return np.concatenate([rows[1:], np.full_like(rows[:1], fill)])
