"""Pictures of the biped: what is drawn, where, and that drawing changes nothing."""

import os
import select
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from push_recovery.envs.biped import view as biped_view
from push_recovery.envs.biped.env import BipedEnv
from push_recovery.envs.biped.view import ARROW, FADE, add_markers, push_opacity, set_posture, to_world
from push_recovery.envs.rendering import RenderError, make_context, require_display
from push_recovery.envs.robots.biped import biped_model
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

import push_recovery  # noqa: F401

LATERAL = Scenario("left", (Push((0.0, 300.0, 0.0), 0.1, 0.02),))
HOLD = np.zeros(7, np.float32)


@pytest.fixture(scope="module")
def env():
    try:
        make_context(8, 8).free()
    except RenderError as error:
        pytest.skip(str(error))
    made = gym.make("PushRecovery/Biped-v0", render_mode="rgb_array")
    yield made
    made.close()


def run(env, periods, scenario=LATERAL):
    _, info = env.reset(options={"scenario": scenario})
    for _ in range(periods):
        info = env.step(HOLD)[4]
    return info


def markers(core):
    """Marker geoms of robot 0 as (kind, position, size, opacity)."""
    model = biped_model()
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, maxgeom=50)
    set_posture(model, data, core)
    add_markers(scene, data, core)
    return data, [(g.type, g.pos.copy(), g.size.copy(), float(g.rgba[3])) for g in scene.geoms[: scene.ngeom]]


def reddish(image):
    red, green, blue = (image[..., i].astype(int) for i in range(3))
    return (red > 100) & (red > 3 * green) & (red > 3 * blue)


def assert_same_picture(a, b):
    """Equal but for the rounding of the driver's threads."""
    assert np.abs(a.astype(int) - b.astype(int)).max() <= 2


def test_image_is_an_image_and_repeats(env):
    run(env, 1)
    image = env.render()
    assert image.shape == (480, 640, 3)
    assert image.dtype == np.uint8
    assert image.std() > 10
    assert_same_picture(image, env.render())


def test_drawing_does_not_touch_the_simulation(env):
    def state(draw):
        env.reset(options={"scenario": LATERAL})
        for _ in range(15):
            env.step(HOLD)
            if draw:
                env.render()
        core = env.unwrapped.core
        return core.physics.qpos[0].copy(), core.physics.qvel[0].copy()

    for plain, drawn in zip(state(False), state(True), strict=True):
        np.testing.assert_array_equal(plain, drawn)


def test_arrow_is_drawn_while_the_push_acts_and_points_at_the_pelvis(env):
    run(env, 2, Scenario("calm"))
    calm = reddish(env.render())
    run(env, 6)
    red = reddish(env.render()) & ~calm
    assert red.sum() > 500
    columns = np.flatnonzero(red.any(axis=0))
    assert columns[0] < 200  # a push of 300 N to the robot's left comes from the left of the picture
    assert 250 < columns[-1] < 320  # and ends at the pelvis, which is in the middle


def test_arrow_length_and_side(env):
    run(env, 6)
    data, geoms = markers(env.unwrapped.core)
    arrow = next(g for g in geoms if g[0] == mujoco.mjtGeom.mjGEOM_ARROW)
    assert arrow[2][2] == pytest.approx(2 * 300 * ARROW)  # MuJoCo draws half of it
    assert arrow[1][0] == pytest.approx(data.xipos[1, 0])
    assert arrow[1][1] < data.xipos[1, 1] - 300 * ARROW
    assert arrow[3] == 1.0


def test_opacity_of_a_push():
    assert push_opacity(0.99, 1.0, 0.1) == 0.0
    assert push_opacity(1.0, 1.0, 0.1) == 1.0
    assert push_opacity(1.1, 1.0, 0.1) == pytest.approx(1.0)
    assert push_opacity(1.1 + FADE / 2, 1.0, 0.1) == pytest.approx(0.5)
    assert push_opacity(1.1 + FADE, 1.0, 0.1) == pytest.approx(0.0, abs=1e-12)
    assert push_opacity(5.0, np.inf, 0.1) == 0.0


@pytest.mark.parametrize("side", ["left", "right"])
def test_markers_lie_where_info_says(env, side):
    info = run(env, 3, Scenario("start", stance_side=side))
    core = env.unwrapped.core
    _, geoms = markers(core)
    box = next(g for g in geoms if g[0] == mujoco.mjtGeom.mjGEOM_BOX)
    spheres = [g[1][:2] for g in geoms if g[0] == mujoco.mjtGeom.mjGEOM_SPHERE]
    np.testing.assert_allclose(spheres, [info["dcm"], info["cop"]], atol=1e-6)
    plan = core.gait.plan[0]
    np.testing.assert_allclose(box[1][:2], to_world(core, plan[0], plan[1])[:2], atol=1e-6)
    stance_to_target = box[1][1] - to_world(core, 0.0, 0.0)[1]
    assert np.sign(stance_to_target) == (-1.0 if side == "left" else 1.0)


def test_two_views_live_side_by_side_and_close_twice(env):
    run(env, 1)
    before = env.render()
    other = BipedEnv(render_mode="rgb_array")
    run(other, 1)
    assert_same_picture(other.render(), before)
    view = other._picture
    other.close()
    view.close()
    with pytest.raises(RenderError, match="closed"):
        view.draw(env.unwrapped.core)
    assert_same_picture(env.render(), before)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="displays are found otherwise")
@pytest.mark.parametrize("env_id", ["PushRecovery/Biped-v0", "PushRecovery/Pendulum-v0"])
def test_window_without_a_display_is_a_clear_warning(monkeypatch, env_id):
    """The environment runs unseen, so that Gymnasium's checker passes; `play` refuses, see test_cli."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    human = gym.make(env_id, render_mode="human")
    with pytest.warns(RuntimeWarning, match=r"display.*rgb_array.*Nothing is shown"):
        human.reset(seed=0)
    human.step(np.zeros(7, np.float32))
    assert human.render() is None
    human.close()
    with pytest.raises(RenderError, match=r"display.*rgb_array"):
        require_display()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other backends")
def test_error_names_both_backends_where_neither_works():
    """In a process of its own, where neither library can be imported."""
    code = (
        "import sys\n"
        "sys.modules['mujoco.egl'] = sys.modules['mujoco.osmesa'] = None\n"
        "from push_recovery.envs.rendering import RenderError, make_context\n"
        "try: make_context(8, 8)\n"
        "except RenderError as error: print(error)\n"
    )
    clean = {key: value for key, value in os.environ.items() if key not in {"MUJOCO_GL", "PYOPENGL_PLATFORM"}}
    done = subprocess.run([sys.executable, "-c", code], env=clean, capture_output=True, text=True, check=True)
    assert "egl: " in done.stdout
    assert "osmesa: " in done.stdout
    assert "libosmesa6" in done.stdout


def in_forked_child(act) -> str:
    """What `act` raises in a forked child, as text; the child has 20 s."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            act()
            os.write(writing, b"nothing")
        except BaseException as error:
            os.write(writing, f"{type(error).__name__}: {error}".encode())
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answered = select.select([pipe], [], [], 20.0)[0]
        if not answered:
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return pipe.read().decode() if answered else "no answer"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_child_is_refused_a_picture_and_does_not_hang(env):
    env.reset(seed=0)
    env.render()

    def draw_anew():
        other = gym.make("PushRecovery/Biped-v0", render_mode="rgb_array")
        other.reset(seed=0)
        other.render()

    for act in (env.render, draw_anew):
        said = in_forked_child(act)
        assert said.startswith(f"RenderError: a picture was opened in process {os.getpid()}, "), said
        assert "'spawn'" in said
    assert in_forked_child(env.close) == "nothing"
    assert env.render().shape == (480, 640, 3)


def test_another_thread_is_refused_the_picture_of_the_first_one(env):
    env.reset(seed=0)
    env.render()
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(RenderError, match="drawn by the thread that opened it"):
            pool.submit(env.render).result(20.0)
        own = pool.submit(gym.make, "PushRecovery/Biped-v0", render_mode="rgb_array").result(60.0)
        pool.submit(own.reset, seed=0).result(60.0)
        assert pool.submit(own.render).result(60.0).shape == (480, 640, 3)
        pool.submit(own.close).result(20.0)
    assert env.render().shape == (480, 640, 3)


def test_an_arrow_at_a_foot_is_low_in_the_picture(env):
    """The camera looks at a height of 0.72 m, half-way down the 480 rows; a foot is 0.7 m lower."""
    push = Push((0.0, 300.0, 0.0), 0.1, 0.02, "left_foot")
    run(env, 2, Scenario("calm"))
    calm = reddish(env.render())
    run(env, 6, Scenario("low", (push,)))
    red = reddish(env.render()) & ~calm
    assert red.sum() > 100
    assert np.flatnonzero(red.any(axis=1)).min() > 280


@pytest.mark.parametrize("body", ["pelvis", "trunk", "left_shank", "right_foot"])
def test_an_arrow_points_at_the_body_that_is_pushed(biped_core, begin, body):
    core = biped_core()
    begin(core, 0, Scenario("a", (Push((0.0, 300.0, 0.0), 0.1, 0.0, body),)))
    data, geoms = markers(core)
    arrow = next(g for g in geoms if g[0] == mujoco.mjtGeom.mjGEOM_ARROW)
    wanted = data.body(body).xipos
    assert arrow[1][[0, 2]] == pytest.approx(wanted[[0, 2]], abs=1e-6)


def test_the_planned_foothold_lies_along_the_heading(biped_core, begin):
    core, model = biped_core(), biped_model()
    begin(core, 0, Scenario("a"))
    core.gait.heading[0] = 0.5
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, maxgeom=50)
    set_posture(model, data, core)
    add_markers(scene, data, core)
    box = next(g for g in scene.geoms[: scene.ngeom] if g.type == mujoco.mjtGeom.mjGEOM_BOX)
    forward = np.reshape(box.mat, (3, 3))[:, 0]
    assert forward == pytest.approx([np.cos(0.5), np.sin(0.5), 0.0], abs=1e-6)


def test_a_window_waits_for_the_clock_and_starts_over_where_it_is_late(monkeypatch):
    now, slept = [100.0], []
    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=slept.append)
    monkeypatch.setattr(biped_view, "time", clock)
    window = SimpleNamespace(_lead=-np.inf)
    biped_view._Window._wait(window, 5.0)  # the first picture
    assert (window._lead, slept) == (-95.0, [])
    now[0] = 100.004
    biped_view._Window._wait(window, 5.01)  # 4 of 10 ms have gone by
    assert slept == pytest.approx([0.006])
    now[0] = 100.05
    biped_view._Window._wait(window, 5.02)  # 30 ms late: neither waits nor starts over
    assert (window._lead, len(slept)) == (-95.0, 1)
    now[0] = 102.0
    biped_view._Window._wait(window, 5.03)  # 2 s late: starts over
    assert window._lead == pytest.approx(5.03 - 102.0)
    biped_view._Window._wait(window, 0.0)  # a reset: starts over
    assert window._lead == pytest.approx(-102.0)
    biped_view._Window._wait(window, 0.6)  # 0.6 s ahead: no wait as long as that
    assert (window._lead, len(slept)) == (pytest.approx(0.6 - 102.0), 1)
