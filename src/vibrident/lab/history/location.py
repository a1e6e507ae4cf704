"""Location of the store: its URL, checked before a database library is loaded."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from urllib.parse import quote, unquote

from vibrident.base.errors import InputError

VARIABLE = "VIBRIDENT_STORE"
FORMS = (
    "sqlite:///FILE, a path that ends in .db, .sqlite or .sqlite3, or "
    "postgresql://USER@HOST/DATABASE"
)
_FILE_ENDINGS = (".db", ".sqlite", ".sqlite3")
#: Names of PostgreSQL's dialect; the driver below is used for all of them.
_POSTGRESQL = ("postgresql", "postgres", "postgresql+psycopg")
_DRIVER = "postgresql+psycopg"
#: User and password: all up to the last @, because a password that was not escaped may hold any
#: character.
_ACCOUNT = re.compile(r"(?<=://)(.*)@")
_SECRET_KEYS = re.compile(r"(?i)((?:^|[?&\s])(?:password|passfile|sslpassword)=)[^&\s]*")


def store_url(url: str | None) -> str:
    """Return the store's URL.

    It is the argument, else that of the environment, else a SQLite file in the user's data folder.

    Raises:
        InputError: the URL or path cannot be used for a store.
    """
    text = (url if url is not None else os.environ.get(VARIABLE, "")).strip()
    where = "⟦history.store⟧" if url is not None else f"environment, ⟦environment.{VARIABLE}⟧"
    if not text and url is None:
        return sqlite_url(data_folder() / "history.sqlite")
    scheme, separator, address = text.partition("://")
    if not separator:
        if Path(text).suffix.lower() in _FILE_ENDINGS:
            return sqlite_url(Path(text))
        raise _unusable("The store's URL cannot be read.", printable(text) or "nothing", where)
    if scheme in _POSTGRESQL:
        return f"{_DRIVER}://{address}"
    if scheme in ("sqlite", "sqlite+pysqlite"):
        if address in ("", "/", "/:memory:") or not address.startswith("/"):
            raise _unusable(
                "This URL names no file, and a store in memory would be lost at the end.",
                printable(text),
                where,
            )
        return text
    raise _unusable(
        "The store is of a kind that this package does not know.", f"{scheme}://…", where
    )


def sqlite_url(file: Path) -> str:
    """Return the URL of a SQLite file; characters with a meaning in URLs are escaped."""
    return f"sqlite:///{quote(file.absolute().as_posix(), safe='/:')}"


def sqlite_file(url: str) -> Path | None:
    """Return the file of a SQLite URL; None for another database."""
    scheme, _, address = url.partition("://")
    return Path(unquote(address.removeprefix("/"))) if scheme.startswith("sqlite") else None


def data_folder() -> Path:
    """Return the folder for the user's data by the convention of the operating system."""
    if sys.platform == "win32":
        return (
            Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "vibrident"
        )
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "vibrident"
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "vibrident"


def printable(url: str) -> str:
    """Return the URL without any password, for messages."""
    text = _ACCOUNT.sub(_without_password, url)
    return _SECRET_KEYS.sub(r"\1***", text)


def without_secrets(text: str, url: str) -> str:
    """Return a driver's message without the password of the URL, escaped or plain."""
    account = _ACCOUNT.search(url)
    secrets = [account.group(1).partition(":")[2]] if account else []
    secrets += [match.group(0).split("=", 1)[1] for match in _SECRET_KEYS.finditer(url)]
    for secret in {form for written in secrets if written for form in (written, unquote(written))}:
        text = text.replace(secret, "***")
    return text


def _without_password(match: re.Match[str]) -> str:
    user, colon, _ = match.group(1).partition(":")
    return f"{user}{':***' if colon else ''}@"


def _unusable(problem: str, value: str, where: str) -> InputError:
    return InputError(
        problem, expected=FORMS, found=value, where=where, remedy="use one of these forms"
    )
