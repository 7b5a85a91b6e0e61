"""Places on the floor against the robot's own feet and the planner's limits, on either foot and turned."""

import base64
import re
import shutil
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import capture_margin
from push_recovery.controllers.model.observation import DCM, ELAPSED, SWING_POSITION, TRUNK_ANGLE, TRUNK_RATE
from push_recovery.controllers.model.standing import Feet, standing_margin
from push_recovery.controllers.whole_body.kinematics import sole_position
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.play.scene import COLOURS, FloorMarks, PushArrow, Replay, overlays_of
from push_recovery.eval.play.session import Lane, push_now
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.policy_source import acting_in


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


SHOVE = Scenario("shove", (Push((0.0, -200.0, 0.0), 0.1, 0.2),), duration=0.5)


@pytest.fixture(scope="module")
def episode():
    """A page, and where the pelvis was on the floor when it was drawn."""
    pytest.importorskip("viser", reason="needs the extra play")
    pytest.importorskip("mjviser", reason="needs the extra play")
    places = []
    with acting_in("PushRecovery/Biped-v0", "two-stage") as (env, acting, _):
        replay = Replay(env, "two-stage")

        def watch(robot):
            replay(robot)
            if round(robot.info["time"] * 100) % 3 == 0 or robot.ended:
                places.append(replay.robot.meshes._data.xpos[replay.robot.meshes._pelvis, :2].copy())

        rollout(env, acting, SHOVE, "two-stage", watch)
    return replay.page(), np.array(places)


def test_the_page_holds_the_walk_the_push_and_the_outcome(episode):
    import msgspec
    import zstandard

    page, places = episode
    data = re.search(rb'__VISER_EMBED_DATA__="([^"]+)"', page)
    assert data is not None
    packed = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(data[1])[8:])
    size = int.from_bytes(packed[:8], "little")
    content = msgspec.msgpack.decode(packed[8 : 8 + size])
    assert content["durationSeconds"] == pytest.approx(0.03 * len(places), abs=1e-6)
    told = str(content["messages"])
    assert "20.0 N s  (0.33 N s/kg)" in told
    assert "two-stage: 20.0 N s to the right: still up after 0.3 s" in told
    moved = [
        message["position"][:2]
        for _, message in content["messages"]
        if message.get("name") == "/walk" and "position" in message
    ]
    np.testing.assert_allclose(moved[-1], -places[-1], atol=1e-6)


def test_the_page_opens_from_disk_and_asks_for_nothing(episode, tmp_path):
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright to drive a browser")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no Chromium is installed")
    path = tmp_path / "push.html"
    path.write_bytes(episode[0])
    asked = []
    with sync_api.sync_playwright() as playwright:
        flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        page = playwright.chromium.launch(executable_path=chromium, args=flags, timeout=240e3).new_page()
        page.set_default_timeout(240e3)
        page.on("request", lambda request: asked.append(request.url))
        page.goto(path.as_uri())
        page.wait_for_selector("canvas")
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [path.as_uri()]


def test_only_a_biped_is_replayed_in_3d(tmp_path, capsys):
    pytest.importorskip("viser", reason="needs the extra play")
    argv = ["play", "--env", "PushRecovery/Pendulum-v0", "--out", str(tmp_path / "push.html")]
    assert main(argv) == 2
    assert "only bipeds" in capsys.readouterr().err


def test_an_arrow_ends_at_the_pelvis_and_points_where_it_was_pushed():
    arrow = PushArrow(MagicMock(), "x", (1, 2, 3))
    arrow.show_at(np.array([1.0, 2.0, 0.9]), (20.0, 0.0), 60.0)
    np.testing.assert_allclose(arrow._arrow.points, [[[0.6, 2.0, 1.0], [0.8, 2.0, 1.0]]])


def test_in_the_air_the_dcm_alone_is_marked_and_a_region_is_a_closed_line():
    def mark(*_, **__):
        return SimpleNamespace()

    scene = SimpleNamespace(add_icosphere=mark, add_line_segments=mark, add_mesh_simple=mark)
    marks = FloorMarks(SimpleNamespace(scene=scene), "/robot")
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    places = dict.fromkeys(("capture region", "box of steps", "planned step"), square)
    places |= dict.fromkeys(("DCM", "CoP", "CMP"), np.array([0.1, 0.2]))
    wanted = {**dict.fromkeys(COLOURS, True), "box of steps": False}
    marks.draw({**places, "support polygon": np.empty((0, 2))}, wanted)
    seen = {name for name, one in {**marks._points, **marks._regions}.items() if one.visible}
    assert seen == {"DCM", "capture region"}
    assert marks._points["DCM"].position == (0.1, 0.2, 0.02)
    assert marks._foothold.visible
    line = marks._regions["capture region"].points
    np.testing.assert_allclose(line[:4, 0, :2], square)
    np.testing.assert_allclose(line[:4, 1, :2], np.roll(square, -1, axis=0))
    np.testing.assert_allclose(line[4:], np.repeat(line[3:4], 8, axis=0))


def test_places_stay_what_they_were_while_the_robot_walks_on(lane):
    before = overlays_of(lane.episodes)
    kept = {name: place.copy() for name, place in before.items()}
    lane.step()
    for name, place in kept.items():
        np.testing.assert_array_equal(before[name], place, err_msg=name)
    assert (overlays_of(lane.episodes)["DCM"] != kept["DCM"]).any()
