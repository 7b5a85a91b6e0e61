"""The closed loop of many pendulums: sensors, variants, and the scan for the largest push.

What a policy sees of a pendulum: the truth, or a noisy and late measurement of its motion.

The measured DCM of period k is xi_k + n_k with white noise n_k. The CoM is shifted alike, so that
xi = com + v / omega still holds, and the push estimate (xi_k - predicted xi_k) / (e - 1), e = exp(omega dt),
becomes that of an observer who knows no other DCM: it gains (n_k - e n_{k-1}) / (e - 1). A delay of d periods
shows DCM, CoM, velocity and push estimate of d periods ago; feet, trunk and clock are those of now.

The closed loop of many pendulums at once, without Gymnasium.

Physics, actions and end of the episode are those of `rollout` on `PushRecovery/Pendulum-v0`, bit for bit, but
one compiled pass plans for all robots that still stand, and one moves them.

What is varied: an arm with other weights, on another robot, at another rate, with a worse measurement.

The largest push that a variant survives in one direction: one job, one row.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import islice
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, is_finite_number
from ...controllers.model.capturability import max_recoverable_force, max_recoverable_impulse
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.nominal_gait import NominalGait, nominal_gait
from ...controllers.model.observation import COM, COM_VELOCITY, DCM, PUSH_ESTIMATE, side_sign
from ...controllers.model.robot import RobotModel
from ...controllers.policies.interface import Policy
from ...controllers.policies.two_stage import TwoStagePolicy, make_policy
from ...controllers.settings import preset_config
from ...envs.pendulum.env import PendulumCore, PendulumEpisodes
from ...envs.scenario.push import GaitEvent, polar_push
from ...envs.scenario.scenario import Command, Scenario
from ..rollout.episodes import Ints, Looking, Slots, Watch, run_episodes
from ..rollout.outcome import Outcome
from ..score.frontier import BEYOND, NOMINAL_STEPS, Scanned, multiples, scan_upwards

Array = NDArray[np.float64]

BLOCK = 256  # periods whose noise is drawn at once; changes no number


@dataclass(frozen=True)
class Measurement:
    """Errors of what the policy sees."""

    dcm_noise: float = 0.0  # standard deviation of every axis and period [m]
    delay: int = 0  # whole planning periods

    def __post_init__(self) -> None:
        if not (is_finite_number(self.dcm_noise) and self.dcm_noise >= 0):
            raise InvalidValueError(f"dcm_noise must be finite and >= 0 [m], got {self.dcm_noise!r}")
        if isinstance(self.delay, bool) or not isinstance(self.delay, int) or self.delay < 0:
            raise InvalidValueError(f"delay must be an integer >= 0 [periods], got {self.delay!r}")


EXACT = Measurement()


class PendulumSensor:
    """Observations of the pendulums of a core under measurement errors.

    The noise of a pendulum is a function of its scenario's seed and the period alone.
    """

    def __init__(self, core: PendulumCore, scenarios: Sequence[Scenario], measurement: Measurement = EXACT):
        """Set up.

        Raises:
            InvalidValueError: measurement errors on top of a scenario's own noise.
        """
        if measurement != EXACT and (noisy := [s.id for s in scenarios if s.errors.dcm_noise > 0]):
            raise InvalidValueError(f"scenario {noisy[0]!r} has dcm_noise of its own beside {measurement}")
        self._core, self._measurement = core, measurement
        self._generators = [np.random.default_rng(np.random.SeedSequence(s.noise_seed)) for s in scenarios]
        self._noise = np.zeros((len(scenarios), BLOCK, 2))
        self._last_noise = np.zeros((len(scenarios), 2))
        self._past: deque[tuple[Array, Array, Array]] = deque(maxlen=measurement.delay + 1)
        self._period = 0

    def look(self) -> Array:
        """Observations (n, OBSERVATION_SIZE); call once per period. Without errors the core's own array."""
        if self._measurement == EXACT:
            return self._core.observation
        self._past.append(self._measure())
        self._period += 1
        com, velocity, push = self._past[0]  # of reset, while no older one is known
        state = self._core.state
        sign = np.stack([np.ones(len(state.side)), side_sign(state.side)], axis=1)
        seen = self._core.observation.copy()
        seen[:, COM] = sign * (com - state.stance)
        seen[:, COM_VELOCITY] = sign * velocity
        seen[:, DCM] = seen[:, COM] + seen[:, COM_VELOCITY] / self._core.robot.omega
        seen[:, PUSH_ESTIMATE] = sign * push
        return seen

    def _measure(self) -> tuple[Array, Array, Array]:
        """CoM, velocity and push estimate of now, each (n, 2), world frame."""
        state = self._core.state
        noise = self._draw()
        growth = math.exp(self._core.robot.omega * self._core.dt)
        push = state.push.copy()
        if self._period > 0:  # the first period has no DCM before it
            push += (noise - growth * self._last_noise) / (growth - 1.0)
        self._last_noise = noise
        return state.com + noise, state.velocity.copy(), push

    def _draw(self) -> Array:
        """Noise of this period (n, 2) [m], world frame."""
        if self._measurement.dcm_noise == 0.0:
            return self._last_noise
        index = self._period % BLOCK
        if index == 0:
            for block, generator in zip(self._noise, self._generators, strict=True):
                block[:] = generator.standard_normal((BLOCK, 2))
        return self._measurement.dcm_noise * self._noise[:, index]


@dataclass(frozen=True)
class Plant:
    """The pendulum that is walked with, and how often."""

    robot: RobotModel = field(default_factory=RobotModel)
    limits: GaitLimits | None = None  # of the action; the paper's for the robot by default
    preset: str = "default"  # its touchdown delay and double support are the gait's
    control_hz: float = 100.0  # [Hz]

    def episodes(self, n: int) -> PendulumEpisodes:
        """N such pendulums."""
        return PendulumEpisodes(n, self.robot, self.limits, self.preset, self.control_hz)


def run_batch(
    policy: Policy,
    scenarios: Sequence[Scenario],
    plant: Plant | None = None,
    measurement: Measurement = EXACT,
    watch: Watch | None = None,
) -> list[Outcome]:
    """Run scenarios side by side, each to its own end; what comes out does not depend on its neighbours.

    Args:
        policy: takes a batch of observations and remembers nothing.
        scenarios: what happens to each pendulum.
        plant: robot, limits and planning rate; the environment's defaults without it.
        measurement: errors of what the policy sees.
        watch: called with the slots at the start of an episode and after every period, to look, not to touch.

    Raises:
        InvalidValueError: actions of another shape or not finite, or an episode that never ends.
    """
    episodes = (Plant() if plant is None else plant).episodes(len(scenarios))
    slots = _MeasuredSlots(episodes, scenarios, measurement)
    observer = None if watch is None else Looking(watch)
    found = dict(run_episodes(slots, _PlansOnce(policy), scenarios, "pendulum", observer))
    return [found[number] for number in range(len(scenarios))]


class _MeasuredSlots(Slots):
    """Slots whose policy sees a measurement; slot k holds scenario k."""

    def __init__(
        self,
        episodes: PendulumEpisodes,
        scenarios: Sequence[Scenario],
        measurement: Measurement,
    ):
        super().__init__(episodes)
        self._sensor = PendulumSensor(episodes.core, scenarios, measurement)

    def observe(self, rows: Ints) -> Array:
        """What the sensor shows of the pendulums `rows`."""
        return self._sensor.look()[rows]


class _PlansOnce:
    """A policy that plans once where all see the same, as before their pushes differ."""

    def __init__(self, policy: Policy):
        self._policy = policy

    def predict(
        self, observation: Array, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, None]:
        """Actions (n, 7) of observations (n, 36)."""
        n, bits = len(observation), observation.view(np.uint64)
        if n > 1 and (bits[0] == bits[-1]).all() and (bits == bits[0]).all():
            return np.repeat(self._policy.predict(observation[:1])[0], n, axis=0), None
        return self._policy.predict(observation)[0], None


Pairs = tuple[tuple[str, Any], ...]


def pairs(values: Mapping[str, Any]) -> Pairs:
    """A mapping as sorted pairs, so that it can be part of a key."""
    return tuple(sorted(values.items()))


@dataclass(frozen=True)
class Variant:
    """A policy on a pendulum; equal variants give equal numbers, whatever they are called."""

    label: str  # for people
    policy: str = "two-stage"  # arm of `make_policy`
    planner: Pairs = ()  # fields of PlannerConfig that differ from the arm's
    robot: Pairs = ()  # fields of RobotModel that differ from the paper's
    control_hz: float = 100.0  # [Hz]
    preset: str = "default"
    dcm_noise: float = 0.0  # [m]
    delay: int = 0  # planning periods

    def identity(self) -> dict[str, Any]:
        """All that decides the numbers, as JSON."""
        return {
            "policy": self.policy,
            "planner": dict(self.planner),
            "robot": dict(self.robot),
            "control_hz": self.control_hz,
            "preset": self.preset,
            "dcm_noise": self.dcm_noise,
            "delay": self.delay,
        }

    @property
    def robot_model(self) -> RobotModel:
        """The paper's robot with what differs."""
        return replace(RobotModel(), **dict(self.robot))

    @property
    def measurement(self) -> Measurement:
        """Errors of what the policy sees."""
        return Measurement(self.dcm_noise, self.delay)

    @property
    def jerk_form(self) -> bool:
        """Whether stage 2 runs in the paper's form, which is solved one robot at a time and so costs most."""
        config = getattr(built(self)[0], "config", None)
        return config is not None and config.form == "jerk" and (config.use_cop or config.use_trunk)

    def gait(self, vx: float) -> NominalGait:
        """Nominal gait at a commanded speed [m/s]."""
        robot = self.robot_model
        delay = preset_config(self.preset).touchdown_delay
        return nominal_gait(robot, GaitLimits.of(robot), (vx, 0.0), delay)


@cache
def built(variant: Variant) -> tuple[Policy, Plant]:
    """Policy and pendulum of a variant, made once in a process."""
    robot = variant.robot_model
    limits = GaitLimits.of(robot)
    plant = Plant(robot, limits, variant.preset, variant.control_hz)
    arm = make_policy(variant.policy, robot, limits, variant.preset)
    if not isinstance(arm, TwoStagePolicy):
        return arm, plant
    config = replace(arm.config, first_interval_min=1.0 / variant.control_hz)
    config = replace(config, **dict(variant.planner))
    adapt = variant.policy != "passive"
    return TwoStagePolicy(robot, limits, config, adapt=adapt, name=variant.policy), plant


CHUNK = 640.0  # range of forces that are tried side by side; changes no number [N]
JUMP_TIME = 1e-4  # a push this short stands for a velocity jump: 0.02 % less shift of the DCM [s]
PUSH_TIME = 0.1  # the paper's [s]
Survives = Callable[[Sequence[float]], Sequence[bool]]


@dataclass(frozen=True)
class PushKind:
    """The push that is scanned: towards psi, at the start of a left stance after four nominal steps."""

    psi_deg: float  # counter-clockwise from forward [deg]
    duration: float = PUSH_TIME  # [s]; 0: a velocity jump, whose strength is an impulse [N s]
    vx: float = 0.0  # commanded [m/s]

    @property
    def unit(self) -> str:
        """Of the strength."""
        return "N" if self.duration > 0 else "N s"

    @property
    def unit_strength(self) -> float:
        """Strength that counts as one newton for 0.1 s."""
        return 1.0 if self.duration > 0 else PUSH_TIME

    def scenario(self, strength: float, seed: int = 0) -> Scenario:
        """The push with a strength [unit]; `seed` is that of the measurement's noise."""
        force, duration = strength, self.duration
        if duration == 0:
            force, duration = strength / JUMP_TIME, JUMP_TIME
        event = GaitEvent(NOMINAL_STEPS, "left", 0.0)
        push = polar_push(force, math.radians(self.psi_deg), duration, event)
        name = f"{self.psi_deg:g}deg-{strength:g}{self.unit.replace(' ', '')}"
        return Scenario(name, (push,), Command(self.vx), "left", noise_seed=seed)

    def limit(self, variant: Variant, **options: Any) -> float:
        """The closed form's largest strength for the variant's robot and gait; options as for the force."""
        robot, gait, psi = variant.robot_model, variant.gait(self.vx), math.radians(self.psi_deg)
        if self.duration > 0:
            return max_recoverable_force(robot, psi, self.duration, gait=gait, **options)
        return max_recoverable_impulse(robot, psi, gait=gait, **options)

    def identity(self) -> dict[str, Any]:
        """As JSON."""
        return {"psi_deg": self.psi_deg, "duration": self.duration, "vx": self.vx}


@dataclass(frozen=True)
class ScanJob:
    """Scan one direction of one variant.

    `grids` go from coarse to fine, in newtons for 0.1 s. The coarse one is scanned from its first multiple to
    BEYOND past the first failure; every finer one fills the interval that ends at the first failure so far.
    """

    FIELDS: ClassVar[tuple[str, ...]] = ("unit", "survived", "largest_survived", "failed")
    variant: Variant
    push: PushKind
    grids: tuple[float, ...] = (5.0, 1.0)
    seeds: tuple[int, ...] = (0,)  # of noise; a strength counts as survived where all of them are

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        return {
            "kind": "scan",
            **self.push.identity(),
            "grids": list(self.grids),
            "seeds": list(self.seeds),
            "variant": self.variant.identity(),
        }

    @property
    def text(self) -> str:
        """For the progress bar."""
        return f"{self.variant.label}, {self.push.psi_deg:g} deg"

    def run(self) -> dict[str, Any]:
        """Scan; strengths in the unit of the push."""
        unit = self.push.unit_strength
        found = scan(self._survives, self.grids, unit)
        return {"unit": self.push.unit, **found}

    def _survives(self, strengths: Sequence[float]) -> list[bool]:
        policy, plant = built(self.variant)
        scenarios = [self.push.scenario(strength, seed) for strength in strengths for seed in self.seeds]
        endings = run_batch(policy, scenarios, plant, self.variant.measurement)
        n = len(self.seeds)
        return [all(e.survived for e in endings[n * k : n * (k + 1)]) for k in range(len(strengths))]


@dataclass(frozen=True)
class EpisodeJob:
    """One push of one variant."""

    FIELDS: ClassVar[tuple[str, ...]] = (
        "survived", "recovered", "recovered_at", "failure_reason", "end_time",
    )  # fmt: skip
    kind: ClassVar[str] = "episode"  # of the row
    variant: Variant
    push: PushKind
    strength: float

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        about = {**self.push.identity(), "strength": self.strength}
        return {"kind": self.kind, **about, "variant": self.variant.identity()}

    @property
    def text(self) -> str:
        """For the progress bar."""
        return f"{self.variant.label}, {self.strength:g} {self.push.unit}"

    def run(self) -> dict[str, Any]:
        """Run it."""
        policy, plant = built(self.variant)
        scenario = self.push.scenario(self.strength)
        ending = run_batch(policy, [scenario], plant, self.variant.measurement)[0]
        return {
            "survived": ending.survived,
            "recovered": ending.recovered,
            "recovered_at": ending.recovered_at,
            "failure_reason": ending.failure_reason,
            "end_time": ending.end_time,
        }


def scan(survives: Survives, grids: Sequence[float], unit: float = 1.0) -> dict[str, Any]:
    """Largest strength before the first failure, the largest survived at all, and what failed.

    Args:
        survives: whether each of several strengths is survived.
        grids: coarse to fine, in units of `unit`.
        unit: of grids, BEYOND and the cap.
    """
    outcome = scan_upwards(
        lambda wanted: _in_chunks(survives, wanted, max(1, round(CHUNK / grids[0]))),
        (round(force * unit, 9) for force in multiples(grids[0])),
        BEYOND * unit,
        bool,
    )
    for grid in grids[1:]:
        first = min((s for s, ok in outcome.items() if not ok), default=None)
        if first is None:
            break
        below = max((s for s, ok in outcome.items() if ok and s < first), default=0.0)
        count = math.ceil((first - below) / (grid * unit) - 1e-9)
        between = [round(below + k * grid * unit, 9) for k in range(1, count)]
        outcome.update(zip(between, survives(between), strict=True) if between else ())
    found = Scanned.of(outcome)
    return {
        "survived": found.survived,
        "largest_survived": found.largest_survived,
        "failed": list(found.failed),
    }


def _in_chunks(survives: Survives, strengths: Iterator[float], count: int) -> Iterator[tuple[float, bool]]:
    """Whether strengths are survived, `count` of them side by side."""
    while chunk := list(islice(strengths, count)):
        yield from zip(chunk, survives(chunk), strict=True)
