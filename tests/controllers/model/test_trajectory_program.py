import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model import capturability, trajectory_program
from push_recovery.controllers.model.capturability import max_recoverable_force, max_recoverable_impulse
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.model.trajectory_program import StartState, TrajectoryProblem, trajectory_limit

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
WIDE = RobotModel(pelvis_width=0.3)  # the narrowest step leaves the DCM between the feet
OTHER = RobotModel(mass=45.0, com_height=1.1, foot_width=0.06)
PAGE = Path(__file__).parents[3] / "docs" / "generated" / "limits.md"
OUTWARD = ((math.pi, 0.0), (math.pi / 2, -math.pi / 2))  # psi towards (low, high) of each axis


def solve(robot, psi, **options):
    found = trajectory_limit(TrajectoryProblem(robot, psi, **options))
    assert found is not None
    return found


@pytest.mark.parametrize(("foot", "flywheel"), [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("psi_deg", [-90, -60, -30, 0, 45, 90, 150])
def test_closed_form_equals_the_linear_program(psi_deg, foot, flywheel):
    psi = math.radians(psi_deg)
    closed = max_recoverable_force(ROBOT, psi, 0.1, foot, flywheel)
    force = solve(ROBOT, psi, foot=foot, flywheel=flywheel).force
    assert closed - 0.1 < force < closed + 1e-3


@pytest.mark.parametrize(
    ("robot", "velocity"),
    [
        (ROBOT, (0.5, 0.0)),
        (OTHER, (0.0, 0.0)),
        (RobotModel(pelvis_width=0.12), (0, 0.05)),
        (RobotModel(trunk_roll=False), (0.0, 0.0)),
        (RobotModel(trunk_pitch=False), (0.3, 0.0)),
    ],
)
@pytest.mark.parametrize("psi_deg", [-90, 0, 60])
def test_other_gaits_and_robots(robot, velocity, psi_deg):
    gait, psi = nominal_gait(robot, GaitLimits.of(robot), velocity), math.radians(psi_deg)
    closed = max_recoverable_force(robot, psi, gait=gait)
    found = solve(robot, psi, gait=gait, step_durations=(0.3,) * 14)  # the taller robot diverges more slowly
    assert found.force == pytest.approx(closed, abs=0.1)


@pytest.mark.parametrize(("psi_deg", "timing"), [(-90, (0.3, 1.0)), (45, (1.0, 0.3)), (90, (1.0, 0.3))])
def test_slow_steps_are_best_where_the_narrowest_step_is_wide(psi_deg, timing):
    problem = TrajectoryProblem(WIDE, math.radians(psi_deg))
    closed = max_recoverable_force(WIDE, problem.psi)
    best = trajectory_program.trajectory_limit_over_timing(problem, 3)
    assert best is not None
    assert best.step_durations[:2] == timing
    assert best.force == pytest.approx(closed, abs=0.1)
    assert solve(WIDE, problem.psi).force < closed - 5.0


def test_axes_that_want_different_times_stay_below_the_closed_form():
    problem = TrajectoryProblem(WIDE, math.radians(30))
    best = trajectory_program.trajectory_limit_over_timing(problem, 6)
    assert best is not None
    assert 0.97 < best.force / max_recoverable_force(WIDE, problem.psi) < 0.99


def test_fastest_steps_are_best_with_the_papers_limits():
    problem = TrajectoryProblem(ROBOT, math.radians(60))
    best = trajectory_program.trajectory_limit_over_timing(problem, 3)
    assert best is not None
    assert set(best.step_durations) == {LIMITS.duration_min}


@pytest.mark.parametrize("reaction", [0.01, 0.1, 0.5])  # the last is later than T_min
@pytest.mark.parametrize("psi_deg", [-90, 0, 45])
def test_limits_of_a_reaction_time(psi_deg, reaction):
    psi = math.radians(psi_deg)
    force = max_recoverable_force(ROBOT, psi, reaction=reaction)
    impulse = max_recoverable_impulse(ROBOT, psi, reaction=reaction)
    assert force < max_recoverable_force(ROBOT, psi)
    assert solve(ROBOT, psi, reaction=reaction).force == pytest.approx(force, abs=0.1)
    assert solve(ROBOT, psi, reaction=reaction, duration=0.0).impulse == pytest.approx(impulse, abs=0.01)


def test_inputs_frozen_while_the_push_lasts():
    forces = [max_recoverable_force(ROBOT, math.radians(a), reaction=0.1) for a in (-90, -45, 0, 45, 90)]
    assert forces == pytest.approx([545, 771, 987, 446, 315], abs=1.0)


def test_impulse_is_the_limit_of_short_pushes():
    for psi in (-1.5, 0.2, 2.0):
        impulse = max_recoverable_impulse(ROBOT, psi)
        assert 1e-7 * max_recoverable_force(ROBOT, psi, 1e-7) == pytest.approx(impulse, rel=1e-6)
        assert 0.1 * max_recoverable_force(ROBOT, psi, 0.1) > impulse  # a slow push is easier


@pytest.mark.parametrize("reaction", [-0.01, 0.7, math.nan])
def test_reaction_later_than_the_nominal_step(reaction):
    with pytest.raises(InvalidValueError, match=r"reaction must lie within the nominal step, \[0, 0.65\] s"):
        max_recoverable_force(ROBOT, 0.0, reaction=reaction)


def random_state(rng):
    """Elapsed time and a trunk that can still stop before its stops."""
    top, push = ROBOT.trunk_angle_max, LIMITS.trunk_acceleration_max
    angle = rng.uniform(-top, top, 2)
    fastest = 0.99 * np.sqrt(2.0 * push * np.array([top + angle, top - angle]))
    return rng.uniform(0.0, 0.8), angle, np.clip(rng.uniform(-6.0, 6.0, 2), -fastest[0], fastest[1])


def test_capture_margin_tells_which_states_have_a_trajectory():
    rng = np.random.default_rng(5)
    for k in range(40):
        elapsed, angle, rate = random_state(rng)
        axis, end, inside = k % 2, k // 2 % 2, bool(k // 4 % 2)
        bounds = capturability.recoverable_offset(ROBOT, LIMITS, elapsed, angle, rate)
        dcm = bounds.low + rng.uniform(0.05, 0.95, 2) * (bounds.high - bounds.low)
        edge = (bounds.low, bounds.high)[end][axis]
        dcm[axis] = edge + (1e-3 if inside == (end == 0) else -1e-3)
        assert (capturability.capture_margin(ROBOT, LIMITS, elapsed, dcm, angle, rate) > 0) == inside
        start = StartState(tuple(dcm), elapsed, tuple(angle), tuple(rate))
        problem = TrajectoryProblem(ROBOT, OUTWARD[axis][end], duration=0.0, start=start)
        assert (trajectory_limit(problem) is not None) == inside


def test_a_trunk_that_must_hit_its_stop_has_no_trajectory():
    stopped = StartState((0.1, 0.1), 0.0, (0.9, 0.0), (2.0, 0.0))
    assert trajectory_limit(TrajectoryProblem(ROBOT, 0.0, start=stopped)) is not None
    hitting = dataclasses.replace(stopped, trunk_rate=(3.0, 0.0))
    assert trajectory_limit(TrajectoryProblem(ROBOT, 0.0, start=hitting)) is None


def test_the_number_of_steps_does_not_matter():
    few, many = (solve(ROBOT, 1.0, step_durations=(0.3,) * n).force for n in (10, 14))
    assert many - 0.03 < few <= many


def test_the_trajectory_obeys_dynamics_and_bounds():
    found = solve(ROBOT, math.radians(-70), reaction=0.05)
    omega, gain, span = ROBOT.omega, ROBOT.cmp_per_trunk_acceleration, np.diff(found.time)[:, None]
    pushed = (found.time[:-1, None] < 0.1 - 1e-9) * found.force / (ROBOT.mass * omega**2)
    direction = np.array([math.cos(math.radians(-70)), math.sin(math.radians(70))])
    centre = found.cop + gain * found.trunk_acceleration - pushed * direction
    dcm = centre + np.exp(omega * span) * (found.dcm[:-1] - centre)
    np.testing.assert_allclose(dcm, found.dcm[1:], atol=1e-9)
    rate = found.trunk_rate[:-1] + span * found.trunk_acceleration
    np.testing.assert_allclose(rate, found.trunk_rate[1:], atol=1e-9)
    sole = found.footholds[np.searchsorted(found.touchdowns, 0.5 * (found.time[1:] + found.time[:-1]))]
    assert (abs(found.cop - sole) <= [LIMITS.cop_x_max + 1e-9, LIMITS.cop_y_max + 1e-9]).all()
    assert (abs(found.trunk_angle) <= ROBOT.trunk_angle_max + 1e-9).all()
    width = np.diff(found.footholds[:, 1]) * np.tile([1.0, -1.0], 5)
    assert width.min() >= LIMITS.width_min - 1e-9
    assert width.max() <= LIMITS.width_max + 1e-9
    early = found.time[:-1] < 0.05 - 1e-9
    assert not found.trunk_acceleration[early].any()
    assert not found.cop[early].any()
    nominal = TrajectoryProblem(ROBOT, 0.0).state.dcm
    np.testing.assert_allclose(found.dcm[-1] - found.footholds[-1], nominal, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"psi": math.nan}, "psi must be finite, got nan"),
        ({"duration": -0.1}, "duration and reaction must not be negative"),
        ({"step_durations": (0.3, 0.2)}, r"step_durations must lie in \[0.3, 1.0\] s, got \(0.3, 0.2\)"),
        ({"reaction": 0.4, "step_durations": (0.3,) * 10}, "the first step must last"),
    ],
)
def test_bad_problems(options, message):
    with pytest.raises(InvalidValueError, match=message):
        TrajectoryProblem(**({"robot": ROBOT, "psi": 0.0} | options))


def test_the_table_of_the_page():
    text = PAGE.read_text(encoding="utf-8")
    lines = re.findall(r"^\| -?\d+ \|.*$", text, re.MULTILINE)
    rows = [[cell.split("/") for cell in line.strip("| ").split("|")] for line in lines]
    assert [int(row[0][0]) for row in rows] == list(range(-90, 91, 15))
    kinds = [{"foot": f, "flywheel": w} for w in (False, True) for f in (False, True)]
    kinds += [{"reaction": r} for r in (0.01, 0.1)]
    for (head,), *cells in rows:
        psi = math.radians(int(head))
        closed = [max_recoverable_force(ROBOT, psi, **kind) for kind in kinds]
        closed.append(max_recoverable_impulse(ROBOT, psi))
        assert [float(cell[0]) for cell in cells] == pytest.approx(closed, abs=0.051)
        assert [float(cell[1]) for cell in cells] == pytest.approx(closed, abs=0.151)


def test_after_an_odd_number_of_steps_the_dcm_is_on_the_inner_side():
    found = solve(ROBOT, 0.4, step_durations=(0.3,) * 9)
    aside = -0.2 / (1.0 + math.exp(0.65 * math.sqrt(9.81 / 0.8)))  # -0.0186 m
    np.testing.assert_allclose(found.dcm[-1] - found.footholds[-1], [0.0, aside], atol=1e-6)


def test_only_the_first_step_waits_for_the_reaction():
    late = TrajectoryProblem(ROBOT, 0.0, reaction=0.5)
    best = trajectory_program.trajectory_limit_over_timing(late, 3)
    assert best is not None
    assert best.step_durations == (0.5, *(0.3,) * 9)
    assert best.force == pytest.approx(max_recoverable_force(ROBOT, 0.0, reaction=0.5), abs=0.1)


def test_the_program_keeps_the_box_of_the_trunk():
    """J/(m g) u (1 - exp(-w sqrt(theta_max / u)))^2 of DCM, with u at 10 of the torque's 18.75 rad/s^2."""
    limits = dataclasses.replace(LIMITS, trunk_acceleration_max=10.0)
    options = {"foot": False, "duration": 0.0, "limits": limits}
    gained = solve(ROBOT, 0.0, **options).impulse - solve(ROBOT, 0.0, flywheel=False, **options).impulse
    omega = math.sqrt(9.81 / 0.8)
    swing = 8.0 / (60.0 * 9.81) * 10.0 * (1.0 - math.exp(-omega * math.sqrt(math.pi / 3 / 10.0))) ** 2
    assert gained == pytest.approx(60.0 * omega * swing, abs=0.05)


@pytest.mark.parametrize("duration", [0.045, 0.2])
def test_pushes_of_other_durations_have_the_closed_forms_limit(duration):
    closed = max_recoverable_force(ROBOT, 0.7, duration)
    assert solve(ROBOT, 0.7, duration=duration).force == pytest.approx(closed, rel=3e-4)
