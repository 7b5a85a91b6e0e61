"""`push-recovery play`: opens a session to browsers, and plays until Ctrl-C."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

from ....controllers.errors import MissingExtraError
from ..session import Session
from .app import App
from .gate import Gate, open_server


def require_play() -> None:
    """Raise MissingExtraError where viser or mjviser is not installed."""
    for package in ("viser", "mjviser"):
        if find_spec(package) is None:
            raise MissingExtraError(package, "play")


def open_app(
    session: Session, policies: Sequence[str], gate: Gate, port: int, impulse: tuple[float, float]
) -> App:
    """A session behind a gate, at the next port that is free; it does not move until it is run.

    Raises:
        MissingExtraError: viser or mjviser is not installed.
        InvalidValueError: the host is none of this computer's.
    """
    server = open_server(gate, port)
    _never_share(server)
    try:
        return App(session, server, policies, impulse)
    except BaseException:
        server.stop()
        raise


def play(
    session: Session, policies: Sequence[str], gate: Gate, port: int, impulse: tuple[float, float]
) -> None:
    """Say where to look, and play until Ctrl-C."""
    description = session.first.episodes.core.body.description
    if description.looks is not None:
        print(f"reading the meshes of {description.name}, which takes some seconds", flush=True)
    app = open_app(session, policies, gate, port, impulse)
    try:
        print(f"the robot walks at {gate.address(app.server.get_port())}", flush=True)
        print("drag it and let go, or press space; Ctrl-C ends", flush=True)
        app.run()
    finally:
        app.server.stop()
        session.close()


def _never_share(server: Any) -> None:
    """Take away viser's way of leading the outside world in, which any page could ask for."""
    from viser import _messages

    server._websock_server.unregister_handler(_messages.ShareUrlRequest)
