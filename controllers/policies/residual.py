"""Learned corrections of a gait action: their scale, their gate, and the one rule that adds them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError, shown
from ..jit import njit
from ..model.gait_box import GAIT_NAMES, GAIT_SIZE, GaitLimits
from ..model.nominal_gait import NOMINAL_SIZE, check_pelvis, nominal_gait_kernel, step_start_dcm_kernel
from ..model.observation import COMMAND, DCM, ELAPSED
from ..model.robot import RobotModel
from ..validation import require_pair
from .interface import Policy, action_and_state

# What a learned correction of 1 means at factor 1, in the units of GAIT_NAMES: [m], [m], [s], [m], [m],
# [rad/s^2], [rad/s^2].
PHYSICAL_SCALE = (0.12, 0.10, 0.15, 0.06, 0.03, 12.0, 12.0)
DEFAULT_FACTOR = 1.0
DEFAULT_GATE = (0.03, 0.10)  # [m]


def default_residual_scale(limits: GaitLimits, factor: float = DEFAULT_FACTOR) -> NDArray[np.float32]:
    """Residual scale (7,) in action units: factor x PHYSICAL_SCALE x 2 / (high - low), of the gait box.

    It is 0 for an entry without a range. A factor that is negative or not finite raises InvalidValueError.
    """
    if not (math.isfinite(factor) and factor >= 0):
        raise InvalidValueError(f"residual factor must be finite and >= 0, got {factor}")
    span = limits.high - limits.low
    scale = factor * np.asarray(PHYSICAL_SCALE) * 2.0 / np.where(span > 0.0, span, np.inf)
    return np.asarray(scale, dtype=np.float32)


def check_residual_scale(scale: ArrayLike) -> NDArray[np.float32]:
    """A residual scale as (7,) float32 in action units; one number stands for all seven.

    Raises:
        InvalidValueError: Not 1 or 7 numbers, or an entry is negative or not finite.
    """
    try:
        values = np.asarray(scale, dtype=np.float32)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(
            f"residual scale must be 1 or {GAIT_SIZE} numbers, got {shown(scale)}"
        ) from None
    if values.shape not in {(), (GAIT_SIZE,)}:
        raise InvalidValueError(
            f"residual scale must be one number or {GAIT_SIZE} ({', '.join(GAIT_NAMES)}), "
            f"got shape {values.shape}"
        )
    if not (np.all(np.isfinite(values)) and np.all(values >= 0)):
        raise InvalidValueError(
            f"residual scale must be finite and >= 0 in every entry, got {values.tolist()}"
        )
    return np.array(np.broadcast_to(values, (GAIT_SIZE,)))


def compose(
    base: NDArray[np.float32], residual: NDArray[np.float32], scale: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Total action (..., 7): clip(base + scale x residual, -1, 1), the base's own bits where that adds 0."""
    shift = scale * residual
    total = np.clip(base + shift, np.float32(-1.0), np.float32(1.0))
    return np.where(shift == 0.0, base, total)


_ELAPSED, _DCM, _COMMAND = ELAPSED, DCM.start, COMMAND.start


def check_gate(band: ArrayLike) -> tuple[float, float]:
    """The band (shut, open) of a gate [m].

    Raises:
        InvalidValueError: Not two finite numbers with 0 <= shut < open.
    """
    try:
        shut, opened = require_pair("a residual gate", band)
    except InvalidValueError:
        shut = opened = 0.0
    if not 0.0 <= shut < opened:
        raise InvalidValueError(f"a residual gate is two numbers 0 <= shut < open [m], got {shown(band)}")
    return shut, opened


class ResidualGate:
    """Opening g in [0, 1] of a residual, a function of the observation alone.

        e = |xi(t) exp(-omega t) - xi_0,nom|,   g = clip((e - shut) / (open - shut), 0, 1)

    xi(t) exp(-omega t) is the measured DCM traced back to the begin of the step, xi_0,nom the nominal gait's
    there. An undisturbed walk of the policy below stays under 0.024 m and is its own, bit for bit, where
    `shut` is no less; in the first 0.3 s of one that turns at 0.3 m/s or more e is up to 0.054 m.
    It is shut on both feet: e means nothing there.

    Args:
        robot: Physical constants.
        limits: Gait box, which the nominal gait follows from.
        delay: The new foot carries load this long after T [s].
        band: (shut, open) [m].
    """

    def __init__(self, robot: RobotModel, limits: GaitLimits, delay: float, band: ArrayLike):
        check_pelvis(robot, limits)
        self.band = check_gate(band)
        self._constants = tuple(map(float, (robot.omega, robot.pelvis_width, delay, *self.band)))
        self._low, self._high = limits.low, limits.high

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Openings (n, 1) of observations (n, 36)."""
        rows = np.ascontiguousarray(observations, dtype=np.float64)
        return _openings(rows, self._constants, self._low, self._high)


@njit(cache=True)
def _openings(observations, constants, low, high):  # pragma: no cover - compiled
    omega, pelvis_width, delay, shut, opened = constants
    out = np.empty((observations.shape[0], 1), dtype=np.float32)
    nominal = np.empty(NOMINAL_SIZE)
    for i in range(observations.shape[0]):
        obs = observations[i]
        if obs[_ELAPSED] < 0.0:
            out[i, 0] = 0.0
            continue
        nominal_gait_kernel(obs[_COMMAND], obs[_COMMAND + 1], pelvis_width, low, high, omega, delay, nominal)
        start_x, start_y = step_start_dcm_kernel(nominal, pelvis_width, omega, delay, 0.0)
        back = math.exp(-omega * obs[_ELAPSED])
        error = math.hypot(obs[_DCM] * back - start_x, obs[_DCM + 1] * back - start_y)
        out[i, 0] = min(max((error - shut) / (opened - shut), 0.0), 1.0)
    return out


def make_gate(
    policy: object, robot: RobotModel, limits: GaitLimits, band: ArrayLike | None
) -> ResidualGate | None:
    """The gate of a residual on `policy`, whose touchdown delay it takes; None where there is no band.

    Raises:
        InvalidValueError: a policy with double support, whose nominal DCM the gate does not know.
    """
    if band is None:
        return None
    config = getattr(policy, "config", None)
    if (both := getattr(config, "double_support", 0.0)) > 0:
        raise InvalidValueError(f"a residual gate knows no double support, got {both} s; use no gate")
    delay = float(getattr(config, "touchdown_delay", 0.0))
    return ResidualGate(robot, limits, delay, band)


Actions = NDArray[np.float32]


class Correction(NamedTuple):
    """Corrected actions of n robots, in action units."""

    total: Actions  # (n, 7) base + shift, clipped to [-1, 1]; the base's own bits where the shift is 0
    base: Actions  # (n, 7) of the policy below
    shift: Actions  # (n, 7) scale x g x learned action


class Below(NamedTuple):
    """Actions of the policy below and openings of the gate for n robots, which corrections start from."""

    base: Actions  # (n, 7) of the policy below
    opening: Actions  # (n, 1) of the gate, in [0, 1]


class ResidualRule:
    """total = clip(base + scale x g x a, -1, 1), with g the gate's opening, 1 without a gate.

    Args:
        policy: The policy below; a gate takes its touchdown delay.
        robot: Physical constants.
        limits: Gait box, which the gate's nominal gait follows from.
        scale: (7,) in action units, see `check_residual_scale`.
        gate: (shut, open) [m], see `ResidualGate`; None: none.

    Raises:
        InvalidValueError: An impossible gate, or one on a policy with double support.
    """

    def __init__(
        self, policy: Policy, robot: RobotModel, limits: GaitLimits, scale: Actions, gate: ArrayLike | None
    ):
        self.policy, self.scale = policy, scale
        self._gate = make_gate(policy, robot, limits, gate)
        self.gate = None if self._gate is None else self._gate.band

    def opening(self, observations: NDArray[np.float64]) -> Actions:
        """Openings g (n, 1) in [0, 1] at observations (n, 36)."""
        if self._gate is None:
            return np.ones((len(observations), 1), np.float32)
        return self._gate(observations)

    def correct(self, observations: NDArray[np.float64], base: ArrayLike, learned: Actions) -> Correction:
        """Correct the base's actions (n, 7) at observations (n, 36) by learned ones (n, 7) in [-1, 1]."""
        return self._add(Below(np.asarray(base, np.float32), self.opening(observations)), learned)

    def _add(self, below: Below, learned: Actions) -> Correction:
        opened: Actions = below.opening * learned
        return Correction(compose(below.base, opened, self.scale), below.base, self.scale * opened)

    def below(self, observations: NDArray[np.float64]) -> Below:
        """Ask the policy below for n robots in one call, without a memory, and the gate for its openings.

        Raises:
            InvalidValueError: the policy has a memory.
        """
        base, state = action_and_state(self.policy.predict(observations))
        if state is not None:
            raise InvalidValueError(
                "a residual on n robots needs a policy without memory: predict gave a state"
            )
        return Below(np.asarray(base, np.float32), self.opening(observations))

    def act(self, observations: NDArray[np.float64], learned: Actions) -> Correction:
        """Correct the actions of the policy below for n robots; a base beyond [-1, 1] is clipped.

        Raises:
            InvalidValueError: the policy has a memory.
        """
        return self.total(self.below(observations), learned)

    def total(self, below: Below, learned: Actions) -> Correction:
        """Correct by learned actions (n, 7) in [-1, 1]; also where nothing is added, the sum is clipped."""
        correction = self._add(below, learned)
        return correction._replace(total=np.clip(correction.total, np.float32(-1.0), np.float32(1.0)))
