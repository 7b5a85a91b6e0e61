"""Stage 1 (eq. 3): place and time of the next step, from the measured DCM, solved exactly.

With tau = exp(omega T) and a = (xi - u_0) exp(omega (delay - t)), in the canonical frame (u_0 = 0):

    min   alpha_1 |u - u_nom|^2 + alpha_2 (tau - tau_nom)^2 + alpha_3 |b - b_nom|^2
    s.t.  u + b = a tau,    u_min <= u <= u_max,    tau_min <= tau <= tau_max.

The equality removes b. For a given tau each coordinate of u is an affine function of tau clipped to its
bounds, so what is left is a convex, piecewise quadratic function of tau alone: its derivative is continuous,
piecewise linear and changes slope at no more than four breakpoints. The root is found between two of them in
closed form; there is no iteration and no tolerance.

In double support the CoP's transfer from the old foot to the new one, p kappa(t), is taken off the DCM, and
the foot acts as if it stood at u (1 - c), c = kappa(0) (`model/nominal_gait`): what the next step grows from
is not b but b + c u. Stage 1 solves for these, which keeps it as linear as before. Aiming at b_nom itself
would multiply every error of the step's place by exp(omega T) c from step to step, 1.5 with the paper's
0.55 s + 0.1 s.

From observations (n, 36) to rows (n, ROW_SIZE) it is one compiled pass, the hot path of every policy.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .array_table import tuple_reader
from .errors import InvalidValueError
from .jit import njit
from .model import nominal_gait, observation
from .model.gait_box import COP, DURATION, STEP, TRUNK, GaitLimits, unscaled
from .model.nominal_gait import NOMINAL_DURATION, NOMINAL_STEP, transfer_mean, transfer_weight
from .model.robot import RobotModel
from .qp import QuadraticProgram
from .settings import PlannerConfig

Floats = NDArray[np.float64]

# Columns of a packed problem, `StepProblem.pack`; of a pair (x, y) the first one
GAIN = 0  # pair, a [m]
STEP_NOMINAL = 2  # pair [m]
TAU_NOMINAL = 4
OFFSET_NOMINAL = 5  # pair [m]
STEP_LOW = 7  # pair [m]
STEP_HIGH = 9  # pair [m]
TAU_LOW = 11
TAU_HIGH = 12
ALPHA_STEP = 13
ALPHA_DURATION = 14
ALPHA_OFFSET = 15
PROBLEM_SIZE = 16

# Columns of its solution, `solve_step_kernel`
SOLVED_STEP = 0  # pair, u [m]
SOLVED_TAU = 2
SOLVED_OFFSET = 3  # pair, b [m]
SOLUTION_SIZE = 5

# Columns of a row, the plan of one observation. The first seven are the gait variables, by the names of
# `model/gait_box.py`; stage 1 writes the CoP of the undisturbed step and the upright law's trunk acceleration
OFFSET = 7  # pair, b of the plan [m]
NOMINAL = 9  # L, W, T, b_x, b_y of the nominal gait
NOMINAL_OFFSET = 12  # pair, its b [m]
TARGET = 14  # pair, xi_des = u_T + b_nom (eq. 7), with double support + c (u_nom - u_T) [m]
REMAINING = 16  # until the new foot carries load [s], >= 0
HELD = 17  # 1 where the plan is the previous one
DCM_AHEAD = 18  # pair, measured DCM with what the push will still add [m]
SHIFT = 20  # pair, p kappa(t): what the CoP's transfer in double support takes off the DCM [m]
RESULT = 22  # the result of stage 2 from here on, `stage_2/problem.py`: CoP and trunk acceleration, then
DCM_END = 26  # pair, DCM at touchdown; of stage 1 u_T + b [m]
STATUS = 28  # of stage 2's solver
ROW_SIZE = 29

KNOTS = 6  # both ends of the range of tau, and up to four places between
LARGEST = 1e15  # of an observation's entries: far beyond any robot, and no square of a product overflows
LATEST = 300.0  # of omega times the time since the step began, for exp(omega t)
SWING_ROUNDS = 3  # a later step lies elsewhere, so the time it needs is found in rounds

# Columns of an observation; of a pair (x, y) the first one
ELAPSED, _DCM, _COMMAND = observation.ELAPSED, observation.DCM.start, observation.COMMAND.start
_SWING, _SWING_SPEED = observation.SWING_POSITION.start, observation.SWING_VELOCITY.start
_ANGLE, _RATE = observation.TRUNK_ANGLE.start, observation.TRUNK_RATE.start
_PREVIOUS, _PUSH = observation.PREVIOUS_ACTION.start, observation.PUSH_ESTIMATE.start


@dataclass(frozen=True)
class StepProblem:
    """Data of one stage 1 problem, canonical frame; pairs are (x, y)."""

    gain: tuple[float, float]  # a = xi exp(omega (delay - t)) [m]
    step_nominal: tuple[float, float]  # (L_nom, W_nom) [m]
    tau_nominal: float  # exp(omega T_nom)
    offset_nominal: tuple[float, float]  # [m]
    step_low: tuple[float, float]  # [m]
    step_high: tuple[float, float]  # [m]
    tau_low: float
    tau_high: float
    alpha_step: float = 1.0  # [1/m^2]
    alpha_duration: float = 1.0
    alpha_offset: float = 1e6  # [1/m^2]

    def __post_init__(self) -> None:
        if not np.isfinite(self.pack()).all():
            raise InvalidValueError(f"every entry of a StepProblem must be finite, got {self}")
        if not all(low <= high for low, high in zip(self.step_low, self.step_high, strict=True)):
            raise InvalidValueError(f"step_low must be <= step_high, got {self.step_low} > {self.step_high}")
        if not 0 < self.tau_low <= self.tau_high:
            raise InvalidValueError(f"need 0 < tau_low <= tau_high, got {self.tau_low}, {self.tau_high}")
        if min(self.alpha_step, self.alpha_duration, self.alpha_offset) < 0:
            raise InvalidValueError(
                f"weights must be >= 0, got {self.alpha_step, self.alpha_duration, self.alpha_offset}"
            )

    def pack(self) -> Floats:
        """The fields as one vector (PROBLEM_SIZE,), in their order."""
        return np.hstack(astuple(self))


@dataclass(frozen=True)
class StepPlan:
    """Solution of stage 1, canonical frame."""

    step: tuple[float, float]  # u_T: length, width [m]
    tau: float  # exp(omega T)
    offset: tuple[float, float]  # b [m]

    def duration(self, omega: float) -> float:
        """T = log(tau) / omega [s]."""
        return math.log(self.tau) / omega


@njit(cache=True)
def _best_step(p, axis, tau):  # pragma: no cover
    """Foothold along one axis that is best for a given tau [m]."""
    free, step_weight, offset_weight = p[STEP_NOMINAL + axis], p[ALPHA_STEP], p[ALPHA_OFFSET]
    if offset_weight > 0.0:
        exact = p[GAIN + axis] * tau - p[OFFSET_NOMINAL + axis]  # ends with the nominal offset
        free = (step_weight * free + offset_weight * exact) / (step_weight + offset_weight)
    return min(max(free, p[STEP_LOW + axis]), p[STEP_HIGH + axis])


@njit(cache=True)
def _half_slope(p, tau):  # pragma: no cover
    """Half the derivative of the reduced cost with respect to tau."""
    slope = p[ALPHA_DURATION] * (tau - p[TAU_NOMINAL])
    for axis in range(2):
        gain, nominal = p[GAIN + axis], p[OFFSET_NOMINAL + axis]
        slope += p[ALPHA_OFFSET] * gain * (gain * tau - _best_step(p, axis, tau) - nominal)
    return slope


@njit(cache=True)
def _breakpoints(p, knots):  # pragma: no cover
    """Ends of the tau range and, sorted between, where a step coordinate meets a bound; returns the count."""
    low, high, step_weight, offset_weight = p[TAU_LOW], p[TAU_HIGH], p[ALPHA_STEP], p[ALPHA_OFFSET]
    knots[0] = low
    count = 1
    for axis in range(2):
        if offset_weight <= 0.0 or p[GAIN + axis] == 0.0:
            continue
        pull = step_weight * p[STEP_NOMINAL + axis]
        for side in range(2):
            bound = p[(STEP_LOW, STEP_HIGH)[side] + axis]
            exact = (bound * (step_weight + offset_weight) - pull) / offset_weight
            knot = (exact + p[OFFSET_NOMINAL + axis]) / p[GAIN + axis]
            if low < knot < high:
                place = count
                while knots[place - 1] > knot:
                    knots[place] = knots[place - 1]
                    place -= 1
                knots[place] = knot
                count += 1
    knots[count] = high
    return count + 1


@njit(cache=True)
def solve_step_kernel(p, out):  # pragma: no cover
    """Exact solution of a packed problem `p` (PROBLEM_SIZE,) into `out` (SOLUTION_SIZE,)."""
    knots = np.empty(KNOTS)
    count = _breakpoints(p, knots)
    left, slope_left = knots[0], _half_slope(p, knots[0])
    tau = left
    if slope_left < 0.0 or (slope_left == 0.0 and p[TAU_NOMINAL] > left):
        tau = knots[count - 1]
        for k in range(1, count):
            right = knots[k]
            slope_right = _half_slope(p, right)
            if slope_right > 0.0:
                tau = left + (right - left) * (-slope_left / (slope_right - slope_left))
                break
            if slope_right == 0.0 and p[TAU_NOMINAL] <= right:
                tau = p[TAU_NOMINAL] if slope_left == 0.0 else right  # flat before: nominal is among the best
                break
            left, slope_left = right, slope_right
    for axis in range(2):
        out[SOLVED_STEP + axis] = _best_step(p, axis, tau)
        out[SOLVED_OFFSET + axis] = p[GAIN + axis] * tau - out[SOLVED_STEP + axis]
    out[SOLVED_TAU] = tau


def solve_step(problem: StepProblem) -> StepPlan:
    """Exact solution of one problem."""
    out = np.empty(SOLUTION_SIZE)
    solve_step_kernel(problem.pack(), out)
    length, width, tau, offset_x, offset_y = out.tolist()
    return StepPlan((length, width), tau, (offset_x, offset_y))


def step_program(problem: StepProblem) -> QuadraticProgram:
    """Stage 1 as a general quadratic program in x = (u_x, u_y, tau, b_x, b_y), a second opinion.

    The rows of A are u_x + b_x - a_x tau = 0, u_y + b_y - a_y tau = 0 and the bounds of u_x, u_y, tau. The
    cost is divided by the largest weight.
    """
    weights = np.array([problem.alpha_step] * 2 + [problem.alpha_duration] + [problem.alpha_offset] * 2)
    nominal = np.array([*problem.step_nominal, problem.tau_nominal, *problem.offset_nominal])
    largest = weights.max()
    equality = [[1.0, 0.0, -problem.gain[0], 1.0, 0.0], [0.0, 1.0, -problem.gain[1], 0.0, 1.0]]
    return QuadraticProgram(
        H=np.diag(2.0 * weights / largest),
        f=-2.0 * weights / largest * nominal,
        A=np.vstack([equality, np.eye(3, 5)]),
        lower=np.array([0.0, 0.0, *problem.step_low, problem.tau_low]),
        upper=np.array([0.0, 0.0, *problem.step_high, problem.tau_high]),
        soft_weight=np.zeros(5),
    )


class StepConstants(NamedTuple):
    """Scalars of the compiled loop; those of `PlannerConfig` have its names. Switches are 1 or 0."""

    omega: float  # [1/s]
    pelvis_width: float  # l_p [m]
    carry: float  # share of the push estimate that is still to come: 1 - exp(-omega push_carry)
    trunk_gain: float  # CMP per trunk acceleration that the debt of the trunk counts with [m s^2]
    transfer: float  # c = kappa(0)
    adapt: float  # 0 gives the nominal gait
    capture_point: float  # 1: `_write_capture_step` in the place of eq. 3, also ahead of linear MPC
    alpha_step: float
    alpha_duration: float
    alpha_offset: float
    adapt_step: float
    adapt_duration: float
    duration_margin: float
    swing_acceleration: float
    freeze: float
    touchdown_delay: float
    double_support: float
    push_threshold: float
    first_interval_min: float
    upright_stiffness: float
    upright_damping: float


constants_of = tuple_reader(StepConstants)


class StepPlanner:
    """Stage 1 of one robot, step box and configuration."""

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig, adapt: bool = True):
        """Pack the constants.

        Args:
            robot: physical constants.
            limits: step box and bound of the trunk acceleration.
            config: weights and margins.
            adapt: False gives the nominal gait, whatever the DCM.

        Raises:
            InvalidValueError: a pelvis wider than the step box, or a double support longer than the shortest
                step.
        """
        nominal_gait.check_pelvis(robot, limits)
        nominal_gait.check_double_support(config.double_support, limits)
        constants = StepConstants(
            omega=robot.omega,
            pelvis_width=robot.pelvis_width,
            carry=-math.expm1(-robot.omega * config.push_carry),
            trunk_gain=robot.cmp_per_trunk_acceleration * config.trunk_debt,
            transfer=transfer_weight(0.0, config.double_support, robot.omega),
            adapt=float(adapt),
            capture_point=float(config.foothold != "optimal"),
            **config.numbers(StepConstants._fields),
        )
        self._constants = np.array(constants)
        self._box = limits.low, limits.high
        self._latest = LATEST / robot.omega  # [s]

    def plan(self, observations: Floats, rows: Floats) -> int:
        """Write the plans of observations (n, 36) into rows (n, ROW_SIZE); returns how many robots stand.

        Raises:
            InvalidValueError: an observation is not finite, or far too large to be a robot's.
        """
        standing = plan_steps(observations, rows, self._constants, *self._box)
        if standing >= 0:
            return standing
        if not np.isfinite(observations).all():
            raise InvalidValueError("observation must be finite, got NaN or infinity")
        if (largest := np.abs(observations).max()) > LARGEST:
            raise InvalidValueError(
                f"observation must lie within +-{LARGEST:g} in every entry, got {largest:g}"
            )
        elapsed = observations[np.abs(observations[:, ELAPSED]).argmax(), ELAPSED]
        raise InvalidValueError(
            f"an observation's elapsed time must lie within +-{self._latest:g} s, got {elapsed:g} s"
        )


@njit(cache=True)
def swing_time(distance, speed, acceleration):  # pragma: no cover
    """Time [s] in which a foot with a speed [m/s] towards its target can come to rest there.

    Accelerating and braking with a: (2 sqrt(a d + v^2 / 2) - v) / a. With a = 4 sqrt(3) / 10 of the bound
    it is the time of the rest-to-rest quintic whose peak acceleration, 10 d / (sqrt(3) t^2), is that bound,
    and half-way along it, too, to 0.1 %.
    """
    a = 0.4 * math.sqrt(3.0) * acceleration
    return max((2.0 * math.sqrt(a * distance + 0.5 * speed * speed) - speed) / a, 0.0)


@njit(cache=True)
def time_to_place(obs, x, y, acceleration):  # pragma: no cover
    """`swing_time` [s] of the observed swing foot to (x, y), canonical frame [m]."""
    dx, dy = x - obs[_SWING], y - obs[_SWING + 1]
    distance = math.hypot(dx, dy)
    speed = (dx * obs[_SWING_SPEED] + dy * obs[_SWING_SPEED + 1]) / max(distance, 1e-9)
    return swing_time(distance, speed, acceleration)


@njit(cache=True)
def _write_capture_step(obs, c, low, high, nominal, row):  # pragma: no cover
    """Write the field's first foothold: the capture point's error moves it one for one, T stays nominal.

    Raibert (1986, chapter 2) places a foot at half of what the body covers in a stance, and moves it by
    k (v - v_des); with k = 1 / omega the sum of place and velocity is the capture point (Pratt et al. 2006),
    xi. On a periodic gait with sway the nominal state at the same moment t stands for the half stance:

        u = u_nom + (xi - xi_nom(t)) / (1 - c),    xi_nom(t) = (u_nom + b_nom) exp(-omega (T + delay - t)),

    clipped to the step box; c is 0 but in double support. Nothing is predicted: an error e grows to
    e exp(omega (T - t)) until touchdown, and the foot follows it as it grows. Where it can follow to the end,
    b = b_nom. Place [m], time [s] and DCM offset [m] go into `row`; a T that is past becomes now.
    """
    row[DURATION] = max(nominal[NOMINAL_DURATION], obs[ELAPSED] + c.duration_margin)
    growth = math.exp(c.omega * (row[DURATION] + c.touchdown_delay - obs[ELAPSED]))
    for axis in range(2):
        dcm, step = row[DCM_AHEAD + axis] - row[SHIFT + axis], nominal[NOMINAL_STEP + axis]
        error = dcm - (step + row[NOMINAL_OFFSET + axis]) / growth
        row[STEP + axis] = min(max(step + error / (1.0 - c.transfer), low[axis]), high[axis])
        row[OFFSET + axis] = dcm * growth - row[STEP + axis]


@njit(cache=True)
def stopping_debt(rate, gain, acceleration, omega):  # pragma: no cover
    """Shift of the DCM that stopping the trunk as fast as the torque can will still bring [m].

    Braking with -a for |rate| / a seconds moves the CMP by -gain a, in all, discounted to now,
    int omega exp(-omega s) gain a ds = gain a (1 - exp(-omega |rate| / a)), away from the lean's motion.
    Without a torque, about an axis that the waist lacks, there is no debt.
    """
    if acceleration <= 0.0:
        return 0.0
    return math.copysign(gain * acceleration * -math.expm1(-omega * abs(rate) / acceleration), rate)


@njit(cache=True)
def _write_problem(obs, c, low, high, nominal, row, problem):  # pragma: no cover
    """Write the packed problem of one observation.

    tau may not lie before the present: tau >= exp(omega (t + margin)), and where even T_max has passed the
    upper bound gives way.
    """
    omega, elapsed, reach = c.omega, obs[ELAPSED], 1.0 - c.transfer
    scale = math.exp(omega * (c.touchdown_delay - elapsed))
    tau_low = math.exp(omega * max(low[DURATION], elapsed + c.duration_margin))
    tau_high = max(math.exp(omega * high[DURATION]), tau_low)
    problem[TAU_NOMINAL] = math.exp(omega * nominal[NOMINAL_DURATION])
    for axis in range(2):
        debt = stopping_debt(obs[_RATE + axis], c.trunk_gain, high[TRUNK + axis], omega)
        problem[GAIN + axis] = (row[DCM_AHEAD + axis] + debt - row[SHIFT + axis]) * scale
        step = nominal[NOMINAL_STEP + axis]
        problem[STEP_NOMINAL + axis] = reach * step
        problem[OFFSET_NOMINAL + axis] = row[NOMINAL_OFFSET + axis] + c.transfer * step
        problem[STEP_LOW + axis] = reach * (low[axis] if c.adapt_step > 0.0 else step)
        problem[STEP_HIGH + axis] = reach * (high[axis] if c.adapt_step > 0.0 else step)
    if c.adapt_duration == 0.0:
        tau_low = min(max(problem[TAU_NOMINAL], tau_low), tau_high)
        tau_high = tau_low
    problem[TAU_LOW], problem[TAU_HIGH] = tau_low, tau_high
    problem[ALPHA_STEP] = c.alpha_step / (reach * reach)
    problem[ALPHA_DURATION], problem[ALPHA_OFFSET] = c.alpha_duration, c.alpha_offset


@njit(cache=True)
def solve_in_time(obs, problem, solution, omega, reach, acceleration, double_support):  # pragma: no cover
    """Solve a packed problem, again with the T that the swing foot needs where it needs longer.

    Places are the solution's over `reach`. Returns exp(omega T) of the T that the foot needs, which may be
    beyond the upper bound; 0 without a bound of the foot's acceleration.
    """
    solve_step_kernel(problem, solution)
    most, needed = problem[TAU_HIGH], 0.0
    for _ in range(SWING_ROUNDS if acceleration > 0.0 else 0):
        x, y = solution[SOLVED_STEP] / reach, solution[SOLVED_STEP + 1] / reach
        swing = time_to_place(obs, x, y, acceleration)
        needed = math.exp(omega * (max(obs[ELAPSED], double_support) + swing))
        if solution[SOLVED_TAU] >= min(needed, most):
            break
        problem[TAU_LOW] = min(needed, most)
        solve_step_kernel(problem, solution)
    return needed


@njit(cache=True)
def _adapt(obs, c, low, high, nominal, row):  # pragma: no cover
    """Solve stage 1 for one observation: place and time of the step and its offset into `row`.

    Where the swing foot needs longer to the place found, it is solved again with the T that the foot needs.
    """
    reach = 1.0 - c.transfer
    problem, solution = np.empty(PROBLEM_SIZE), np.empty(SOLUTION_SIZE)
    _write_problem(obs, c, low, high, nominal, row, problem)
    solve_in_time(obs, problem, solution, c.omega, reach, c.swing_acceleration, c.double_support)
    row[DURATION] = max(math.log(solution[SOLVED_TAU]) / c.omega, low[DURATION])
    for axis in range(2):
        row[STEP + axis] = min(max(solution[SOLVED_STEP + axis] / reach, low[axis]), high[axis])
        row[OFFSET + axis] = solution[SOLVED_OFFSET + axis] - c.transfer * row[STEP + axis]


@njit(cache=True)
def _hold(obs, c, low, high, row):  # pragma: no cover
    """Take place and time from the previous action."""
    duration = unscaled(obs[_PREVIOUS + DURATION], low[DURATION], high[DURATION])
    growth = math.exp(c.omega * (max(duration, obs[ELAPSED]) + c.touchdown_delay - obs[ELAPSED]))
    for i in range(DURATION + 1):
        row[i] = unscaled(obs[_PREVIOUS + i], low[i], high[i])
    for axis in range(2):
        row[OFFSET + axis] = (row[DCM_AHEAD + axis] - row[SHIFT + axis]) * growth - row[STEP + axis]


@njit(cache=True)
def plan_step(obs, c, low, high, row):  # pragma: no cover
    """Plan of one observation (36,) into `row` (ROW_SIZE,)."""
    adapt, push = c.adapt > 0.0, math.hypot(obs[_PUSH], obs[_PUSH + 1])
    carry = c.carry if push >= c.push_threshold else 0.0
    shift = transfer_weight(obs[ELAPSED], c.double_support, c.omega)
    share = transfer_mean(obs[ELAPSED], c.first_interval_min, c.double_support, c.omega)
    for axis in range(2):
        row[DCM_AHEAD + axis] = obs[_DCM + axis] + carry * obs[_PUSH + axis]
        row[SHIFT + axis] = shift * obs[_SWING + axis] if shift > 0.0 else 0.0
        row[COP + axis] = share * obs[_SWING + axis] if shift > 0.0 else 0.0
    nominal = row[NOMINAL : NOMINAL_OFFSET + 2]
    nominal_gait.nominal_gait_kernel(
        obs[_COMMAND], obs[_COMMAND + 1], c.pelvis_width, low, high, c.omega, c.touchdown_delay, nominal,
        c.double_support,
    )  # fmt: skip
    previous = unscaled(obs[_PREVIOUS + DURATION], low[DURATION], high[DURATION])
    held = adapt and c.freeze > 0.0 and previous - obs[ELAPSED] < c.freeze  # too little of the step remains
    if not adapt:
        row[STEP], row[STEP + 1] = nominal[NOMINAL_STEP], nominal[NOMINAL_STEP + 1]
        row[DURATION] = nominal[NOMINAL_DURATION]
        row[OFFSET], row[OFFSET + 1] = row[NOMINAL_OFFSET], row[NOMINAL_OFFSET + 1]
    elif not held or carry > 0.0:
        if c.capture_point > 0.0:
            _write_capture_step(obs, c, low, high, nominal, row)
        else:
            _adapt(obs, c, low, high, nominal, row)
        # a push reopens an ending step for one that will not be held at once
        held = held and row[DURATION] - obs[ELAPSED] < c.freeze + 0.5 * c.first_interval_min
    if held:
        _hold(obs, c, low, high, row)
    row[HELD], row[STATUS] = (1.0 if held else 0.0), 0.0
    row[REMAINING] = max(row[DURATION] - obs[ELAPSED], 0.0) + c.touchdown_delay
    for axis in range(2):
        nominal_end = row[STEP + axis] + row[NOMINAL_OFFSET + axis]
        row[TARGET + axis] = nominal_end + c.transfer * (nominal[NOMINAL_STEP + axis] - row[STEP + axis])
        row[DCM_END + axis] = row[STEP + axis] + row[OFFSET + axis]
        lean = -c.upright_stiffness * obs[_ANGLE + axis] - c.upright_damping * obs[_RATE + axis]
        row[TRUNK + axis] = min(max(lean, low[TRUNK + axis]), high[TRUNK + axis])


@njit(cache=True, nogil=True)
def plan_steps(observations, rows, constants, low, high):  # pragma: no cover
    """Plans (n, ROW_SIZE) of observations (n, 36); returns how many of the robots stand on both feet.

    It is -1, and there is no plan, where an entry is out of all bounds.

    Entries lie within +-LARGEST, and the times since the step began within +-LATEST / omega [s].
    """
    c = constants_of(constants)
    bounded, latest, standing = True, LATEST / c.omega, 0
    for i in range(observations.shape[0]):
        standing += 1 if observations[i, ELAPSED] < 0.0 else 0
        bounded = bounded and abs(observations[i, ELAPSED]) <= latest
        for j in range(observations.shape[1]):
            bounded = bounded and abs(observations[i, j]) <= LARGEST  # NaN is not
    if bounded:
        for i in range(observations.shape[0]):
            plan_step(observations[i], c, low, high, rows[i])
    return standing if bounded else -1
