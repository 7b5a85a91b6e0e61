"""The gate of the page: this server's own pages may push the robot, from elsewhere only with the token.

Any page that a browser has open may send requests to a server on the same computer. A page's address is in
the header `Origin` of the connection that carries everything; it must be this server's own. On the loopback
interface the name that was asked for must be the loopback's, so that no other name can be pointed at it.
Where there is a token, the page is served to those who have it in the address, and a cookie carries it on.
"""

import contextlib
import http
import http.cookies
import io
import ipaddress
import secrets
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ...controllers.errors import InvalidValueError, MissingExtraError

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
Answer = Callable[[Any, Any], Any]  # of connection and request; None lets a websocket pass


def is_loopback(host: str) -> bool:
    """Whether a host can be reached from this computer alone."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Gate:
    """Decides about every request; where others can reach the host and no token is given, it makes one up."""

    def __init__(self, host: str, token: str = ""):
        self.host = host
        self.token = token or ("" if is_loopback(host) else secrets.token_urlsafe(12))

    def address(self, port: int) -> str:
        """The address that a browser opens."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}" + (f"/?token={self.token}" if self.token else "")

    def refusal(self, path: str, headers: Any, is_websocket: bool) -> str | None:
        """Why a request for a path with its query is refused; None lets it pass. A page is no websocket."""
        here = headers.get("Host", "")
        if is_loopback(self.host) and urlsplit(f"//{here}").hostname not in LOOPBACK_NAMES:
            return "the host asked for is not this computer"
        if is_websocket and headers.get("Origin") != f"http://{here}":
            return "the page that asks is not this server's own"
        if self.token and not self._shown(path, headers, is_websocket):
            return "the address lacks the token that push-recovery play has printed"
        return None

    def cookie(self, port: int) -> str:
        """The header that lets the page's own requests carry the token."""
        return f"{self._name(port)}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    def guarding(self, answer: Answer) -> Answer:
        """The answer to a request after this gate has been asked."""
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        def guarded(connection: Any, request: Any) -> Any:
            websocket = request.headers.get("Upgrade", "").lower() == "websocket"
            reason = self.refusal(request.path, request.headers, websocket)
            if reason is not None:
                body, status = f"refused: {reason}\n".encode(), http.HTTPStatus.FORBIDDEN
                head = Headers(**{"Content-Type": "text/plain", "Content-Length": str(len(body))})
                return Response(status, "Forbidden", head, body)
            answered = answer(connection, request)
            if self.token and answered is not None:
                answered.headers["Set-Cookie"] = self.cookie(connection.local_address[1])
            return answered

        return guarded

    def _shown(self, path: str, headers: Any, is_websocket: bool) -> bool:
        given = [] if is_websocket else parse_qs(urlsplit(path).query).get("token", [])
        port = urlsplit(f"//{headers.get('Host', '')}").port or 80
        kept = http.cookies.SimpleCookie(headers.get("Cookie", "")).get(self._name(port))
        given += [] if kept is None else [kept.value]
        return any(secrets.compare_digest(value.encode(), self.token.encode()) for value in given)

    @staticmethod
    def _name(port: int) -> str:
        return f"push-recovery-{port}"


def open_server(gate: Gate, port: int) -> Any:
    """A server of viser behind a gate; it takes the next port that is free.

    viser has no place for a check of its own, so the call by which it opens its socket is led through here.
    """
    try:
        import viser
        import websockets.asyncio.server as sockets
        from viser import _messages
    except ImportError as error:
        raise MissingExtraError("viser", "play") from error
    require_own(gate.host)
    serve = sockets.serve

    def guarded(*args: Any, process_request: Answer, **options: Any) -> Any:
        return serve(*args, process_request=gate.guarding(process_request), **options)

    sockets.serve = guarded  # type: ignore[assignment, misc]
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            server = viser.ViserServer(gate.host, port, verbose=False)
    finally:
        sockets.serve = serve  # type: ignore[misc]
    # viser's way of leading the outside world in, which any page could ask for
    server._websock_server.unregister_handler(_messages.ShareUrlRequest)
    return server


def require_own(host: str) -> None:
    """Raise InvalidValueError where a host can't be listened on."""
    import socket

    try:
        kind, _, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(kind, socket.SOCK_STREAM) as probe:
            probe.bind(address)
    except OSError as error:
        reason = error.strerror or error
        raise InvalidValueError(f"--host {host!r} is no address of this computer: {reason}") from None
