"""The page driven in a real Chromium without a screen.

The session's clock stands still but where a test lets time go by, so that nothing here hangs on the speed of
the machine; what is waited for is waited for with a long limit.
"""

import shutil
import time
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("viser", reason="needs the extra play")
pytest.importorskip("mjviser", reason="needs the extra play")
sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright to drive a browser")

from push_recovery.envs.scenario.scenario import Command  # noqa: E402
from push_recovery.eval.play.browser import (  # noqa: E402
    PHONE_CAMERA,
    PHONE_LOOK_AT,
    camera_axes,
    look_above_the_panel,
    open_app,
)
from push_recovery.eval.play.gate import Gate  # noqa: E402
from push_recovery.eval.play.scene import CAMERA, LOOK_AT  # noqa: E402
from push_recovery.eval.play.session import IMPULSE_PER_METRE, FirstPush, Session  # noqa: E402

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
    "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync",
]  # fmt: skip
PATIENCE = 240.0  # [s]
PICTURE = (800, 320)  # the panel covers the right 335 pixels
PHONE = (390, 844)
PELVIS = 0.74  # height of a walking robot's [m]
CURSORS = "[...document.querySelectorAll('canvas')].map(canvas => canvas.style.cursor)"
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")


def wait(app, condition, what):
    """Let frames go by, with the clock at rest, until something is true."""
    until = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < until, f"waited {PATIENCE:g} s for {what}"
        app.frame(0.0)
        time.sleep(0.03)


def click(app, button, condition, what):
    """Click until something is true, again after 10 s: a click is lost where the page is just built anew."""
    due = 0.0

    def met():
        nonlocal due
        if not condition() and time.monotonic() >= due:
            button.click()
            due = time.monotonic() + 10.0
        return condition()

    wait(app, met, what)


def wait_for_camera(app, camera, position, look_at):
    """A page tells its camera a while after it has connected; until then viser has another place for it."""
    told = [position, look_at]
    wait(app, lambda: np.allclose([camera.position, camera.look_at], told, atol=1e-3), "the page's camera")


@pytest.fixture(scope="module")
def played():
    """An app, and a page that looks at it."""
    session = Session("PushRecovery/Biped-v0", "two-stage")
    app = open_app(session, ["two-stage", "stage-1"], Gate("127.0.0.1"), 8790, FirstPush(12.0, 90.0))
    app.server.scene.configure_default_lights(cast_shadow=False)  # drawn without a graphics card
    for _ in range(45):
        session.step()
    asked = []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS, timeout=1e3 * PATIENCE)
        size: dict = {"width": PICTURE[0], "height": PICTURE[1]}
        page = browser.new_context(viewport=size).new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda socket: asked.append(socket.url))
        address = f"127.0.0.1:{app.server.get_port()}"
        page.goto(f"http://{address}/")
        wait(app, app.server.get_clients, "the page's connection")
        (client,) = app.server.get_clients().values()
        wait_for_camera(app, client.camera, CAMERA, LOOK_AT)
        page.get_by_text("walks, 0.5 s").wait_for()
        yield SimpleNamespace(app=app, session=session, page=page, asked=asked, address=address)
        browser.close()
    app.server.stop()
    session.close()


def on_the_screen(camera, point, picture=PICTURE):
    """Pixel and depth [m] of a point in the scene, by a pinhole camera."""
    x, y, depth = camera_axes(camera.wxyz).T @ (np.asarray(point) - camera.position)
    focal = picture[1] / 2 / np.tan(camera.fov / 2)
    return picture[0] / 2 + focal * x / depth, picture[1] / 2 + focal * y / depth, depth


def hover(played, camera, point):
    """Move the mouse to a point of the scene until the page shows that what is there can be dragged.

    Returns pixel and depth.
    """
    found = ()

    def shown():
        nonlocal found
        x, y, depth = on_the_screen(camera, point)
        found = round(x), round(y), depth
        for way in (1, 0):
            played.page.mouse.move(found[0] + way, found[1])
        return "pointer" in played.page.evaluate(CURSORS)

    wait(played.app, shown, "a body under the mouse")
    return found


def test_it_asks_for_nothing_outside(played):
    assert f"http://{played.address}/" in played.asked
    assert f"ws://{played.address}" in {url.rstrip("/") for url in played.asked}
    others = [url for url in played.asked if played.address not in url]
    assert all(url.startswith(("data:", "blob:")) for url in others)


def test_a_drag_of_so_many_pixels_is_the_push_shown_and_given(played):
    app, mouse, pixels = played.app, played.page.mouse, 20
    camera = next(iter(app.server.get_clients().values())).camera
    x, y, depth = hover(played, camera, (0.0, 0.0, app._pelvis[2] + 0.25))  # the trunk
    mouse.down()
    metres = 2.0 * depth * np.tan(camera.fov / 2.0) / PICTURE[1]  # of a pixel, by a pinhole camera
    of_a_pixel = IMPULSE_PER_METRE * metres
    expected = of_a_pixel * pixels

    def aimed():
        """A page that is slow makes one event of several, and the first one only begins the drag."""
        for way in (8, 14, pixels):
            mouse.move(x + way, y)
        return app.aimed.text and float(app.aimed.text.split()[0]) > 0.9 * expected

    wait(app, aimed, "the arrow")
    text = app.aimed.text
    shown = float(text.split()[0])
    assert shown == pytest.approx(expected, rel=0.06)  # the trunk's skin is nearer than its middle
    assert float(text.split("(")[1].split()[0]) == pytest.approx(shown / 60.0, abs=0.006)
    assert played.session.last is None
    mouse.up()
    wait(app, lambda: played.session.last is not None, "the push")
    push = played.session.last.push
    assert push.impulse_magnitude == pytest.approx(shown, abs=0.05 + 1e-9)
    assert push.body == "trunk"
    right = camera_axes(camera.wxyz)[:2, 0]
    np.testing.assert_allclose(push.impulse[:2], push.impulse_magnitude * right, atol=of_a_pixel)
    for _ in range(15):
        played.session.step()
    delivered = played.session.first.episodes.core.pushes.delivered[0, 0]
    np.testing.assert_allclose(delivered, push.impulse, atol=1e-9)
    wait(app, lambda: app.given.text == text or not app.given.text, "the arrow of the push given")


def test_another_policy_goes_another_way_from_the_same_push(played):
    session, page = played.session, played.page
    for _ in range(15):
        session.step()
    before = session.first.rows[-1]
    page.locator("input[role=combobox][value=two-stage]").click()
    page.get_by_role("option", name="stage-1", exact=True).first.click()
    wait(played.app, lambda: session.first.name == "stage-1", "the other policy")
    page.keyboard.press("Escape")
    replay = page.get_by_role("button", name="Replay the last push")
    click(played.app, replay, lambda: session.first.time < before["time"], "the replay")
    while session.first.time < before["time"] - 1e-9:
        session.step()
    assert session.first.rows[-1]["time"] == pytest.approx(before["time"])
    assert session.first.rows[-1]["dcm_y"] != before["dcm_y"]


def test_a_key_pushes(played):
    session = played.session
    session.restart()
    for _ in range(20):
        session.step()
    played.page.mouse.click(200, 380)
    played.page.keyboard.press("Space")
    wait(played.app, lambda: session.first.scenario.pushes, "the push")
    assert session.first.scenario.pushes[0].impulse == pytest.approx((0.0, 12.0, 0.0))


def test_another_kind_is_chosen_and_given(played):
    session, page = played.session, played.page
    session.restart()
    for _ in range(20):
        session.step()
    page.locator("input[role=combobox][value=push]").click()
    page.get_by_role("option", name="steady force", exact=True).click()
    page.get_by_role("button", name="Push [space]").click()
    wait(played.app, lambda: session.first.scenario.pushes, "the force")
    assert session.first.given == ["steady force"]
    for _ in range(110):
        session.step()
    delivered = session.first.episodes.core.pushes.delivered[0, 0]
    np.testing.assert_allclose(delivered, [0.0, 12.0, 0.0], atol=1e-6)
    played.app.frame(0.0)
    page.get_by_text("steady force of nominally").wait_for()
    page.locator("input[role=combobox][value='steady force']").click()
    page.get_by_role("option", name="push", exact=True).click()
    page.keyboard.press("Escape")


def test_a_box_lets_the_robot_stand_and_its_answer_is_told(played):
    session, page = played.session, played.page
    session.switch("two-stage")
    page.get_by_text("stand at rest").click()
    wait(played.app, lambda: session.first.command == Command(stand=True), "the command to stand")
    for _ in range(200):
        session.step()
    session.push([10.0, 0.0])
    for _ in range(50):
        session.step()
    played.app.frame(0.0)
    page.get_by_text("answer to the push: ankles").wait_for()
    page.get_by_text("stand at rest").click()
    wait(played.app, lambda: session.first.command == Command(), "the command to step in place")


def test_two_windows_see_the_same_robot(played):
    other = played.page.context.new_page()
    other.goto(f"http://{played.address}/")
    wait(played.app, lambda: len(played.app.server.get_clients()) == 2, "the second window")
    played.session.paused = True
    played.app.frame(0.0)
    for page in (played.page, other):
        page.get_by_text("paused").wait_for()
    other.close()
    wait(played.app, lambda: len(played.app.server.get_clients()) == 1, "the second window's end")


def test_on_a_phone_the_robot_is_above_the_panel(played):
    server = played.app.server
    others = set(server.get_clients())
    browser = played.page.context.browser
    page = browser.new_page(viewport={"width": PHONE[0], "height": PHONE[1]}, device_scale_factor=2)
    page.set_default_timeout(1e3 * PATIENCE)
    page.goto(f"http://{played.address}/")
    wait(played.app, lambda: set(server.get_clients()) - others, "the phone's connection")
    (new,) = set(server.get_clients()) - others
    camera = server.get_clients()[new].camera
    wait_for_camera(played.app, camera, PHONE_CAMERA, PHONE_LOOK_AT)
    name = on_the_screen(camera, (0.0, 0.0, PELVIS + 0.75), PHONE)  # of a robot that no push has lowered
    floor = on_the_screen(camera, (0.0, 0.0, 0.0), PHONE)
    assert name[1] > 0.05 * PHONE[1]
    assert floor[1] - name[1] > 0.2 * PHONE[1]  # it's not too small to be seen
    assert page.get_by_text("push-recovery play").bounding_box()["y"] > floor[1] + 20
    page.close()
    wait(played.app, lambda: set(server.get_clients()) == others, "the phone's end")


def done(coroutine):
    """Let a coroutine that waits for nothing run to its end."""
    with pytest.raises(StopIteration):
        coroutine.send(None)


class Camera:
    """What a page tells of its camera, and who is told of it."""

    def __init__(self):
        self.callbacks, self.atomic = [], nullcontext
        self.camera, self.on_update = self, self.callbacks.append

    def tells(self, position, look_at, aspect):
        """The camera after the answers to what the page has told."""
        self.position, self.look_at, self.aspect = position, look_at, aspect
        for callback in self.callbacks:
            done(callback(self))
        return self.position, self.look_at


def test_a_phone_is_put_above_the_panel_whenever_it_takes_the_initial_camera():
    """In the order of a page that loads: it knows its size late, and takes the initial camera twice."""
    camera = Camera()
    done(look_above_the_panel(camera))
    phone, initial, own = (PHONE_CAMERA, PHONE_LOOK_AT), (CAMERA, LOOK_AT), ((1.0, 2.0, 3.0), LOOK_AT)
    assert camera.tells(*initial, 2.0) == initial  # a canvas without a size, or a desktop
    assert camera.tells(*initial, 0.46) == phone
    assert camera.tells(*phone, 0.46) == phone
    assert camera.tells(*initial, 0.46) == phone
    assert camera.tells(*own, 0.46) == own  # somebody has turned the view


def connected(address, **head):
    """The status that a connection is answered with; 101: it stands."""
    import viser
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    try:
        connect(f"ws://{address}", subprotocols=[f"viser-v{viser.__version__}"], **head).close()
    except InvalidStatus as error:
        return error.response.status_code
    return 101


def test_pages_of_others_and_those_without_the_token_are_refused():
    session = Session("PushRecovery/Biped-v0", "two-stage")
    app = open_app(session, ["two-stage"], Gate("127.0.0.1", "word"), 8795, FirstPush(10.0, 0.0))
    address = f"127.0.0.1:{app.server.get_port()}"
    cookie = {"Cookie": f"push-recovery-{app.server.get_port()}=word"}
    try:
        own = f"http://{address}"
        assert connected(address, origin=own, additional_headers=cookie) == 101
        assert connected(address, origin=own) == 403
        assert connected(address, origin="http://evil.example", additional_headers=cookie) == 403
        assert connected(address, additional_headers=cookie) == 403
    finally:
        app.server.stop()
        session.close()
