"""The page's server: files of the page, its facts, what it asks for, and news as they come."""

from __future__ import annotations

import json
import os
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, cast
from urllib.parse import parse_qs, unquote

from dynid.core import DynidError, InputError, JsonFields, parse_json
from dynid.studio.door import DEFAULT_HOST, Door, make_door, rule
from dynid.studio.opening import open_path
from dynid.studio.page import Page

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
_NICE = 10


class Server(ThreadingHTTPServer):
    """One page behind its door.

    Args:
        door: Who may come in.
        port: Where to listen; None for the usual port or the next free one, 0 for any.
        page: What is served.

    Raises:
        InputError: The address or port cannot be listened on.
    """

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, door: Door, port: int | None, page: Page) -> None:
        self.address_family = socket.AF_INET6 if ":" in door.host else socket.AF_INET
        self.door, self.page = door, page
        self.closing = threading.Event()
        first = DEFAULT_PORT if port is None else port
        failure: Exception | None = None
        for candidate in range(first, first + (51 if port is None else 1)):
            try:
                super().__init__((door.host, candidate), _Visit)
                return
            except (OSError, OverflowError) as error:
                failure = error
        raise InputError(
            f"cannot listen there: {getattr(failure, 'strerror', None) or failure}",
            where="--host, --port",
            value=f"{door.host}:{first}",
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
        # of its own; jobs are started by threads that answer POST.
        if hasattr(os, "setpriority"):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
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
        ruling = rule(self._site.door, self._site.port, self.path, headers)
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
            found, status = {"error": str(error) or type(error).__name__}, 400
        self._send(status, _encoded(found), "application/json")

    def _refuse(self, status: int, words: str) -> None:
        self._send(status, _encoded({"error": words}), "application/json")

    def _tell_news(self) -> None:
        self._head(200, "text/event-stream", {})
        page, seen = self._site.page, -1
        while not self._site.closing.is_set():
            told, seen = page.news(seen, _HEARTBEAT_S)
            # A comment, so that a page that is gone is noticed.
            self.wfile.write(f"data: {told}\n\n".encode() if told else b":\n\n")
            self.wfile.flush()

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
    """
    door = make_door(options.host, options.token)
    # What is shown is read before anybody can come in.
    page = Page(open_path(options.path, robot=options.robot))
    server = Server(door, options.port, page)
    server.start()
    try:
        ready(
            Served(
                url=door.url(server.port),
                host=door.host,
                port=server.port,
                robot=page.session.robot.name,
                local=door.loopback,
            )
        )
        page.run(stop)
    finally:
        page.close()
        server.stop()
