"""Serve the page on this machine until it is stopped."""

from __future__ import annotations

import errno
import ipaddress
import os
import socket
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from vibrident.app.web.authentication import Authenticator, build_authenticator
from vibrident.app.web.confinement import can_confine
from vibrident.app.web.home import ServerFolder
from vibrident.app.web.session import MEGABYTE
from vibrident.app.workflow.accounts import LOOPBACK
from vibrident.base.errors import InputError
from vibrident.lab.history.location import data_folder

USUAL_PORT = 8080
# seconds without a connection after which the browser rebuilds the page; its state is kept longer
_RECONNECT_S = 30.0
#: Addresses for documentation (RFC 5737, RFC 3849): nothing is sent there; they only reveal this
#: machine's own address.
_ANYWHERE = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}
_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" '
    'rx="6" fill="#0a4b78"/>'
    '<path d="M3 18h5l3-9 5 15 4-11 2 5h7" fill="none" stroke="#fff" stroke-width="2.4"/></svg>'
)


def serve(
    *,
    host: str,
    port: int,
    show: bool,
    limit_mb: float,
    names: Sequence[str] = (),
    store: str | None = None,
    keep_h: float = 24.0,
    auth: Path | None = None,
    proxy: str | None = None,
    user_header: str | None = None,
    audit: Path | None = None,
    key: tuple[Path, str] | None = None,
    show_address: Callable[[str], None] = print,
    note: Callable[[str], None] = print,
) -> None:
    """Serve the page until interrupted, with the options of ``vibrident serve``.

    ``show``: open the browser; ``names``: further host names of the page; ``store``: URL of the
    history that everybody who reaches the page may read and add to; ``key``: file and pass phrase
    of the key that signs; ``show_address`` is called with the address, ``note`` with remarks
    before it.
    """
    from nicegui import ui

    free_port = _free_port(host, port)
    keep_s = 3600.0 * keep_h
    loopback = host in LOOPBACK
    # refused before anything is made
    build_authenticator(auth, proxy, user_header, None, Path(), loopback=loopback)
    home = ServerFolder(data_folder() / "page" if keep_s else None, f"{host}-{free_port}", keep_s)
    door = build_authenticator(
        auth,
        proxy,
        user_header,
        audit or data_folder() / "audit.jsonl",
        home.folder,
        loopback=loopback,
    )
    os.environ["TMPDIR"] = tempfile.tempdir = str(home.spool)  # partial uploads lie there too
    try:
        host_names = page_names(host) | frozenset(names)
        build(limit_mb, home, names=host_names, store=store, keep_s=keep_s, door=door, key=key)
        if door is not None and not can_confine():
            note(
                "Readers of files are not confined: bubblewrap is missing here or not allowed "
                "(docs/security.md)."
            )
        show_address(f"http://{_bracketed(reachable_address(host))}:{free_port}/")
        ui.run(
            host=host,
            port=free_port,
            title="vibrident",
            favicon=_ICON,
            show=show,
            reload=False,
            show_welcome_message=False,
            reconnect_timeout=_RECONNECT_S,
            dark=None,  # as the system is
            language="en-US",
            gzip_middleware_factory=None,  # compressing takes longer than sending, and
            ws_per_message_deflate=False,  # delays all users
            proxy_headers=False,  # else uvicorn believes what any neighbour says of its address
        )
    finally:
        home.close()


def build(
    limit_mb: float,
    home: ServerFolder,
    *,
    names: frozenset[str],
    store: str | None,
    keep_s: float,
    door: Authenticator | None,
    key: tuple[Path, str] | None = None,
) -> None:
    """Register the page and its guard."""
    from nicegui import app, ui

    from vibrident.app.web.guard import Guard
    from vibrident.app.web.page import page
    from vibrident.app.web.users import Users

    users = Users(
        home.folder, limit_mb, store, keep_s, door, key, laboratories=data_folder() / "laboratories"
    )
    app.add_middleware(Guard, limit_bytes=int(limit_mb * MEGABYTE), names=names, door=door)
    app.on_startup(users.start)
    app.on_shutdown(users.close)
    app.on_shutdown(home.close)  # a signal ends the process before ``serve`` returns

    @ui.page("/", title="vibrident", markdown=False)
    async def _page() -> None:
        await page(users)


def page_names(host: str) -> frozenset[str]:
    """Return the host names of a page at this address.

    Addresses of this machine are known from the request.
    """
    if host in LOOPBACK:
        return LOOPBACK
    hostname = socket.gethostname().lower()
    return LOOPBACK | {host, hostname, f"{hostname}.local"} - {"", ".local"}


def reachable_address(host: str) -> str:
    """Return an address for the browser, which can use neither 0.0.0.0 nor ::."""
    try:
        if not ipaddress.ip_address(host).is_unspecified:
            return host
    except ValueError:
        return host
    family = _family(host)
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((_ANYWHERE[family], 9))
            return probe.getsockname()[0]
        except OSError:  # no network
            return "::1" if family == socket.AF_INET6 else "127.0.0.1"


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def _free_port(host: str, port: int) -> int:
    ports = [port] if port else [USUAL_PORT, 0]
    for number in ports:
        with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host, number))
            except OSError as error:
                if error.errno == errno.EADDRINUSE and number != ports[-1]:
                    continue
                raise InputError(
                    "The page cannot be served there.",
                    expected="an address of this machine and a port that is free",
                    found=f"{error.strerror or error}",
                    where=f"⟦serve.host = {host!r}⟧ ⟦serve.port = {number}⟧",
                    remedy="leave ⟦serve.port⟧ out to use a free one"
                    if error.errno in (errno.EADDRINUSE, errno.EACCES)
                    else "leave ⟦serve.host⟧ out to serve this machine alone",
                ) from error
            return probe.getsockname()[1]
    raise AssertionError("unreachable")
