"""Places on the floor against the robot's own feet and the planner's limits, on either foot and turned."""

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import capture_margin
from push_recovery.controllers.model.observation import DCM, ELAPSED, SWING_POSITION, TRUNK_ANGLE, TRUNK_RATE
from push_recovery.controllers.model.standing import Feet, standing_margin
from push_recovery.controllers.whole_body.kinematics import sole_position
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.play.scene import overlays_of
from push_recovery.eval.play.session import Lane, push_now


def area(polygon):
    """By the shoelace formula, without its sign."""
    x, y = polygon.T
    return abs(x @ np.roll(y, 1) - y @ np.roll(x, 1)) / 2


def inside(polygon, point):
    """How far a point is inside of a rectangle: its least distance to an edge [m]; negative outside."""
    middle, distances = polygon.mean(axis=0), []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        normal = np.array([-(b - a)[1], (b - a)[0]]) / np.hypot(*(b - a))
        distances.append(normal @ (point - a) * np.sign(normal @ (middle - a)))
    return min(distances)


@pytest.fixture(scope="module")
def lane():
    lane = Lane("PushRecovery/Biped-v0", "two-stage")
    lane.set_command(Command(0.15, 0.05, 0.5))
    yield lane
    lane.close()


def test_overlays_of_a_turning_robot(lane):
    sides = set()
    for _ in range(120):
        lane.step()
        episodes = lane.episodes
        core, overlays = episodes.core, overlays_of(episodes)
        stance = int(core.gait.stance[0])
        sole = np.array(sole_position(core.true_state(0), 0, stance)[:2])
        np.testing.assert_array_equal(overlays["DCM"], [lane.rows[-1]["dcm_x"], lane.rows[-1]["dcm_y"]])
        planned = [lane.rows[-1]["planned_step_x"], lane.rows[-1]["planned_step_y"]]
        if not np.isnan(planned[0]):
            np.testing.assert_allclose(overlays["planned step"].mean(axis=0), planned, atol=1e-9)
            assert inside(overlays["box of steps"], np.array(planned)) > -1e-6
        assert area(overlays["planned step"]) == pytest.approx(0.02)
        truth = core.truth[0]
        margin = capture_margin(
            episodes.robot, episodes.limits, truth[ELAPSED], truth[DCM], truth[TRUNK_ANGLE], truth[TRUNK_RATE]
        )
        assert inside(overlays["capture region"], overlays["DCM"]) == pytest.approx(margin, abs=1e-9)
        assert np.hypot(*(overlays["support polygon"] - sole).T).min() < 0.13
        x, y = np.mean(overlays["box of steps"], axis=0) - sole
        left = x * np.sin(core.gait.heading[0]) - y * np.cos(core.gait.heading[0]) < 0.0
        assert left == (stance == 1)  # on the right foot the box lies to the left
        sides.add(stance)
    assert sides == {0, 1}
    assert core.gait.heading[0] > 0.4


@pytest.mark.parametrize("impulse", [(30.0, 0.0), (0.0, -40.0)])  # soles turn under oblique ones
def test_a_standing_robot_has_the_region_that_it_can_be_caught_in_and_no_step(impulse):
    lane = Lane("PushRecovery/Biped-v0", "two-stage", Scenario("stand", (), Command(stand=True)))
    lane.push(push_now(impulse, lane.time))
    leant = 0.0
    for _ in range(40):
        lane.step()
        robot, limits, truth = lane.episodes.robot, lane.episodes.limits, lane.episodes.core.truth[0]
        overlays, trunk = overlays_of(lane.episodes), (truth[TRUNK_ANGLE], truth[TRUNK_RATE])
        margin = standing_margin(robot, limits, Feet(tuple(truth[SWING_POSITION][:2])), truth[DCM], *trunk)
        assert inside(overlays["capture region"], overlays["DCM"]) == pytest.approx(margin, abs=2e-3)
        assert len(overlays["planned step"]) == len(overlays["box of steps"]) == 0
        leant = max(leant, np.abs(trunk[0]).max())
    assert leant > 0.15
    assert lane.stands
    lane.close()


def test_the_support_is_the_hull_of_the_loaded_soles(lane):
    areas = []
    for _ in range(60):
        lane.step()
        row, support = lane.rows[-1], overlays_of(lane.episodes)["support polygon"]
        if row["left_contact"] + row["right_contact"] == 1.0:
            areas.append(area(support))
    np.testing.assert_allclose(areas, 0.02, rtol=0.02)
