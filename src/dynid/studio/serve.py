"""`dynid studio`: open what a path holds and serve the page until it is told to stop."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from dynid.core.optional import require
from dynid.studio.door import DEFAULT_HOST, make_door
from dynid.studio.opening import open_path
from dynid.studio.visuals import robot_meshes


@dataclass(frozen=True, slots=True, kw_only=True)
class StudioOptions:
    """How to serve the page."""

    path: str | None = None
    """A robot, a design, a recording or a directory; None for the current directory."""
    robot: str | None = None
    """The robot, where the files do not say or it has moved."""
    host: str = DEFAULT_HOST
    token: str | None = None
    """What visitors must know; None to make one up where other machines can come."""
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
    from dynid.studio.server import open_server
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
