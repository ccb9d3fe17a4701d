"""viser behind our door: its own server asks nobody who they are."""

from __future__ import annotations

import contextlib
import functools
import socket
import threading
from collections.abc import Callable, Generator
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from dynid.core.errors import InputError, JobError
from dynid.core.optional import require
from dynid.studio.door import Door, Ruling, rule

if TYPE_CHECKING:
    import viser

TITLE = "dynid studio"
DEFAULT_PORT = 8080
_THEIR_TITLE = b"<title>Viser</title>"
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' ws: data: blob:; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_patching = threading.Lock()


def open_server(door: Door, port: int | None) -> viser.ViserServer:
    """Start the page's server.

    Args:
        door: Who may come in.
        port: Where to listen; None for the usual port or the next free one, 0 for any.

    Raises:
        InputError: The address or port cannot be listened on.
        JobError: viser has changed so much that the door does not hold.
        MissingExtraError: viser is not installed.
    """
    viser_ = require("viser", "studio")
    # viser tries a thousand ports in silence, and then waits for ever.
    chosen = _free(door.host, DEFAULT_PORT if port is None else port, search=port is None)
    require("rich", "studio").get_console().quiet = True
    guard = _Guard(door, chosen)
    with guard.installed():
        server: viser.ViserServer = viser_.ViserServer(
            host=door.host, port=chosen, label=TITLE, verbose=False
        )
    guard.port = server.get_port()
    if not guard.holds:
        server.stop()
        raise JobError(
            "this version of viser cannot be guarded",
            value=viser_.__version__,
            next_step="Run: pip install 'viser<2'",
        )
    _close_the_back_door(server)
    return server


class _Guard:
    """Asks the door before viser answers."""

    def __init__(self, door: Door, port: int) -> None:
        self.door, self.port = door, port
        self.holds = False
        self._title = TITLE.encode()

    @contextlib.contextmanager
    def installed(self) -> Generator[None]:
        """Guard every server that is started within.

        viser passes no options on to the library it listens with, so that is wrapped for as
        long as its server starts.
        """
        module: Any = require("websockets.asyncio.server", "studio")
        serve = module.serve

        @functools.wraps(serve)
        def guarded(*args: Any, **options: Any) -> Any:
            options["process_request"] = self.wrap(options.get("process_request"))
            self.holds = True
            return serve(*args, **options)

        with _patching:
            module.serve = guarded
            try:
                yield
            finally:
                module.serve = serve

    def wrap(self, answer: Callable[[Any, Any], Any] | None) -> Callable[[Any, Any], Any]:
        """The handler of requests, behind the door."""

        def guarded(connection: Any, request: Any) -> Any:
            headers = {name.lower(): value for name, value in request.headers.raw_items()}
            ruling = rule(self.door, self.port, request.path, headers)
            if ruling.status != HTTPStatus.OK:
                return _refusal(connection, ruling)
            if headers.get("upgrade", "").lower() == "websocket" or answer is None:
                return None
            # Whole and unpacked, so that the title can be ours.
            del request.headers["Accept-Encoding"]
            return self._ours(answer(connection, request))

        return guarded

    def _ours(self, response: Any) -> Any:
        if response is None:
            return None
        body: bytes = response.body or b""
        if _THEIR_TITLE in body[:20_000]:
            title = b"<title>" + self._title + b"</title>"
            response.body = body.replace(_THEIR_TITLE, title, 1)
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
        for name, value in _HEADERS.items():
            response.headers[name] = value
        return response


def _refusal(connection: Any, ruling: Ruling) -> Any:
    response = connection.respond(HTTPStatus(ruling.status), f"dynid studio: {ruling.reason}\n")
    if ruling.cookie is not None:
        response.headers["Set-Cookie"] = ruling.cookie
        response.headers["Location"] = "/"
    for name, value in _HEADERS.items():
        response.headers[name] = value
    return response


def _close_the_back_door(server: viser.ViserServer) -> None:
    """Forget how to share the page through viser's public relay: nothing here leaves the house."""
    messages: Any = require("viser._messages", "studio")
    inner: Any = server
    inner._websock_server.unregister_handler(messages.ShareUrlRequest)
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")


def _free(host: str, port: int, *, search: bool) -> int:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    last = min(port + 50, 65535) if search else port
    for candidate in range(port, last + 1):
        try:
            with socket.socket(family, socket.SOCK_STREAM) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((host, candidate))
                return candidate
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            if candidate == last:
                raise InputError(
                    f"cannot listen there: {reason}",
                    where="--host, --port",
                    value=f"{host}:{candidate}",
                ) from error
    raise InputError("no free port", where="--port", value=port)
