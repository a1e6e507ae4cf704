"""``serve``: the page on this machine, until it is stopped."""

from __future__ import annotations

import errno
import socket
from typing import Any

from vibrident.errors import InputError
from vibrident.extras import library
from vibrident.web.session import MEGABYTE

USUAL_PORT = 8080
LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" rx="6" fill="#0a4b78"/>'
    '<path d="M3 18h5l3-9 5 15 4-11 2 5h7" fill="none" stroke="#fff" stroke-width="2.4"/></svg>'
)


def serve(*, host: str, port: int, show: bool, limit_mb: float, say: Any = print) -> None:
    """Serve the page until interrupted.

    Args:
        host: address to listen at; loopback is for this machine alone.
        port: 0 takes 8080 where it is free, else any that is.
        show: open the browser.
        limit_mb: most megabytes of one user's files.
        say: called with the address.

    Raises:
        InputError: NiceGUI is not installed, or the address cannot be used.
    """
    library("nicegui", "web", "The page needs NiceGUI, which is not installed.", "vibrident serve")
    from nicegui import ui

    chosen = _free_port(host, port)
    build(limit_mb, hosts=LOOPBACK if host in LOOPBACK else None)
    say(f"http://{f'[{host}]' if ':' in host else host}:{chosen}/")
    ui.run(
        host=host,
        port=chosen,
        title="vibrident",
        favicon=_ICON,
        show=show,
        reload=False,
        show_welcome_message=False,
        reconnect_timeout=30.0,
        dark=False,
        language="en-US",
    )


def build(limit_mb: float, *, hosts: frozenset[str] | None = LOOPBACK) -> None:
    """Register the page and its guard."""
    from nicegui import app, ui

    from vibrident.web.guard import Guard
    from vibrident.web.page import page

    app.add_middleware(Guard, limit_bytes=int(limit_mb * MEGABYTE), hosts=hosts)

    @ui.page("/", title="vibrident")
    def _page() -> None:
        page(limit_mb)


def _free_port(host: str, port: int) -> int:
    wanted = [port] if port else [USUAL_PORT, 0]
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for number in wanted:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host, number))
            except OSError as error:
                if error.errno == errno.EADDRINUSE and number != wanted[-1]:
                    continue
                raise InputError(
                    "The page cannot be served there.",
                    expected="an address of this machine and a port that is free",
                    found=f"{error.strerror or error}",
                    where=f"--host {host} --port {number}",
                    remedy="leave --port out, and a free one is taken"
                    if error.errno in (errno.EADDRINUSE, errno.EACCES)
                    else "leave --host out, and the page is for this machine alone",
                ) from error
            return probe.getsockname()[1]
    raise AssertionError("unreachable")
