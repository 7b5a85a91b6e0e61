import math

import pytest
from push_recovery.eval.protocols.tour import Follower, Pose, Waypoint, in_frame, missing


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
