"""Closed loop of many pendulums without Gymnasium: measurement errors, variants of a policy, recorded walks.

Physics, actions and end of the episode are those of `rollout` on `PushRecovery/Pendulum-v0`, bit for bit, but
one compiled pass plans for all robots that still stand, and one moves them.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.model.capturability import max_recoverable_force, max_recoverable_impulse
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.nominal_gait import NominalGait, nominal_gait
from ...controllers.model.observation import COM, COM_VELOCITY, DCM, PUSH_ESTIMATE, side_sign
from ...controllers.model.robot import RobotModel
from ...controllers.policies.interface import Policy
from ...controllers.policies.two_stage import TwoStagePolicy, make_policy
from ...controllers.settings import preset_config
from ...controllers.validation import require_integer, require_number
from ...envs.pendulum.env import PendulumCore, PendulumEpisodes
from ...envs.scenario.push import GaitEvent, polar_push
from ...envs.scenario.scenario import Command, Scenario
from ..record.record import Array, EpisodeRecord, Recorder
from ..rollout.episodes import Ints, Slots, Watch, run_episodes
from ..rollout.outcome import Outcome
from ..score.frontier import NOMINAL_STEPS

BLOCK = 256  # periods whose noise is drawn at once; changes no number
JUMP_TIME = 1e-4  # a push this short stands for a velocity jump: 0.02 % less shift of the DCM [s]
PUSH_TIME = 0.1  # the paper's [s]


@dataclass(frozen=True)
class Measurement:
    """Errors of what the policy sees."""

    dcm_noise: float = 0.0  # standard deviation of every axis and period [m]
    delay: int = 0  # whole planning periods

    def __post_init__(self) -> None:
        require_number("dcm_noise", self.dcm_noise, 0.0)
        require_integer("delay", self.delay)


EXACT = Measurement()


class PendulumSensor:
    """Observations of the pendulums of a core under measurement errors.

    The measured DCM of period k is xi_k + n_k with white noise n_k, a function of the scenario's seed and k
    alone. The CoM is shifted alike, so that xi = com + v / omega still holds, and the push estimate
    (xi_k - predicted xi_k) / (e - 1), e = exp(omega dt), becomes that of an observer who knows no other DCM:
    it gains (n_k - e n_{k-1}) / (e - 1). A delay of d periods shows DCM, CoM, velocity and push estimate of d
    periods ago; feet, trunk and clock are those of now.
    """

    def __init__(self, core: PendulumCore, scenarios: Sequence[Scenario], measurement: Measurement = EXACT):
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


def run_batch(
    policy: Policy,
    scenarios: Sequence[Scenario],
    episodes: PendulumEpisodes | None = None,
    measurement: Measurement = EXACT,
    watch: Watch | None = None,
) -> list[Outcome]:
    """Run scenarios side by side, each to its own end; no outcome depends on its neighbours.

    The policy takes batches and remembers nothing; `watch` is called with the slots at the start of an
    episode and after every period.
    """
    episodes = PendulumEpisodes(len(scenarios)) if episodes is None else episodes
    slots = _MeasuredSlots(episodes, scenarios, measurement)
    outcomes = dict(run_episodes(slots, _PlansOnce(policy), scenarios, "pendulum", watch))
    return [outcomes[number] for number in range(len(scenarios))]


class _MeasuredSlots(Slots):
    """Slots whose policy sees a measurement; slot k holds scenario k."""

    def __init__(self, episodes: PendulumEpisodes, scenarios: Sequence[Scenario], measurement: Measurement):
        super().__init__(episodes)
        self._sensor = PendulumSensor(episodes.core, scenarios, measurement)

    def observe(self, rows: Ints) -> Array:
        """Measured observations of the pendulums `rows`."""
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
    policy: str = "two-stage"  # name for `make_policy`
    planner: Pairs = ()  # fields of PlannerConfig that differ from the policy's
    robot: Pairs = ()  # fields of RobotModel that differ from the paper's
    control_hz: float = 100.0  # [Hz]
    preset: str = "default"
    dcm_noise: float = 0.0  # [m]
    delay: int = 0  # planning periods

    def identity(self) -> dict[str, Any]:
        """All that decides the numbers, as JSON."""
        fields = {name: value for name, value in asdict(self).items() if name != "label"}
        return {**fields, "planner": dict(self.planner), "robot": dict(self.robot)}

    @property
    def robot_model(self) -> RobotModel:
        """The paper's robot with what differs."""
        return replace(RobotModel(), **dict(self.robot))

    @property
    def jerk_form(self) -> bool:
        """Whether stage 2 runs in the paper's form, which is solved one robot at a time and so costs most."""
        config = getattr(self.made_policy(), "config", None)
        return config is not None and config.form == "jerk" and (config.use_cop or config.use_trunk)

    def gait(self, vx: float) -> NominalGait:
        """Nominal gait at a commanded speed [m/s]."""
        robot = self.robot_model
        delay = preset_config(self.preset).touchdown_delay
        return nominal_gait(robot, GaitLimits.of(robot), (vx, 0.0), delay)

    def episodes(self, n: int) -> PendulumEpisodes:
        """Episodes of n such pendulums."""
        return PendulumEpisodes(n, self.robot_model, preset=self.preset, control_hz=self.control_hz)

    @cache  # noqa: B019  # a variant is small, and there are some hundred
    def made_policy(self) -> Policy:
        """The policy, made once in a process."""
        robot = self.robot_model
        limits = GaitLimits.of(robot)
        policy = make_policy(self.policy, robot, limits, self.preset)
        if not isinstance(policy, TwoStagePolicy):
            return policy
        config = replace(policy.config, first_interval_min=1.0 / self.control_hz)
        config = replace(config, **dict(self.planner))
        return TwoStagePolicy(robot, limits, config, adapt=self.policy != "passive", name=self.policy)

    @property
    def measurement(self) -> Measurement:
        """Errors of what the policy sees."""
        return Measurement(self.dcm_noise, self.delay)

    def run(self, scenarios: Sequence[Scenario]) -> list[Outcome]:
        """Outcomes of scenarios side by side."""
        return run_batch(self.made_policy(), scenarios, self.episodes(len(scenarios)), self.measurement)


@dataclass(frozen=True)
class PushKind:
    """The push that is scanned: towards psi, at the start of a left stance after four nominal steps."""

    psi_deg: float  # counter-clockwise from forward [deg]
    duration: float = PUSH_TIME  # [s]; 0: a velocity jump, whose strength is an impulse [N s]
    vx: float = 0.0  # commanded [m/s]

    @property
    def unit(self) -> str:
        """Unit of the strength."""
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
        """Largest strength of the closed form for a variant, with options of that closed form."""
        robot, gait, psi = variant.robot_model, variant.gait(self.vx), math.radians(self.psi_deg)
        if self.duration > 0:
            return max_recoverable_force(robot, psi, self.duration, gait=gait, **options)
        return max_recoverable_impulse(robot, psi, gait=gait, **options)


@dataclass(frozen=True, eq=False)
class Walk(EpisodeRecord):
    """A recorded push of one variant of the pendulum, with the steps that it takes, m of them."""

    label: str  # of the variant
    com_height: float  # [m]
    foothold: Array  # (m, 2) centre of every sole that was stood on, in order [m]
    foothold_side: Ints  # (m,) 0 left, 1 right
    touchdown: Array  # (m,) when it was set down, 0 for the first [s]

    @property
    def push_start(self) -> float:
        """Onset of the push [s]."""
        return self.push_starts[0]

    @property
    def push_duration(self) -> float:
        """Duration of the push [s]."""
        return self.scenario.pushes[0].duration

    @property
    def push_force(self) -> Array:
        """Horizontal force of the push, (2,) [N]."""
        return np.array(self.scenario.pushes[0].force[:2])


def record(variant: Variant, push: PushKind, strength: float) -> Walk:
    """The time histories and the steps of one push of one variant."""
    episodes, scenario, steps = variant.episodes(1), push.scenario(strength), []
    recorder = Recorder(episodes)

    def look(_: object) -> None:
        recorder()
        state = episodes.core.state
        if not steps or state.steps[0] != steps[-1][0]:
            steps.append((state.steps[0], state.stance[0].copy(), state.side[0], state.step_start[0]))

    (outcome,) = run_batch(variant.made_policy(), [scenario], episodes, variant.measurement, look)
    _, foothold, side, touchdown = map(np.array, zip(*steps, strict=True))
    return Walk(
        **vars(recorder.finish(scenario, outcome)), label=variant.label,
        com_height=variant.robot_model.com_height, foothold=foothold,
        foothold_side=side.astype(np.int64), touchdown=touchdown,
    )  # fmt: skip
