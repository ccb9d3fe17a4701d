"""The page's server: files of the page, its facts, what it asks for, and news as they come.

Whoever knows the token may come in, on this machine too.

A page in a browser may talk to any address of this machine, and this page can move a robot. So
requests that another site's page sends are refused: its `Origin` is not ours, and a name that
was made to point here is not one of this machine's.
"""

import hmac
import ipaddress
import json
import os
import re
import secrets
import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, cast
from urllib.parse import SplitResult, parse_qs, unquote, urlsplit

from dynid.core import DynidError, InputError, JsonFields, parse_json
from dynid.studio.page import Page
from dynid.studio.session import open_path

DEFAULT_HOST = "127.0.0.1"
SHORTEST_TOKEN = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class AccessPolicy:
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
        """The address to open, token included; where all are listened on, by the machine's name."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        if ipaddress.ip_address(self.host).is_unspecified:
            host = socket.gethostname()
        return f"http://{host}:{port}/?token={self.token}"


@dataclass(frozen=True, slots=True)
class Ruling:
    """What becomes of a request."""

    status: int
    """200 to go on, 303 to go on with the cookie that was set, 403 to refuse."""
    reason: str = ""
    cookie: str | None = None
    """Value of `Set-Cookie`."""


def access_policy(host: str, token: str | None) -> AccessPolicy:
    """The rules for an address (`localhost` is 127.0.0.1) and a token; None to make one up.

    Raises:
        InputError: No address, or a token that is too short or does not fit into one.
    """
    try:
        address = ipaddress.ip_address(DEFAULT_HOST if host == "localhost" else host)
    except ValueError as error:
        raise InputError(
            "this is no address", where="--host", value=host, limit="such as 127.0.0.1 or 0.0.0.0"
        ) from error
    if token is not None and not re.fullmatch(f"[A-Za-z0-9_-]{{{SHORTEST_TOKEN},}}", token):
        raise InputError(
            "the token can be guessed, or cannot stand in an address",
            where="--token",
            limit=f"{SHORTEST_TOKEN} or more letters, digits, - and _",
            next_step="Leave it out, and one is generated.",
        )
    return AccessPolicy(host=str(address), token=token or secrets.token_urlsafe(24))


def rule(policy: AccessPolicy, port: int, path: str, headers: Mapping[str, str]) -> Ruling:
    """Whether a request to a port may pass: its path with the query, its headers in lower case."""
    host = headers.get("host", "")
    origin = headers.get("origin")
    if origin is not None and _parts(origin).netloc != host:
        return Ruling(403, "a page of another site asked")
    if policy.loopback and not _names_this_machine(host):
        return Ruling(403, "the address is not one of this machine")
    name = cookie_name(port)
    given = parse_qs(_parts(path).query).get("token", [""])[0]
    if _same(given, policy.token):
        return Ruling(303, cookie=f"{name}={policy.token}; HttpOnly; SameSite=Lax; Path=/")
    if _same(_cookie(headers.get("cookie", ""), name), policy.token):
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


def _names_this_machine(host: str) -> bool:
    name = _parts(f"//{host}").hostname or ""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _cookie(text: str, name: str) -> str:
    # By hand: one odd cookie of another program on this machine makes http.cookies read none.
    for part in text.split(";"):
        key, _, value = part.strip().partition("=")
        if key == name:
            return value
    return ""


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


DEFAULT_PORT = 8080
MAX_ASKED = 1 << 20
"""Longest body of what the page asks for [bytes]."""
MAX_DROPPED = 1 << 30
"""Largest file that can be dropped onto the page [bytes]."""
ASSETS = {
    "/": ("index.html", "text/html"),
    "/studio.css": ("studio.css", "text/css"),
    "/studio.js": ("studio.js", "text/javascript"),
    "/panels.js": ("panels.js", "text/javascript"),
    "/view.js": ("view.js", "text/javascript"),
    "/plots.js": ("plots.js", "text/javascript"),
}
"""All files of the page."""
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_PATIENCE_S = 30.0
"""How long a visitor may say nothing within a request."""
_HEARTBEAT_S = 5.0
MOST_STREAMS = 4
"""News that last. A browser opens six connections to a server, for all its tabs: STOP needs one."""
_RETRY_MS = 1000
"""When the others ask again."""
_NICE = 10


class Server(ThreadingHTTPServer):
    """One page and its access policy.

    Args:
        policy: Who has access.
        port: Where to listen; None for the usual port or the next free one, 0 for any.
        page: What is served.

    Raises:
        InputError: The address or port cannot be listened on.
    """

    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 128

    def __init__(self, policy: AccessPolicy, port: int | None, page: Page) -> None:
        self.address_family = socket.AF_INET6 if ":" in policy.host else socket.AF_INET
        self.policy, self.page = policy, page
        self.closing = threading.Event()
        self.streams = threading.Semaphore(MOST_STREAMS)
        first = DEFAULT_PORT if port is None else port
        failure: Exception | None = None
        for candidate in range(first, first + (51 if port is None else 1)):
            try:
                super().__init__((policy.host, candidate), _Visit)
                return
            except (OSError, OverflowError) as error:
                failure = error
        raise InputError(
            f"cannot listen there: {getattr(failure, 'strerror', None) or failure}",
            where="--host, --port",
            value=f"{policy.host}:{first}",
        ) from failure

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.server_address[1])

    def start(self) -> None:
        """Answer visitors, in threads of their own, until `stop`."""
        threading.Thread(target=self.serve_forever, args=(0.1,), daemon=True).start()

    def stop(self) -> None:
        """Answer nobody any more."""
        self.closing.set()
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A visitor who has gone in the middle of an answer is no error."""


class _Visit(BaseHTTPRequestHandler):
    """One request; connections are not kept, so that each thread has one task and priority."""

    timeout = _PATIENCE_S
    server_version, sys_version = "dynid", ""

    def do_GET(self) -> None:
        """Answer with a file of the page, with facts, or with news for as long as they last."""
        if not self._may_enter():
            return
        # A recording needs the machine more than the page does. On Linux a thread has a priority
        # of its own; jobs are started by threads that answer POST. Added to that of the studio,
        # which may be lower still: to raise it takes rights.
        os.nice(_NICE)
        path = self._path
        if path in ASSETS:
            name, kind = ASSETS[path]
            self._send(200, (files("dynid.studio") / "assets" / name).read_bytes(), kind)
        elif path == "/news":
            self._tell_news()
        elif path.startswith("/api/"):
            self._answer(lambda: self._site.page.look_up(path[5:], self._query))
        else:
            self._refuse(404, "there is nothing here")

    def do_POST(self) -> None:
        """Do what the page asks for, or take a file."""
        if not self._may_enter():
            return
        page, path = self._site.page, self._path
        length = self.headers.get("Content-Length", "")
        most = MAX_DROPPED if path == "/drop" else MAX_ASKED
        if not length.isdecimal() or int(length) > most:
            self._refuse(413, f"a length is needed, and {most} bytes at most")
        elif path == "/drop":
            self._answer(lambda: page.take_file(self._query("name"), self.rfile, int(length)))
        elif path.startswith("/do/"):
            body = self.rfile.read(int(length))
            self._answer(lambda: page.do(path[4:], _fields(body)))
        else:
            self._refuse(404, "there is nothing here")

    def _others(self) -> None:
        if self._may_enter():
            self._refuse(405, "only GET and POST are answered")

    do_HEAD = do_PUT = do_DELETE = do_OPTIONS = do_PATCH = do_TRACE = _others

    @property
    def _site(self) -> Server:
        return cast("Server", self.server)

    @property
    def _path(self) -> str:
        return unquote(self.path.split("?", 1)[0])

    def _query(self, name: str) -> str:
        return parse_qs(self.path.partition("?")[2]).get(name, [""])[0]

    def _may_enter(self) -> bool:
        headers = {name.lower(): value for name, value in self.headers.items()}
        ruling = rule(self._site.policy, self._site.port, self.path, headers)
        if ruling.status == HTTPStatus.OK:
            return True
        more: dict[str, str] = {}
        if ruling.cookie is not None:
            more = {"Set-Cookie": ruling.cookie, "Location": "/"}
        self._send(ruling.status, f"dynid studio: {ruling.reason}\n".encode(), "text/plain", more)
        return False

    def _answer(self, answer: Callable[[], dict[str, Any]]) -> None:
        try:
            found, status = answer(), 200
        except (DynidError, OSError, ValueError, RecursionError, MemoryError) as error:
            said = error.line if isinstance(error, DynidError) else str(error)
            found, status = {"error": said or type(error).__name__}, 400
        except Exception as error:
            said = f"internal error, a bug in dynid: {type(error).__name__}: {error}"
            found, status = {"error": f"{said}. Report it"}, 500
        self._send(status, _encoded(found), "application/json")

    def _refuse(self, status: int, words: str) -> None:
        self._send(status, _encoded({"error": words}), "application/json")

    def _tell_news(self) -> None:
        self._head(200, "text/event-stream", {})
        site, seen, lasts = self._site, -1, self._site.streams.acquire(blocking=False)
        try:
            while not site.closing.is_set():
                told, seen = site.page.news(seen, _HEARTBEAT_S)
                # A comment, so that a page that is gone is noticed.
                news = f"retry: {_RETRY_MS}\n" + (f"data: {told}\n\n" if told else ":\n\n")
                self.wfile.write(news.encode())
                self.wfile.flush()
                if not lasts:
                    return
        finally:
            if lasts:
                site.streams.release()

    def _send(
        self, status: int, body: bytes, kind: str, more: dict[str, str] | None = None
    ) -> None:
        self._head(status, kind, {"Content-Length": str(len(body)), **(more or {})})
        if self.command != "HEAD":
            self.wfile.write(body)

    def _head(self, status: int, kind: str, more: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in {**_HEADERS, "Content-Type": f"{kind}; charset=utf-8", **more}.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the terminal is not the page's."""


def _fields(body: bytes) -> JsonFields:
    value: object = parse_json(body.decode("utf-8")) if body else {}
    if not isinstance(value, dict):
        raise InputError("an object is needed")
    return JsonFields(cast("dict[str, Any]", value))


def _encoded(value: dict[str, Any]) -> bytes:
    # Half characters, as file names may hold, cannot be encoded: they are escaped.
    return json.dumps(value, allow_nan=False).encode("ascii")


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


def serve(
    path: str | None,
    ready: Callable[[Served], None],
    stop: threading.Event,
    *,
    robot: str | None = None,
    host: str = DEFAULT_HOST,
    token: str | None = None,
    port: int | None = None,
) -> None:
    """Serve the page until `stop` is set; what still runs is stopped then.

    Args:
        path: A robot, a design, a recording or a directory; None for the current directory.
        ready: Told where the page is as soon as it can be opened.
        stop: Ends it.
        robot: The robot, where the files do not say or it has moved.
        host: Address to listen on.
        token: What visitors must know; None to make one up.
        port: None for the usual one or the next free one, 0 for any.

    Raises:
        InputError: Nothing to show, or an address that cannot be listened on.
    """
    policy = access_policy(host, token)
    # What is shown is read before anybody can come in.
    page = Page(open_path(path, robot=robot))
    server = Server(policy, port, page)
    server.start()
    try:
        ready(
            Served(
                url=policy.url(server.port),
                host=policy.host,
                port=server.port,
                robot=page.session.robot.name,
                local=policy.loopback,
            )
        )
        page.run(stop)
    finally:
        page.close()
        server.stop()
