"""`dynid studio`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from dynid.cli.options import JsonFlag, examples

if TYPE_CHECKING:
    from dynid.studio import Served


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "studio",
        epilog=examples(
            "dynid studio runs/demo",
            "dynid studio design.json",
            "dynid studio ur5e --port 8123",
            "dynid studio runs/demo --host 0.0.0.0",
        ),
    )(_studio)


def _studio(
    path: Annotated[
        str | None,
        typer.Argument(
            metavar="PATH", help="Directory, design, recording, or robot; default: here."
        ),
    ] = None,
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="If the files do not say or it has moved.")
    ] = None,
    host: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="Where to listen; a token guards all but 127.x."),
    ] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(metavar="PORT", min=0, max=65535, help="0 for any. [default: 8080 or next]"),
    ] = None,
    token: Annotated[
        str | None,
        typer.Option(metavar="TEXT", help="Visitors must know it; made up where one is needed."),
    ] = None,
    json: JsonFlag = False,
) -> None:
    """A local page: the arm in 3D, design, live run, results.

    It serves until Ctrl-C. With --json, one object on stdout tells when it can be opened.
    """
    from dynid.cli.output import print_json
    from dynid.experiment import stop_on_signals
    from dynid.studio import StudioOptions, serve

    options = StudioOptions(path=path, robot=robot, host=host, token=token, port=port)

    def ready(served: Served) -> None:
        if json:
            print_json(
                {
                    "url": served.url,
                    "host": served.host,
                    "port": served.port,
                    "robot": served.robot,
                    "local": served.local,
                }
            )
            sys.stdout.flush()
        print(f"dynid studio: open {served.url} - Ctrl-C ends it.", file=sys.stderr, flush=True)
        if not served.local:
            print(
                "dynid studio: warning: other machines can reach the page; what it sends is not "
                "encrypted, its token neither",
                file=sys.stderr,
                flush=True,
            )

    with stop_on_signals() as stop:
        serve(options, ready, stop)
