"""Keys and mouse of the window without a window, and the keys of the panel in the browser."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import mujoco
import numpy as np
import pytest
from push_recovery.envs.biped.view import set_posture
from push_recovery.envs.rendering import RenderError
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.play import desktop as in_window
from push_recovery.eval.play.browser import App, Panel
from push_recovery.eval.play.desktop import Desktop, play_in_window
from push_recovery.eval.play.session import FirstPush, Session, push_now


@pytest.fixture
def desktop():
    session = Session("PushRecovery/Biped-v0", "two-stage")
    yield Desktop(session, FirstPush(12.0, 90.0))
    session.close()


def press(desktop, keys):
    for key in keys:
        desktop.key(ord(key))
    desktop.answer_keys()


def test_keys_push_repeat_pause_step_and_slow_down(desktop, capsys):
    session = desktop.session
    press(desktop, "R")
    assert "no push yet" in capsys.readouterr().out
    for _ in range(20):
        session.step()
    press(desktop, " ")
    assert session.last.push.impulse == pytest.approx((0.0, 12.0, 0.0))
    session.advance(0.1)
    press(desktop, "P-")
    assert (session.advance(1.0), session.speed) == (0, 0.5)
    press(desktop, "Fx")
    assert session.first.time == pytest.approx(0.31)
    press(desktop, "R=P")
    assert (session.first.time, session.speed) == (pytest.approx(0.2), 1.0)
    press(desktop, "N")
    assert (session.first.time, session.paused) == (0.0, False)


def test_a_key_has_a_robot_at_rest_stand_and_step_again(desktop):
    session = desktop.session
    for stands in (True, False):
        press(desktop, "S")
        for _ in range(150):
            session.step()
        assert session.first.stands is stands


def test_a_drag_by_mouse_pushes_where_it_is_let_go(desktop):
    core = desktop.session.first.episodes.core
    data = mujoco.MjData(core.body.model)
    set_posture(core.body.model, data, core)
    trunk = core.body.indices.trunk
    held = np.array([0.05, 0.0, 0.1])  # in the body's axes
    grabbed = data.xpos[trunk] + data.xmat[trunk].reshape(3, 3) @ held
    for way in ([0.05, 0.0, 0.0], [0.12, -0.2, 0.3]):
        mouse = SimpleNamespace(active=1, select=trunk, localpos=held, refselpos=grabbed + way)
        desktop.answer_mouse(mouse, data)
        assert desktop.session.last is None
    for _ in range(2):
        desktop.answer_mouse(SimpleNamespace(active=0, select=trunk), data)
    assert desktop.session.last.push.impulse == pytest.approx((12.0, -20.0, 0.0))
    assert desktop.session.last.push.body == "trunk"
    assert len(desktop.session.first.scenario.pushes) == 1


def test_without_a_display_nothing_is_made(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RenderError, match="needs a display"):
        play_in_window(lambda: pytest.fail("a session was made"), FirstPush(10.0, 0.0))


def test_no_key_of_the_panel_moves_the_camera_as_well():
    server = MagicMock()
    Panel(server, MagicMock(), ["two-stage"], lambda action: None, FirstPush(10.0, 90.0))
    keys = [call.kwargs["hotkey"] for call in server.gui.add_command.call_args_list]
    assert sorted(keys) == ["F", "N", "P", "R", "space"]
    assert not set("WASDQE") & set(keys)  # viser's own


def test_the_sliders_reach_to_the_command_of_the_start():
    server, session = MagicMock(), MagicMock()
    session.first.command = Command(1.0, -0.8)
    Panel(server, session, ["two-stage"], lambda action: None, FirstPush(10.0, 0.0))
    sliders = [call.args for call in server.gui.add_slider.call_args_list]
    assert all(low <= value <= high for _, low, high, _, value in sliders)
    assert ("forward [m/s]", -1.0, 1.0, 0.05, 1.0) in sliders


def test_a_key_that_nobody_knows_is_left(desktop):
    desktop.key(-1)
    desktop.answer_keys()
    assert desktop.session.last is None


def test_a_drag_of_less_than_half_a_newton_second_is_no_push():
    body = SimpleNamespace(indices=SimpleNamespace(trunk=2))
    lane, pushed = SimpleNamespace(episodes=SimpleNamespace(core=SimpleNamespace(body=body))), []
    session = SimpleNamespace(first=lane, push=lambda impulse, part: pushed.append((impulse.tolist(), part)))
    window = Desktop(session, FirstPush(12.0, 90.0))
    data = SimpleNamespace(xmat=np.tile(np.eye(3).ravel(), (3, 1)), xpos=np.zeros((3, 3)))
    for way in (0.0049, 0.0051):  # [m], 100 N s each
        place = np.array([0.0, way, 0.0])
        held = SimpleNamespace(active=1, select=1, localpos=np.zeros(3), refselpos=place)
        window.answer_mouse(held, data)
        window.answer_mouse(SimpleNamespace(active=0, select=1), data)
    assert pushed == [(pytest.approx([0.0, 0.51]), "pelvis")]


def test_it_reports_recoveries_and_falls_once_each(monkeypatch, capsys):
    said = iter(["walks, 0.1 s", "pushed 0.05 s ago", "recovered 1 s after", "recovered 1 s after",
                 "stands, 3.0 s", "recovered 1 s after", "fell 0.50 s after the push"])  # fmt: skip
    monkeypatch.setattr(in_window, "status_words", lambda lane: next(said))
    window = Desktop(SimpleNamespace(first=None), FirstPush(12.0, 90.0))
    for _ in range(7):
        window.report()
    reported = ["recovered 1 s after", "recovered 1 s after", "fell 0.50 s after the push"]
    assert capsys.readouterr().out.splitlines() == reported


@pytest.mark.parametrize(("time", "shown"), [(0.99, False), (1.0, True), (1.79, True), (1.81, False)])
def test_a_push_is_shown_from_its_start_for_eight_tenths_of_a_second(time, shown):
    class Arrow:
        text = "of before"

        def show_at(self, pelvis, impulse, mass):
            self.text = "shown"

        def hide(self):
            self.text = ""

    scenario, arrow = Scenario("a", (push_now((3.0, 4.0), 1.0),)), Arrow()
    lane = SimpleNamespace(scenario=scenario, push_start=1.0, time=time, mass=60.0)
    app = SimpleNamespace(session=SimpleNamespace(first=lane), given=arrow, _pelvis=np.zeros(3))
    App._draw_given(app)
    assert arrow.text == ("shown" if shown else "")
