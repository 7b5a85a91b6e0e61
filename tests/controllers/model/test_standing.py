"""Limits of standing: figures of the paper's robot, a linear program as oracle, and invariances."""

import dataclasses
import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.capturability import (
    capture_constants,
    capture_margin,
    recoverable_offset,
)
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.model.standing import (
    CORNERS,
    HULL_COLUMNS,
    HULL_ROWS,
    OFFSET,
    Feet,
    margin_on_both_feet,
    max_standing_force,
    max_standing_impulse,
    may_settle,
    standing_margin,
    standing_trajectory,
    stays_on_other_foot,
    write_hull,
)
from scipy.spatial import ConvexHull

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
ASTRIDE = Feet((0.15, 0.25), 0.4)


# Forces of the paper's robot with its feet 0.2 m apart, worked out by hand from the formula in the docstring:
# d = 0.1 m forward and 0.15 m aside, and 0.0807 m of the trunk
@pytest.mark.parametrize(
    ("psi", "soles", "flywheel", "force"),
    [
        (0, True, False, 249),
        (0, True, True, 450),
        (90, True, False, 374),
        (90, True, True, 575),
        (0, False, True, 201),
    ],
)
def test_limits_of_the_papers_robot(psi, soles, flywheel, force):
    found = max_standing_force(ROBOT, math.radians(psi), 0.1, soles=soles, flywheel=flywheel)
    assert found == pytest.approx(force, abs=0.7)


def test_the_papers_formula_holds_along_both_axes_for_any_duration():
    m, w, j, tau = ROBOT.mass, ROBOT.omega, ROBOT.trunk_inertia, ROBOT.trunk_torque_max
    t_1 = math.sqrt(ROBOT.trunk_angle_max * j / tau)
    trunk = tau / (m * 9.81) * (1.0 - math.exp(-w * t_1)) ** 2
    for psi, d in ((0.0, 0.1), (0.5 * math.pi, 0.15), (math.pi, 0.1), (-0.5 * math.pi, 0.15)):
        for duration in (0.02, 0.1, 0.5):
            force = max_standing_force(ROBOT, psi, duration)
            assert force * (1.0 - math.exp(-w * duration)) / (m * w**2) == pytest.approx(d + trunk, rel=1e-9)


@pytest.mark.parametrize("feet", [Feet.side_by_side(ROBOT), ASTRIDE, Feet((-0.1, -0.3), -0.7)])
@pytest.mark.parametrize("degrees", range(0, 360, 60))
def test_no_trajectory_does_better_and_one_does_as_well(feet, degrees):
    psi = math.radians(degrees)
    impulse = standing_trajectory(ROBOT, psi, feet=feet).impulse
    assert impulse / 0.1 == pytest.approx(max_standing_force(ROBOT, psi, feet=feet), abs=0.05)


def test_an_optimal_trajectory_keeps_the_soles_and_ends_at_rest():
    found = standing_trajectory(ROBOT, 0.7, feet=ASTRIDE)
    hull = ASTRIDE.hull(LIMITS)
    assert (found.cop @ hull[:, :2].T <= hull[:, OFFSET] + 1e-7).all()
    assert np.abs(found.trunk_acceleration).max() <= ROBOT.trunk_torque_max / ROBOT.trunk_inertia + 1e-7
    assert np.abs(found.trunk_angle).max() <= ROBOT.trunk_angle_max + 1e-7
    assert (hull[:, :2] @ found.dcm[-1] <= hull[:, OFFSET] + 1e-7).all()
    assert found.trunk_angle[-1] == pytest.approx(found.trunk_angle[-2], abs=1e-3)


@pytest.mark.parametrize("turn", [0.0, 0.3, -1.2, math.pi / 2])
@pytest.mark.parametrize("other", [(0.0, 0.2), (0.2, 0.1), (-0.3, -0.25)])
def test_the_hull_is_that_of_all_eight_corners(other, turn):
    half = np.array([LIMITS.cop_x_max, LIMITS.cop_y_max])
    corners = half * [(1, 1), (1, -1), (-1, -1), (-1, 1)]
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    points = np.vstack([corners, corners @ rotation.T + other])
    hull = Feet(other, turn).hull(LIMITS)
    expected = {
        (round(x, 6) + 0.0, round(y, 6) + 0.0, round(-d, 6)) for x, y, d in ConvexHull(points).equations
    }
    assert {tuple((np.round(row, 6) + 0.0).tolist()) for row in hull[:CORNERS]} == expected
    assert hull[CORNERS:, OFFSET] == pytest.approx([*points.max(axis=0), *-points.min(axis=0)])


def test_the_number_of_edges_is_returned():
    hull = np.empty((HULL_ROWS, HULL_COLUMNS))
    assert write_hull(0.0, 0.2, 0.0, 0.1, 0.05, hull) == 4
    assert write_hull(0.1, 0.2, 0.0, 0.1, 0.05, hull) == 6
    assert write_hull(0.1, 0.3, 0.3, 0.1, 0.05, hull) == 6
    assert write_hull(0.0, 0.0, math.pi / 4, 0.1, 0.1, hull) == 8


def test_the_margin_is_zero_at_the_limit_and_grows_inwards():
    feet, force = Feet.side_by_side(ROBOT), max_standing_force(ROBOT, 0.4, 0.1)
    shift = force * (1 - math.exp(-0.1 * ROBOT.omega)) / (ROBOT.mass * ROBOT.omega**2)
    edge = np.array(feet.middle) + shift * np.array([math.cos(0.4), math.sin(0.4)])
    assert standing_margin(ROBOT, LIMITS, feet, edge) == pytest.approx(0.0, abs=1e-12)
    assert standing_margin(ROBOT, LIMITS, feet, edge - [0.01, 0.0]) == pytest.approx(0.01)
    assert standing_margin(ROBOT, LIMITS, feet, edge + [0.02, 0.0]) == pytest.approx(-0.02)


def test_the_trunk_gives_what_it_has_left():
    feet, dcm = Feet.side_by_side(ROBOT), (0.15, 0.1)
    upright = standing_margin(ROBOT, LIMITS, feet, dcm)
    leaning = standing_margin(ROBOT, LIMITS, feet, dcm, trunk_angle=(0.5, 0.0))
    back = standing_margin(ROBOT, LIMITS, feet, dcm, trunk_angle=(-0.5, 0.0))
    none = standing_margin(ROBOT, LIMITS, feet, dcm, flywheel=False)
    assert none == pytest.approx(-0.05)
    assert none < leaning < upright < back
    # as single support counts it
    high = recoverable_offset(ROBOT, LIMITS, trunk_angle=(0.5, 0.0)).high[0]
    assert leaning - none == pytest.approx(high - recoverable_offset(ROBOT, LIMITS, flywheel=False).high[0])
    assert standing_margin(ROBOT, LIMITS, feet, dcm, trunk_angle=(0.5, 0.0), trunk_rate=(1.0, 0.0)) < leaning


@pytest.mark.parametrize("lean", [(0.4, 0.0), (0.0, 0.3), (-0.2, 0.5)])
def test_the_trunk_gives_as_much_towards_opposite_sides(lean):
    """Feet side by side are symmetrical forward and backward, and left and right of their middle."""
    feet, (x, y), rate = Feet((0.0, 0.2)), (0.12, 0.17), (0.6, -0.8)
    margin = standing_margin(ROBOT, LIMITS, feet, (x, y), lean, rate)
    turned = standing_margin(ROBOT, LIMITS, feet, (-x, y), (-lean[0], lean[1]), (-rate[0], rate[1]))
    assert turned == pytest.approx(margin, abs=1e-12)
    turned = standing_margin(ROBOT, LIMITS, feet, (x, 0.2 - y), (lean[0], -lean[1]), (rate[0], -rate[1]))
    assert turned == pytest.approx(margin, abs=1e-12)


@pytest.mark.parametrize("dcm", [(0.05, 0.12), (0.4, -0.1), (-0.3, 0.5), (0.1, 0.6)])
def test_the_margin_on_both_feet_is_the_best_of_staying_and_of_a_step_of_either(dcm):
    other, constants = (0.05, 0.22), capture_constants(ROBOT, LIMITS)
    lean, rate = (0.2, -0.3), (-0.5, 0.7)
    arrays = [np.array(one, float) for one in (other, dcm, lean, rate)]
    from_other = (dcm[0] - other[0], other[1] - dcm[1]), (lean[0], -lean[1]), (rate[0], -rate[1])
    expected = max(
        standing_margin(ROBOT, LIMITS, Feet(other), dcm, lean, rate),
        capture_margin(ROBOT, LIMITS, 0.0, dcm, lean, rate),
        capture_margin(ROBOT, LIMITS, 0.0, *from_other),
    )
    assert margin_on_both_feet(*arrays, constants) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("other", "dcm", "settles"),
    [  # soles of 0.2 x 0.1 m: within 2 cm of their hull, feet within 5 cm of side by side, 0.2 m apart
        ((0.0, 0.2), (0.0, 0.1), True),
        ((0.0, 0.2), (0.079, 0.1), True),
        ((0.0, 0.2), (0.081, 0.1), False),
        ((0.0, 0.2), (-0.081, 0.1), False),
        ((0.0, 0.2), (0.0, -0.029), True),
        ((0.0, 0.2), (0.0, -0.031), False),
        ((0.0, 0.2), (0.0, 0.229), True),
        ((0.0, 0.2), (0.0, 0.231), False),
        ((0.04, 0.2), (0.119, 0.1), True),
        ((0.049, 0.2), (0.0, 0.1), True),
        ((0.051, 0.2), (0.0, 0.1), False),
        ((-0.051, 0.2), (0.0, 0.1), False),
        ((0.0, 0.249), (0.0, 0.1), True),
        ((0.0, 0.251), (0.0, 0.1), False),
        ((0.0, 0.149), (0.0, 0.1), False),
        ((0.0, -0.2), (0.0, -0.1), True),
        ((0.0, -0.2), (0.0, 0.1), False),
    ],
)
def test_a_robot_settles_on_feet_side_by_side_with_its_dcm_well_within_them(other, dcm, settles):
    assert may_settle(*other, *dcm, 0.1, 0.05, 0.2) is settles


def test_a_step_begins_on_the_foot_nearer_to_the_cop():
    """CoP and roll are seen from there then, left and right exchanged; place and time are its own already."""
    plan = np.array([0.3, 0.25, 0.4, 0.02, 0.15, 1.0, 2.0])  # place, time, CoP, trunk
    seen = plan.copy()
    assert stays_on_other_foot(seen, 0.05, 0.2)
    assert seen == pytest.approx([0.3, 0.25, 0.4, -0.03, 0.05, 1.0, -2.0])
    plan[4] = 0.05
    seen = plan.copy()
    assert not stays_on_other_foot(seen, 0.05, 0.2)
    assert seen.tolist() == plan.tolist()
    assert stays_on_other_foot(seen, 0.05, 0.2, True)
    assert seen == pytest.approx([0.3, 0.25, 0.4, -0.03, 0.15, 1.0, -2.0])


def test_a_waist_without_an_axis_gives_nothing_about_it():
    robot = RobotModel(trunk_roll=False)
    aside = 0.5 * math.pi
    assert max_standing_force(robot, aside) == max_standing_force(robot, aside, flywheel=False)
    assert max_standing_force(robot, 0.0) == pytest.approx(max_standing_force(ROBOT, 0.0))


def test_mirrored_feet_have_the_mirrored_limit():
    mirrored = Feet((0.15, -0.25), -0.4)
    for psi in (0.3, 1.9, -2.5):
        assert max_standing_force(ROBOT, psi, feet=ASTRIDE) == pytest.approx(
            max_standing_force(ROBOT, -psi, feet=mirrored), rel=1e-12
        )


def test_a_reaction_time_costs_the_growth_of_the_dcm():
    soon, late = (max_standing_impulse(ROBOT, 1.0, reaction=r) for r in (0.0, 0.1))
    assert late / soon == pytest.approx(math.exp(-0.1 * ROBOT.omega))


def test_an_impulse_is_the_limit_of_short_pushes():
    assert max_standing_force(ROBOT, 2.0, 1e-6) * 1e-6 == pytest.approx(
        max_standing_impulse(ROBOT, 2.0), rel=1e-5
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: max_standing_force(ROBOT, 0.0, 0.0), r"duration must be positive \[s\], got 0.0"),
        (lambda: max_standing_impulse(ROBOT, math.nan), "must be finite, reaction >= 0, got nan"),
        (lambda: max_standing_impulse(ROBOT, 0.0, reaction=-1.0), "reaction >= 0, got 0.0, -1.0"),
        (lambda: Feet((math.inf, 0.0)).hull(LIMITS), "Feet must be finite"),
        (lambda: standing_margin(ROBOT, LIMITS, ASTRIDE, (1.0,)), "dcm must be two finite numbers"),
    ],
)
def test_impossible_inputs_are_named(call, words):
    with pytest.raises(InvalidValueError, match=words):
        call()


@pytest.mark.parametrize("feet", [ASTRIDE, Feet((-0.1, -0.3), -0.7)])
@pytest.mark.parametrize("degrees", [15, 30, 60, 195, 210, 270])
def test_the_margin_is_zero_at_the_limit_of_turned_feet(feet, degrees):
    psi = math.radians(degrees)
    shift = max_standing_impulse(ROBOT, psi, feet=feet) / (ROBOT.mass * ROBOT.omega)
    edge = np.array(feet.middle) + shift * np.array([math.cos(psi), math.sin(psi)])
    assert standing_margin(ROBOT, LIMITS, feet, edge) == pytest.approx(0.0, abs=1e-12)


def test_force_and_impulse_know_the_reaction_and_the_sole_of_the_limits():
    late = max_standing_force(ROBOT, 1.0, reaction=0.1) / max_standing_force(ROBOT, 1.0)
    assert late == pytest.approx(math.exp(-0.1 * ROBOT.omega))
    small = dataclasses.replace(LIMITS, cop_x_max=0.06)
    shift = max_standing_impulse(ROBOT, 0.0, flywheel=False, limits=small) / (ROBOT.mass * ROBOT.omega)
    assert shift == pytest.approx(0.06)


def test_the_fastest_swing_of_a_waist_without_roll_catches_aside_what_soles_do():
    robot = RobotModel(trunk_roll=False)
    found = standing_trajectory(robot, 0.5 * math.pi, horizon=1.0, interval=0.02).impulse / 0.1
    assert found == pytest.approx(max_standing_force(robot, 0.5 * math.pi), abs=0.05)


def test_the_program_takes_the_sole_and_the_duration_that_it_is_given():
    """Without a trunk F = m w^2 d / (1 - exp(-w t)), with soles that end 0.06 m ahead, for 0.2 s."""
    robot, w = RobotModel(trunk_pitch=False, trunk_roll=False), ROBOT.omega
    limits = dataclasses.replace(GaitLimits.of(robot), cop_x_max=0.06)
    found = standing_trajectory(robot, 0.0, 0.2, limits=limits, horizon=1.0, interval=0.02)
    force = robot.mass * w**2 * 0.06 / (1.0 - math.exp(-0.2 * w))
    assert found.impulse / 0.2 == pytest.approx(force, rel=1e-4)
    np.testing.assert_allclose(found.time, 0.02 * np.arange(51), atol=1e-12)
