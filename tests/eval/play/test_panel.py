"""The keys of the panel beside the scene."""

from unittest.mock import MagicMock

from push_recovery.eval.play.browser import Panel

CAMERA = set("WASDQE")  # viser's own keys: they move the camera


def test_no_key_moves_the_camera_as_well():
    server = MagicMock()
    Panel(server, MagicMock(), ["two-stage"], lambda action: None, (10.0, 90.0))
    keys = [call.kwargs["hotkey"] for call in server.gui.add_command.call_args_list]
    assert sorted(keys) == ["F", "N", "P", "R", "space"]
    assert not CAMERA & set(keys)
