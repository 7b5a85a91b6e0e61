"""The page of an episode: it holds what happened, and asks nobody for anything."""

import base64
import re
import shutil

import numpy as np
import pytest
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.policy_source import acting_in

pytest.importorskip("viser", reason="needs the extra play")
pytest.importorskip("mjviser", reason="needs the extra play")

from push_recovery.eval.play.replay import Replay

SCENARIO = Scenario("shove", (Push((0.0, -200.0, 0.0), 0.1, 0.2),), duration=0.5)


@pytest.fixture(scope="module")
def episode():
    """A page, and where the pelvis was on the floor when it was drawn."""
    places = []
    with acting_in("PushRecovery/Biped-v0", "two-stage") as (env, acting, _):
        replay = Replay(env, "two-stage")

        def watch(robot):
            replay(robot)
            if round(robot.info["time"] * 100) % 3 == 0 or robot.ended:
                places.append(replay.robot.meshes._data.xpos[replay.robot.meshes._pelvis, :2].copy())

        rollout(env, acting, SCENARIO, "two-stage", watch)
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
    argv = ["play", "--env", "PushRecovery/Pendulum-v0", "--out", str(tmp_path / "push.html")]
    assert main(argv) == 2
    assert "only bipeds" in capsys.readouterr().err
