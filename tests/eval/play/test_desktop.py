"""Keys and mouse of the window without a window, and the keys of the panel in the browser."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import mujoco
import numpy as np
import pytest
from push_recovery.envs.biped.view import set_posture
from push_recovery.envs.rendering import RenderError
from push_recovery.envs.scenario.scenario import Command
from push_recovery.eval.play.browser import Panel
from push_recovery.eval.play.desktop import Desktop, play_in_window
from push_recovery.eval.play.session import FirstPush, Session


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
