"""viser behind our door: its own server asks nobody who they are.

Who may come in: whoever knows the token, on this machine too.

A page in a browser may talk to any address of this machine, and this page can move a robot. So
requests that another site's page sends are refused: its `Origin` is not ours, and a name that
was made to point here is not one of this machine's.

`dynid studio`: open what a path holds and serve the page until it is told to stop.
"""

from __future__ import annotations

import contextlib
import functools
import hmac
import ipaddress
import secrets
import socket
import threading
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING, Any
from urllib.parse import SplitResult, parse_qs, urlsplit

from dynid.core import InputError, JobError, require
from dynid.studio.opening import open_path
from dynid.studio.solids import robot_meshes

if TYPE_CHECKING:
    import viser


DEFAULT_HOST = "127.0.0.1"
SHORTEST_TOKEN = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Door:
    """The rules of one page."""

    host: str
    """Address to listen on."""
    token: str
    """What a visitor must know: other users and programs of this machine can come too."""

    @property
    def loopback(self) -> bool:
        """Whether no other machine can reach the page."""
        return ipaddress.ip_address(self.host).is_loopback

    def url(self, port: int) -> str:
        """The address to open, token included."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/?token={self.token}"


@dataclass(frozen=True, slots=True)
class Ruling:
    """What becomes of a request."""

    status: int
    """200 to go on, 303 to go on with the cookie that was set, 403 to refuse."""
    reason: str = ""
    cookie: str | None = None
    """Value of `Set-Cookie`."""


def make_door(host: str, token: str | None) -> Door:
    """The rules for an address.

    Args:
        host: An address of this machine; `localhost` is 127.0.0.1.
        token: What visitors must know; None to make one up.

    Raises:
        InputError: No address, or a token that is too short or does not fit into one.
    """
    try:
        address = ipaddress.ip_address(DEFAULT_HOST if host == "localhost" else host)
    except ValueError as error:
        raise InputError(
            "this is no address", where="--host", value=host, limit="such as 127.0.0.1 or 0.0.0.0"
        ) from error
    if token is not None and not _hard_to_guess(token):
        raise InputError(
            "the token can be guessed, or cannot stand in an address",
            where="--token",
            limit=f"{SHORTEST_TOKEN} or more letters, digits, - and _",
            next_step="Leave it out and one is made up.",
        )
    return Door(host=str(address), token=token or secrets.token_urlsafe(24))


def rule(door: Door, port: int, path: str, headers: Mapping[str, str]) -> Ruling:
    """Whether a request may pass.

    Args:
        door: The rules.
        port: Where the page listens.
        path: The request's path, with its query.
        headers: The request's, by their names in lower case.
    """
    host = headers.get("host", "")
    origin = headers.get("origin")
    if origin is not None and _parts(origin).netloc != host:
        return Ruling(403, "a page of another site asked")
    if door.loopback and not _names_this_machine(host):
        return Ruling(403, "the address is not one of this machine")
    name = cookie_name(port)
    given = parse_qs(_parts(path).query).get("token", [""])[0]
    if _same(given, door.token):
        if headers.get("upgrade", "").lower() == "websocket":
            return Ruling(200)
        return Ruling(303, cookie=f"{name}={door.token}; HttpOnly; SameSite=Lax; Path=/")
    if _same(_cookie(headers.get("cookie", ""), name), door.token):
        return Ruling(200)
    return Ruling(403, "open the whole address that dynid studio printed, with its token")


def cookie_name(port: int) -> str:
    """The cookie of one page; cookies of all ports of a machine are shared."""
    return f"dynid_studio_{port}"


def _parts(address: str) -> SplitResult:
    try:
        return urlsplit(address)
    except ValueError:
        # Nonsense is nobody's address.
        return SplitResult("", "", "", "", "")


def _hard_to_guess(token: str) -> bool:
    allowed = all(c.isascii() and (c.isalnum() or c in "-_") for c in token)
    return allowed and len(token) >= SHORTEST_TOKEN


def _names_this_machine(host: str) -> bool:
    name = _parts(f"//{host}").hostname or ""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _cookie(text: str, name: str) -> str:
    try:
        found = SimpleCookie(text).get(name)
    except CookieError:
        return ""
    return "" if found is None else found.value


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


TITLE = "dynid studio"
DEFAULT_PORT = 8080
_THEIR_TITLE = b"<title>Viser</title>"
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' ws: data: blob:; frame-ancestors 'none'; object-src 'none'; "
    "base-uri 'none'; form-action 'none'"
)
"""viser's page is one packed inline script that writes another one, its libraries build functions
from text, and its widgets carry inline styles: it does not start without both `unsafe` words."""
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
            if "Accept-Encoding" in request.headers:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class StudioOptions:
    """How to serve the page."""

    path: str | None = None
    """A robot, a design, a recording or a directory; None for the current directory."""
    robot: str | None = None
    """The robot, where the files do not say or it has moved."""
    host: str = DEFAULT_HOST
    token: str | None = None
    """What visitors must know; None to make one up."""
    port: int | None = None
    """None for the usual one or the next free one, 0 for any."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Served:
    """Where the page is."""

    url: str
    """The address to open, token included."""
    host: str
    port: int
    robot: str
    local: bool
    """Whether this machine alone can reach it."""


def serve(options: StudioOptions, ready: Callable[[Served], None], stop: threading.Event) -> None:
    """Serve the page until `stop` is set; what still runs is stopped then.

    Args:
        options: What to show, and to whom.
        ready: Told where the page is as soon as it can be opened.
        stop: Ends it.

    Raises:
        InputError: Nothing to show, or an address that cannot be listened on.
        MissingExtraError: viser is not installed.
    """
    door = make_door(options.host, options.token)
    require("viser", "studio")
    # What is shown is read before anybody can come in.
    opened = open_path(options.path, robot=options.robot)
    from dynid.studio.page import Page
    from dynid.studio.session import Session

    session = Session(opened)
    notes = [f"{name}: {why}" for name, why in opened.skipped]
    meshes = robot_meshes(opened.robot, opened.reference, notes)
    server = open_server(door, options.port)
    try:
        page = Page(server, session, meshes, notes)
        port = server.get_port()
        ready(
            Served(
                url=door.url(port),
                host=door.host,
                port=port,
                robot=opened.robot.name,
                local=door.loopback,
            )
        )
        page.run(stop)
    finally:
        session.close()
        server.stop()
