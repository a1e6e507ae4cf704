"""``vibrident serve``: the page in the browser."""

from __future__ import annotations

from typing import Annotated

import typer

from vibrident.cli.console import note, out
from vibrident.workflow.choices import LOOPBACK


def serve(
    host: Annotated[
        str,
        typer.Option(
            "--host", metavar="ADDRESS", help="Where to listen; other addresses than loopback open it to others."
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option("--port", metavar="N", help="Port.", show_default="8080, or one that is free"),
    ] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Open no browser.")] = False,
    limit_mb: Annotated[
        float, typer.Option("--limit-mb", metavar="MB", help="Most megabytes of one user's files.")
    ] = 100.0,
    name: Annotated[
        list[str] | None,
        typer.Option("--name", metavar="NAME", help="A further host name of the page; may be repeated."),
    ] = None,
    store: Annotated[
        str | None,
        typer.Option(
            "--store",
            metavar="URL",
            help="History to show and add to; see `vibrident history`.",
            show_default="on loopback VIBRIDENT_STORE, else a file in the user's data folder; none otherwise",
        ),
    ] = None,
) -> None:
    """Open a page in the browser: drop files, confirm columns, identify, view, download. Ctrl-C ends it.

    Data stay on this machine; each open page has files of its own, which are removed an hour after it was closed.
    """
    from vibrident.history.location import chosen
    from vibrident.workflow.page import serve as run

    if host not in LOOPBACK:
        note(f"Warning: everybody who reaches {host} can use this page, without a password or encryption.")

    def say(address: str) -> None:
        out().print(f"vibrident is at {address}  (Ctrl-C ends it)")

    own = chosen(store) if store is not None or host in LOOPBACK else None  # others have no business in one's own
    run(host=host, port=port, show=not no_browser, limit_mb=limit_mb, names=name or (), store=own, say=say)
