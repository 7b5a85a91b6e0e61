"""Searches for corrections of the planner: the cross-entropy method, and futures on copies of a robot.

Corrections are a row of seven for each step from the present one on, in [-1, 1] of the largest ones.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..controllers.errors import InvalidValueError
from ..controllers.model.gait_box import GAIT_SIZE, GaitLimits
from ..controllers.model.observation import ELAPSED
from ..controllers.model.robot import RobotModel
from ..controllers.policies.residual import ResidualRule, default_residual_scale
from ..controllers.policies.two_stage import make_policy
from ..controllers.validation import require_integer, require_number
from ..envs.biped.env import BipedEpisodes
from ..envs.snapshot import NEXT_CHANGE, RobotSnapshot

Actions = NDArray[np.float32]
Array = NDArray[np.float64]


class Progress(NamedTuple):
    """Places of n robots in their sequences, which is the state that `predict` returns."""

    corrections: Actions  # (n, steps, 7) of the scaled action, in [-1, 1]
    wait: NDArray[np.int64]  # (n,) planning periods until the first one; -1: it has begun
    step: NDArray[np.int64]  # (n,) index of the present one
    elapsed: Array  # (n,) of the step, when last looked at [s]


class SequenceRule:
    """A planner whose action is corrected by the row of the step: clip(base + scale x row, -1, 1).

    A step is over when the time since its begin falls. Before the first row and after the last one the
    actions are the planner's own, bit for bit.

    `scale` is a multiple of `default_residual_scale`.
    """

    def __init__(self, policy: str, robot: RobotModel, limits: GaitLimits, preset: str, scale: float):
        self._arguments = policy, robot, limits, preset, scale
        base = make_policy(policy, robot, limits, preset)
        self._rule = ResidualRule(base, robot, limits, default_residual_scale(limits, scale), None)

    @classmethod
    def of(cls, env: Any, policy: str, scale: float) -> Self:
        """The rule for the robot of an environment, or of episodes."""
        biped = getattr(env, "unwrapped", env)
        return cls(policy, biped.robot, biped.limits, biped.preset, scale)

    def __reduce__(self) -> tuple[Any, ...]:
        return SequenceRule, self._arguments

    def act(self, observations: Array, progress: Progress) -> tuple[Actions, Progress]:
        """Gait actions (n, 7) at observations (n, 36), and where the robots are after them."""
        corrections, wait, step, before = progress
        elapsed = observations[:, ELAPSED].copy()
        step = step + ((wait < 0) & (elapsed < before))
        rows = np.zeros((len(observations), GAIT_SIZE), np.float32)
        now = np.flatnonzero((wait <= 0) & (step < corrections.shape[1]))
        rows[now] = corrections[now, step[now]]
        actions = self._rule.act(observations, rows).total
        return actions, Progress(corrections, np.maximum(wait - 1, -1), step, elapsed)


def begun(corrections: Actions, wait: int = 0) -> Progress:
    """Progress at the begin of sequences (n, steps, 7) that start after `wait` planning periods."""
    n = len(corrections)
    return Progress(corrections, np.full(n, wait), np.zeros(n, np.int64), np.full(n, -np.inf))


@dataclass(frozen=True)
class SearchSettings:
    """A search over corrections of a planner that goes on planning: a row of seven for each of some steps.

    Raises:
        InvalidValueError: a field that is impossible.
    """

    most_generations: ClassVar[int]

    steps: int = 4  # from the present one on, each with a correction of its own
    population: int = 64  # attempts of a generation
    generations: int = 1  # at most
    elites: int = 8  # attempts that the next generation is drawn from
    spread: float = 0.8  # first standard deviation, as a share of the largest correction
    least_spread: float = 0.1  # that a generation keeps, in the same unit
    scale: float = 1.0  # the largest correction, as a multiple of that of BipedResidual-v0
    seed: int = 0

    def __post_init__(self) -> None:
        own = type(self).__name__
        for name, low, high in (
            ("steps", 1, 100), ("population", 2, 10_000), ("generations", 1, self.most_generations),
            ("seed", 0, None), ("elites", 1, None),
        ):  # fmt: skip
            require_integer(f"{own}.{name}", getattr(self, name), low, high)
        if self.elites > self.population:
            raise InvalidValueError(
                f"{own}.elites must be at most the population {self.population}, got {self.elites}"
            )
        self._require_positive("spread", "least_spread", "scale")

    def _require_positive(self, *names: str) -> None:
        for name in names:
            require_number(f"{type(self).__name__}.{name}", getattr(self, name), 0.0, 100.0, open_low=True)

    @property
    def size(self) -> int:
        """Numbers that are searched for."""
        return self.steps * GAIT_SIZE


class CrossEntropy:
    """Cross-entropy method: proposes candidates (population, size) in [-1, 1], a generation at a time.

        x ~ clip(N(m, diag(s^2)), -1, 1),    m <- mean of the elites,    s <- max(their deviation, least)

    (Rubinstein 1999; de Boer et al. 2005). The candidates are a function of the seed and of their values.

    Args:
        rng: of the draws.
        mean: (size,) that the first generation is drawn about.
        spread: (size,) its standard deviation.
        settings: population, elites, least spread.
    """

    def __init__(self, rng: np.random.Generator, mean: Array, spread: Array, settings: SearchSettings):
        self._rng, self._settings = rng, settings
        self.mean, self.spread = mean, spread

    def ask(self) -> Actions:
        """A generation, float32, as actions are, of numbers with four decimals, which files hold exactly."""
        drawn = self._rng.standard_normal((self._settings.population, len(self.mean)))
        candidates = np.clip(self.mean + self.spread * drawn, -1.0, 1.0)
        return np.round(candidates, DECIMALS).astype(np.float32)

    def tell(self, candidates: Actions, values: Array) -> None:
        """Say what they are worth (population,): more is better, of equal ones the first."""
        best = np.argsort(-values, kind="stable")[: self._settings.elites]
        elites = candidates[best].astype(np.float64)
        self.mean = elites.mean(axis=0)
        self.spread = np.maximum(elites.std(axis=0), self._settings.least_spread)


DECIMALS = 4


def as_text(candidates: Actions) -> list[Any]:
    """Candidates as lists of numbers that are short in JSON and become the same float32 again."""
    return np.round(candidates.astype(np.float64), DECIMALS).tolist()


WORST_MARGIN, BEST_MARGIN = -0.3, 0.05  # capture margins beyond which less or more is worth the same [m]
STANDING_MARGIN = -0.02  # least capture margin of a robot that is taken to stay up [m]
TIME_TOLERANCE = 1e-9  # times are sums of steps [s]


def worth(margin: Array) -> Array:
    """Worth of a second of standing with a capture margin [m]: clip(margin, WORST, BEST) - WORST [m]."""
    return np.clip(margin, WORST_MARGIN, BEST_MARGIN) - WORST_MARGIN


def state_of(episodes: BipedEpisodes) -> Array:
    """Positions and velocities of the first robot (nq + nv,)."""
    physics = episodes.core.physics
    return np.concatenate([physics.qpos[0], physics.qvel[0]])


class Future(NamedTuple):
    """Results of n corrections within the horizon."""

    values: Array  # (n,) int worth(m) dt over the time that the robot stands, m its capture margin [m s]
    stands: NDArray[np.bool_]  # (n,) at the end of it, with a capture margin of at least STANDING_MARGIN


class Forecast:
    """n copies of a robot, each under corrections of its own.

    They have its state and its command. What is to come of its scenario is unknown to them: of a push that
    acts on it the rest, later pushes and kicks, and changes of the command.

    Args:
        episodes: of n robots of the same kind; what they held before is lost.
        rule: how corrections are added.
        periods: planning periods of the horizon.
        outlast: a push that acts is taken to last longer by this share of the time that it has acted.
    """

    def __init__(self, episodes: BipedEpisodes, rule: SequenceRule, periods: int, outlast: float):
        self.episodes, self._rule, self._periods, self._outlast = episodes, rule, periods, outlast

    def run(self, now: RobotSnapshot, corrections: Actions) -> Future:
        """Simulate corrections (n, steps, 7), the first row of each for the step that has begun."""
        core = self.episodes.core
        self.put(now, self._outlast)
        progress, values = begun(corrections), np.zeros(self.episodes.n)
        for _ in range(self._periods):
            actions, progress = self._rule.act(core.observation, progress)
            self.episodes.step(actions)
            standing = self.episodes.failure() == 0
            if not standing.any():
                break
            values += standing * worth(core.margin)
        stands = (self.episodes.failure() == 0) & (core.margin >= STANDING_MARGIN)
        return Future(values / self.episodes.control_hz, stands)

    def put(self, now: RobotSnapshot, outlast: float) -> None:
        """Put all robots where another one is; what pushes it lasts longer by a share of its time so far."""
        core, due = self.episodes.core, now.rows[NEXT_CHANGE].item()
        scenario = replace(now.scenario, changes=now.scenario.changes[:due])
        for k in range(self.episodes.n):
            self.episodes.restore(k, now, scenario)
            core.kicks.assign(k, ())
        last = now.time - 1.0 / self.episodes.control_hz + TIME_TOLERANCE
        for i in range(len(scenario.forces)):
            start, duration = now.rows["pushes.start"][i], now.rows["pushes.duration"][i]
            if start < now.time and last < start + duration:  # it has been felt
                core.pushes.duration[:, i] = (1.0 + outlast) * (now.time - start)
            else:
                core.pushes.force[:, i], core.pushes.law[:, i] = 0.0, 0

    def after(self, now: RobotSnapshot, action: Actions) -> Array:
        """State of a robot a planning period later if nothing pushes it, see `state_of`."""
        self.put(now, 0.0)
        self.episodes.step(action)
        return state_of(self.episodes)
