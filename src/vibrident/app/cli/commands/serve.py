"""``vibrident serve``: the page in the browser."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import typer

from vibrident.app.cli.console import note, output_console
from vibrident.app.cli.options import between, flag, option
from vibrident.app.workflow.accounts import LOOPBACK
from vibrident.base.errors import InputError
from vibrident.base.extras import require

_STORE = "on loopback VIBRIDENT_STORE, else a file in the user's data folder; none otherwise"


def serve(
    context: typer.Context,
    host: str = option(
        "--host",
        "ADDRESS",
        "Where to listen; other addresses than loopback open it to others.",
        "127.0.0.1",
    ),
    port: int = between("--port", "N", "Port.", 0, 65535, 0, "8080, or one that is free"),
    no_browser: bool = flag("--no-browser", help="Open no browser."),
    limit_mb: float = between(
        "--limit-mb", "MB", "Most megabytes of one user's files.", 1, 1e6, 100.0
    ),
    keep: float = between(
        "--keep",
        "HOURS",
        "Hours for which the work of users who left stays on disk; 0 keeps none.",
        0,
        8760,
        24.0,
    ),
    name: list[str] | None = option(
        "--name", "NAME", "A further host name of the page; may be repeated."
    ),
    auth: Path | None = option(
        "--auth", "FILE", "Accounts of a team: who may sign in, and with which role."
    ),
    add: str | None = option(
        "--add", "NAME:ROLE", "Write an account to FILE; roles: look, identify, approve."
    ),
    proxy: str | None = option("--proxy", "ADDRESS", "Address of the proxy before the page."),
    user_header: str | None = option(
        "--user-header", "NAME", "Header in which the proxy says who signed in there."
    ),
    audit: Path | None = option(
        "--audit", "FILE", "Who did what.", default="audit.jsonl in the data folder"
    ),
    store: str | None = option(
        "--store", "URL", "History to show and add to; see `vibrident history`.", default=_STORE
    ),
    key: Path | None = option(
        "--key", "KEY.p12", "The laboratory's key: reviewed certificates are signed with it."
    ),
    passphrase_file: Path | None = option(
        "--passphrase-file", "FILE", "Pass phrase of the key.", default="VIBRIDENT_KEY_PASSPHRASE"
    ),
) -> None:
    """Open a page in the browser: drop files, confirm columns, identify, view, download. \
Ctrl-C ends it.

    Data stay on this machine; each open page has files of its own. A page that is left is there
    again for a day.
    """
    require("nicegui", "web", "The page needs NiceGUI, which is not installed.", "vibrident serve")
    from vibrident.lab.history.location import store_url

    if context.obj is None:
        raise InputError(
            "This program has no page.",
            expected="the program vibrident, or python -m vibrident",
            found="another one, with the same commands",
            remedy="start vibrident serve",
        )
    if auth is not None:
        require(
            "argon2",
            "web",
            "Accounts need argon2-cffi, which is not installed.",
            "vibrident serve --auth",
        )
    if add is not None:
        _add(auth, add)
        return
    if host not in LOOPBACK and proxy is None and auth is not None:
        note(
            f"Warning: no encryption: whoever listens between a browser and {host} reads along. "
            "Use a proxy with TLS."
        )

    def show_address(address: str) -> None:
        output_console().print(f"vibrident is at {address}  (Ctrl-C ends it)")

    # the user's own history is for pages on this machine alone
    history_url = store_url(store) if store is not None or host in LOOPBACK else None
    context.obj(
        host=host,
        port=port,
        show=not no_browser,
        limit_mb=limit_mb,
        names=name or (),
        store=history_url,
        keep_h=keep,
        auth=auth,
        proxy=proxy,
        user_header=user_header,
        audit=audit,
        key=_key(key, passphrase_file, auth or user_header),
        show_address=show_address,
        note=note,
    )


def _key(
    key: Path | None, passphrase_file: Path | None, accounts: object
) -> tuple[Path, str] | None:
    """Return the file and the pass phrase of the key.

    This process then keeps the pass phrase out of the environment of its children.

    Raises:
        InputError: the key cannot be used, or the page has no accounts, of which it takes two.
    """
    if key is None:
        return None
    if accounts is None:
        raise InputError(
            "A page without accounts issues no certificates.",
            expected="accounts: one hands a draft in, another reviews it",
            found="--key without --auth or --user-header",
            where="command line",
            remedy="give --auth FILE, or issue with `vibrident issue`",
        )
    from vibrident.lab.issue.keys import PASSPHRASE, load_key, passphrase

    phrase = passphrase(passphrase_file)
    os.environ.pop(PASSPHRASE, None)
    load_key(key, phrase)
    return key.absolute(), phrase


def _add(auth: Path | None, account: str) -> None:
    from vibrident.app.workflow.accounts import add_account

    if auth is None:
        raise InputError(
            "There is no file for the account.",
            expected="--auth FILE with --add",
            found="none",
            where="command line",
            remedy="name the file of accounts; it is made if there is none",
        )
    name, _, role = account.partition(":")
    interactive = sys.stdin.isatty()
    password = typer.prompt(
        f"Password of {name}", hide_input=interactive, confirmation_prompt=interactive
    )
    add_account(auth, name, role, password)
    note(f"{name} may {role} now.")
