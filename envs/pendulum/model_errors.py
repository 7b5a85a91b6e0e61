"""Model errors of n pendulums: mass, slope, late actions, noisy observations.

A pendulum m (1 + e) times as heavy, its trunk's inertia alike, falls as before, but a push F and a trunk
torque tau move it less: F / (1 + e), theta'' / (1 + e). A floor that rises by s pulls it downhill with
m g tan(s); the part of gravity normal to the floor stays g. With a delay d, CoP and trunk acceleration of an
action act from d after its period began; place and time of the step count at once. An action for a step that
is over when its time comes moves the CoP as a touchdown does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit
from ...controllers.errors import InvalidValueError
from ...controllers.model.frame import side_sign
from ...controllers.model.gait_box import COP, TRUNK
from ...controllers.model.observation import PUSH_ESTIMATE
from ...controllers.model.robot import GRAVITY
from ..scenario.model_errors import BOUNDS
from ..scenario.noise import counter_seed
from ..scenario.observation_noise import (
    COM_NOISE,
    MOTION_NOISES,
    VELOCITY_NOISE,
    add_motion_noise,
    motion_noise,
)
from ..scenario.scenario import EXACT_SENSING, Scenario
from .support import supported_cop, transferred_cop

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

KNOWN = ("mass", "slope_forward", "slope_left", "delay", "dcm_noise")
INSTANT = 1e-9  # [s]
# Columns of what an action asked for; of a pair (x, y) the first one
ASKED_COP = 0  # pair, from the stance sole [m]
ASKED_TRUNK = 2  # pair, trunk acceleration [rad/s^2]
ASKED_STEP = 4  # number of the step that it was for
ASKED_SIZE = 5

_PUSH = PUSH_ESTIMATE.start


class PendulumErrors(NamedTuple):
    """What the compiled loops need of the errors of n pendulums."""

    weight: Array  # (n,) true mass over the believed one
    downhill: Array  # (n, 2) of gravity along the floor, over the believed mass [m/s^2]
    lag: Ints  # (n,) whole periods of the delay
    rest: Array  # (n,) what is left of it [s]
    deviation: Array  # (n,) of the observed DCM [m]
    seed: Ints  # (n,)
    period: Ints  # (n,) since reset
    asked: Array  # (n, L, ASKED_SIZE) ring over periods, columns see above; world axes


def no_errors(n: int, dt: float) -> PendulumErrors:
    """Arrays of n pendulums without errors, planned for every `dt` [s]."""
    longest = math.ceil(BOUNDS["delay"][2] / dt) + 2
    return PendulumErrors(
        weight=np.ones(n), downhill=np.zeros((n, 2)), lag=np.zeros(n, np.int64), rest=np.zeros(n),
        deviation=np.zeros(n), seed=np.zeros(n, np.int64), period=np.zeros(n, np.int64),
        asked=np.zeros((n, longest, ASKED_SIZE)),
    )  # fmt: skip


def assign_errors(table: PendulumErrors, k: int, scenario: Scenario, dt: float) -> None:
    """Give pendulum k the errors of a scenario, at its beginning.

    Raises:
        InvalidValueError: for an error, an option of the physics or a sensing that a pendulum cannot have.
    """
    if scenario.sensing != EXACT_SENSING:
        raise InvalidValueError(
            f"the pendulum has no sensors: sensing must be {EXACT_SENSING!r}, got {scenario.sensing!r}"
        )
    if options := scenario.physics.to_dict():
        raise InvalidValueError(
            f"the pendulum is integrated exactly and has no options of physics, got {options}"
        )
    errors = scenario.errors
    errors.require_only("the pendulum", KNOWN)
    lag = math.floor((errors.delay + INSTANT) / dt)
    rest = errors.delay - lag * dt
    table.weight[k] = 1.0 + errors.mass
    slopes = math.tan(errors.slope_forward), math.tan(errors.slope_left)
    table.downhill[k] = 0.0 - GRAVITY * slopes[0], 0.0 - GRAVITY * slopes[1]
    table.lag[k], table.rest[k] = lag, rest if rest > INSTANT else 0.0
    table.deviation[k] = errors.dcm_noise
    table.seed[k] = counter_seed(scenario.noise_seed)
    table.period[k] = 0
    table.asked[k] = 0.0
    table.asked[k, :, ASKED_STEP] = -1.0  # before reset: for no step of this episode


@njit(cache=True)
def acting(s, e, k, ago, left, p):  # pragma: no cover
    """CoP from the stance sole (2) and trunk acceleration (2) of the action of `ago` periods before this."""
    size = e.asked.shape[1]
    row = e.asked[k, (e.period[k] - ago) % size]
    if row[ASKED_STEP] == s.steps[k]:
        cop_x, cop_y = supported_cop(s, k, row[ASKED_COP], row[ASKED_COP + 1], p)
    else:
        cop_x, cop_y = transferred_cop(s, k, left, p)
    return cop_x, cop_y, row[ASKED_TRUNK], row[ASKED_TRUNK + 1]


@njit(cache=True)
def begin_cycle(s, e, k, dt, p):  # pragma: no cover
    """CoP (2), trunk acceleration (2) as the cycle begins, as `acting`; and when another action sets in [s].

    The acceleration is the one that the torque for the asked one gives the true trunk.
    """
    sign = side_sign(s.side[k])
    pitch = min(max(s.plan[k, TRUNK], -p.acceleration_max), p.acceleration_max) / e.weight[k]
    roll = sign * min(max(s.plan[k, TRUNK + 1], -p.acceleration_max), p.acceleration_max) / e.weight[k]
    cop_x, cop_y = s.plan[k, COP], sign * s.plan[k, COP + 1]
    if e.lag[k] == 0 and e.rest[k] == 0.0:
        cop_x, cop_y = supported_cop(s, k, cop_x, cop_y, p)
        return cop_x, cop_y, pitch, roll, np.inf
    row = e.asked[k, e.period[k] % e.asked.shape[1]]
    row[ASKED_COP], row[ASKED_COP + 1] = cop_x, cop_y
    row[ASKED_TRUNK], row[ASKED_TRUNK + 1], row[ASKED_STEP] = pitch, roll, s.steps[k]
    late, change = e.lag[k], np.inf
    if e.rest[k] > 0.0:
        late, change = late + 1, s.time[k] + e.rest[k]
    cop_x, cop_y, pitch, roll = acting(s, e, k, late, dt, p)
    return cop_x, cop_y, pitch, roll, change


@njit(cache=True)
def show(s, e, p, dt, truth, seen, first, end):  # pragma: no cover
    """Write what policies see of pendulums first..end-1, (n, 36), from observations without noise (n, 36).

    The push estimate is that of an observer who knows no other DCM: noise n of the DCM changes it by
    (n - exp(omega dt) n of the period before) / (exp(omega dt) - 1).
    """
    noise, before = np.empty(MOTION_NOISES), np.empty(MOTION_NOISES)
    grow = math.exp(p.omega * dt)
    for k in range(first, end):
        seen[k] = truth[k]
        if e.deviation[k] == 0.0:
            continue
        motion_noise(e.seed[k], e.period[k], e.deviation[k], p.omega, s.steps[k], noise)
        add_motion_noise(noise, p.omega, seen[k])
        if e.period[k] == 0:
            continue
        motion_noise(e.seed[k], e.period[k] - 1, e.deviation[k], p.omega, s.steps[k], before)
        for axis in range(2):
            now = noise[COM_NOISE + axis] + noise[VELOCITY_NOISE + axis] / p.omega
            then = before[COM_NOISE + axis] + before[VELOCITY_NOISE + axis] / p.omega
            seen[k, _PUSH + axis] += (now - grow * then) / (grow - 1.0)
