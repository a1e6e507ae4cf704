"""Open a store: connections, transactions, the version of its schema, and its errors."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event, exc
from sqlalchemy.dialects import postgresql, sqlite

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields
from vibrident.lab.history import schema
from vibrident.lab.history.location import FORMS, printable, sqlite_file, store_url, without_secrets

PATIENCE_S = 60  # how long a writer waits for another one
_SCHEMA_LOCK = 8_247_163_905  # number of PostgreSQL's advisory lock for changes of the schema
#: Texts in a database's error → the problem and its remedy; the last entry fits every error.
_CAUSES = (
    (("append-only",), "Rows of the history cannot be changed.", "add an event"),
    (
        ("locked", "lock timeout", "deadlock"),
        "The store is held by another program.",
        "try again later",
    ),
    (
        ("readonly", "read-only", "permission denied"),
        "The store can only be read.",
        "take an account that may write there, for a file in its folder too",
    ),
    (
        ("",),
        "The store cannot be used.",
        "check that the database runs, the address, and the account",
    ),
)


class Store:
    """A history in a SQL database; closes with the ``with`` block.

    Args:
        url: SQLAlchemy URL or path of a SQLite file; None for the default.

    Raises:
        InputError: the URL names no store, or its driver is not installed.
    """

    def __init__(self, url: str | None = None) -> None:
        self.url: str = store_url(url)
        self._file = sqlite_file(self.url)  # None for another database
        self._engine = self._create_engine()
        if self._file:
            event.listen(self._engine, "connect", _prepare_sqlite)
            event.listen(self._engine, "do_connect", _read_only)
            event.listen(self._engine, "begin", _begin_sqlite)
        self._checked = False

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections to the database."""
        self._engine.dispose()

    def _create_engine(self) -> sa.Engine:
        try:
            if self._file:  # as a path: releases of SQLAlchemy differ in how they unescape a URL
                url = sa.URL.create("sqlite", database=str(self._file))
                return sa.create_engine(url, connect_args={"timeout": PATIENCE_S})
            options = {"connect_timeout": 10, "options": f"-c lock_timeout={PATIENCE_S}s"}
            return sa.create_engine(self.url, connect_args=options)
        except ModuleNotFoundError as error:
            raise self._failed(
                "The driver of the store's database is not installed.",
                error,
                "⟦install = vibrident[postgres]⟧",
            ) from None
        except (exc.ArgumentError, ValueError) as error:
            raise self._failed(
                "The store's URL cannot be read.", error, "escape special characters as %40"
            ) from None

    @property
    def printed(self) -> str:
        """Return the store for print: the path of a file, else the URL without a password."""
        return str(self._file) if self._file else printable(self.url)

    @contextlib.contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """Open a connection that reads one consistent state of the store.

        Raises:
            InputError: there is no store, its schema is another version's, or the database fails.
        """
        with self._connected() as connection:
            self._require_revision(connection)
            yield connection

    @contextlib.contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """Open a connection whose changes are all committed at the end, or all rolled back.

        Raises:
            InputError: there is no store, its schema is another version's, or the database fails.
        """
        with self._connected(writes=True) as connection, connection.begin():
            self._require_revision(connection)
            yield connection

    @contextlib.contextmanager
    def _connected(self, **options: Any) -> Iterator[sa.Connection]:
        """Open a connection with execution options to an existing store."""
        with self._explained():
            if self._file and not self._file.exists():
                raise self._absent()
            with self._engine.connect().execution_options(**options) as connection:
                yield connection

    def insert(self, table: sa.Table) -> Any:
        """Return an INSERT in this database's dialect, with a clause for existing rows."""
        return sqlite.insert(table) if self._file else postgresql.insert(table)

    def revision(self) -> str | None:
        """Return the migration that the store is at; None if there is no store."""
        with self._explained():
            if self._file and not self._file.exists():
                return None
            with self._engine.connect() as connection:
                return _revision(connection)

    def upgrade(self, revision: str = schema.REVISION) -> tuple[str | None, str]:
        """Bring the schema to a revision, with its data; return the revision before and after.

        Raises:
            InputError: the store is newer than this version of vibrident, or the database fails.
        """
        with self._explained():
            if self._file:
                try:
                    self._file.parent.mkdir(parents=True, exist_ok=True)
                except OSError as error:
                    remedy = "check the path and your rights to it"
                    raise self._failed("The store cannot be used.", error, remedy) from None
            with (
                self._engine.connect().execution_options(writes=True) as connection,
                connection.begin(),
            ):
                if not self._file:  # SQLite's transaction for writing is such a lock
                    connection.execute(
                        sa.text("SELECT pg_advisory_xact_lock(:key)"), {"key": _SCHEMA_LOCK}
                    )
                before = _revision(connection)
                if before is not None and before > schema.REVISION:
                    raise self._other_version(before)
                if before is None or before < revision:
                    _migrate(connection, revision)
                return before, _revision(connection) or ""

    def begin(self) -> None:
        """Create the tables of a new store; an existing one stays unchanged.

        Raises:
            InputError: the database fails.
        """
        if self.revision() is None:
            self.upgrade()

    def _require_revision(self, connection: sa.Connection) -> None:
        if self._checked:
            return
        revision = _revision(connection)
        if revision is None:
            raise self._absent()
        if revision != schema.REVISION:
            raise self._other_version(revision)
        self._checked = True

    def _absent(self) -> InputError:
        return InputError(
            "There is no history here yet.",
            expected="a store that ⟦command = history add⟧ began",
            found="none",
            where=self.printed,
            remedy="check ⟦history.store⟧, or add a result: ⟦command = history add result.json⟧",
        )

    def _other_version(self, revision: str) -> InputError:
        age = "an older"
        remedy = "⟦command = history upgrade⟧; keep a copy of the store before"
        if revision > schema.REVISION:
            age = "a newer"
            remedy = "install the newer version"
        return InputError(
            f"The store was laid out by {age} version of vibrident.",
            expected=f"schema {schema.REVISION}",
            found=f"schema {revision}",
            where=self.printed,
            remedy=remedy,
        )

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn an error of the database or its driver into a message for the user."""
        try:
            yield
        except exc.DataError as error:
            raise self._failed(
                "A text cannot be kept in this database.", error.orig, "shorten or correct it"
            ) from None
        except exc.DBAPIError as error:
            text = str(error.orig).lower()
            problem, remedy = next(
                advice for texts, *advice in _CAUSES if any(symptom in text for symptom in texts)
            )
            raise self._failed(problem, error.orig, remedy) from None

    def _failed(self, problem: str, error: object, remedy: str) -> InputError:
        detail = " ".join(without_secrets(str(error), self.url).split())[:300]
        return InputError(problem, expected=FORMS, found=detail, where=self.printed, remedy=remedy)


def _read_only(_: Any, __: Any, arguments: list[Any], options: Fields) -> None:
    """Open a file read-only that this account cannot write: SQLite would create files beside it."""
    file = Path(arguments[0])
    if file.exists() and not (os.access(file, os.W_OK) and os.access(file.parent, os.W_OK)):
        has_writers = file.with_name(f"{file.name}-wal").exists()
        immutable = "" if has_writers else "&immutable=1"
        arguments[0] = f"{file.absolute().as_uri()}?mode=ro{immutable}"
        options["uri"] = True


def _prepare_sqlite(connection: Any, _: Any) -> None:
    """Set SQLite to allow readers while writing, and to enforce foreign keys.

    Transactions are begun explicitly.
    """
    connection.isolation_level = None
    with contextlib.suppress(sqlite3.OperationalError):  # of a file that can only be read
        connection.execute("PRAGMA journal_mode = WAL")
    for pragma in ("synchronous = FULL", "foreign_keys = ON", "recursive_triggers = ON"):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: sa.Connection) -> None:
    """Take the lock for writing at the beginning of a transaction that writes.

    Two writers that read first would block each other.
    """
    connection.exec_driver_sql(
        "BEGIN IMMEDIATE" if connection.get_execution_options().get("writes") else "BEGIN"
    )


def _revision(connection: sa.Connection) -> str | None:
    if not sa.inspect(connection).has_table(schema.VERSION_TABLE):
        return None
    return connection.execute(
        sa.text(f"SELECT version_num FROM {schema.VERSION_TABLE}")
    ).scalar_one_or_none()


def _migrate(connection: sa.Connection, revision: str) -> None:
    """Run the migrations up to a revision, within the connection's transaction."""
    from alembic.migration import MigrationContext
    from alembic.operations import Operations
    from alembic.script import ScriptDirectory

    scripts = ScriptDirectory(str(Path(__file__).with_name("migrations")))
    options = {"version_table": schema.VERSION_TABLE}
    context = MigrationContext.configure(connection, opts=options)
    older_first = reversed(list(scripts.iterate_revisions(revision, _revision(connection))))
    with Operations.context(context):
        for script in older_first:
            script.module.upgrade()
    context.stamp(scripts, revision)
