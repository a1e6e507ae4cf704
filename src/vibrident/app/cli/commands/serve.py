"""``vibrident serve``: the page in the browser."""

from __future__ import annotations

import typer

from vibrident.app.cli.console import note, out
from vibrident.app.cli.options import between, flag, option
from vibrident.app.workflow.choices import LOOPBACK
from vibrident.base.errors import InputError
from vibrident.base.extras import require

_STORE = "on loopback VIBRIDENT_STORE, else a file in the user's data folder; none otherwise"


def serve(
    context: typer.Context,
    host: str = option(
        "--host", "ADDRESS", "Where to listen; other addresses than loopback open it to others.", "127.0.0.1"
    ),
    port: int = between("--port", "N", "Port.", 0, 65535, 0, "8080, or one that is free"),
    no_browser: bool = flag("--no-browser", help="Open no browser."),
    limit_mb: float = between("--limit-mb", "MB", "Most megabytes of one user's files.", 1, 1e6, 100.0),
    keep: float = between("--keep", "HOURS", "How long the work of who left is kept on disk; 0: not.", 0, 8760, 24.0),
    name: list[str] | None = option("--name", "NAME", "A further host name of the page; may be repeated."),
    store: str | None = option(
        "--store", "URL", "History to show and add to; see `vibrident history`.", default=_STORE
    ),
) -> None:
    """Open a page in the browser: drop files, confirm columns, identify, view, download. Ctrl-C ends it.

    Data stay on this machine; each open page has files of its own. A page that is left is there again for a day.
    """
    require("nicegui", "web", "The page needs NiceGUI, which is not installed.", "vibrident serve")
    from vibrident.lab.history.location import chosen

    if context.obj is None:
        raise InputError(
            "This program has no page.",
            expected="the program vibrident, or python -m vibrident",
            found="another one, with the same commands",
            remedy="start vibrident serve",
        )
    if host not in LOOPBACK:
        note(f"Warning: everybody who reaches {host} can use this page, without a password or encryption.")

    def say(address: str) -> None:
        out().print(f"vibrident is at {address}  (Ctrl-C ends it)")

    own = chosen(store) if store is not None or host in LOOPBACK else None  # others have no business in one's own
    context.obj(
        host=host, port=port, show=not no_browser, limit_mb=limit_mb, names=name or (), store=own, keep_h=keep, say=say
    )
