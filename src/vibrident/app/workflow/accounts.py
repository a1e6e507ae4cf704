"""Keep the accounts of a team's page: names, roles and Argon2 hashes; limit password guesses."""

from __future__ import annotations

import functools
import os
import re
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.base.files import atomic_write

# addresses at which a page is for this machine alone
LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
#: What each may do, and all before it: look at results and histories, identify and issue, approve.
ROLES = ("look", "identify", "approve")
_NAME = re.compile(r"[\w.@+-]{1,64}")
#: Failures of a name or an address before it has to wait, and the longest wait in seconds; it
#: doubles from a second.
_FREE_FAILURES = 5
_MAX_WAIT_S = 900.0
_MAX_REMEMBERED_KEYS = 10_000  # most names and addresses whose failures are remembered


@dataclass(frozen=True)
class Account:
    """A name with its role; ``hash`` is empty for one that signs in at a proxy."""

    name: str
    role: str
    hash: str

    def may(self, role: str) -> bool:
        """Return whether the role includes another."""
        return ROLES.index(self.role) >= ROLES.index(role)


class Accounts:
    """The accounts of a file, read again when it has changed: a line each, ``NAME:ROLE:HASH``."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._read_at_ns = -1
        self._accounts: dict[str, Account] = {}
        self._failures: dict[str, tuple[int, float]] = {}
        self._one_at_a_time = threading.Lock()  # a hash takes 64 MB and a processor
        self._read()

    def named(self, name: str) -> Account | None:
        """Return the account of this name, as the file has it now; None if there is none."""
        try:
            if self._file.stat().st_mtime_ns != self._read_at_ns:
                self._read()
        except (OSError, InputError):  # half written, or removed: nobody comes in
            return None
        return self._accounts.get(name)

    def wait_s(self, *keys: str) -> float:
        """Return the seconds that a name or an address must wait before its next try."""
        waits = [
            until - time.monotonic()
            for _, until in (self._failures.get(key, (0, 0.0)) for key in keys)
        ]
        return max(0.0, *waits)

    def check(self, name: str, password: str, *keys: str) -> Account | None:
        """Return the account if the password is right; else count a failure of the keys.

        It takes time, by design.
        """
        from argon2 import PasswordHasher
        from argon2.exceptions import InvalidHashError, VerificationError

        account = self.named(name)
        hasher = PasswordHasher()
        with self._one_at_a_time:
            try:  # an unknown name takes as long as a known one
                hasher.verify((account and account.hash) or _unused_hash(), password)
                right = account is not None and bool(account.hash)
            except (VerificationError, InvalidHashError):
                right = False
        for key in keys:
            if right:
                self._failures.pop(key, None)
            else:
                self._fail(key)
        return account if right else None

    def _fail(self, key: str) -> None:
        count = self._failures.get(key, (0, 0.0))[0] + 1
        wait = min(2.0 ** (count - _FREE_FAILURES), _MAX_WAIT_S) if count >= _FREE_FAILURES else 0.0
        self._failures[key] = (count, time.monotonic() + wait)
        if len(self._failures) > _MAX_REMEMBERED_KEYS:
            del self._failures[min(self._failures, key=lambda key: self._failures[key][1])]

    def _read(self) -> None:
        try:
            stat = self._file.stat()
            text = self._file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise _unusable_error(self._file, str(error)) from error
        if stat.st_mode & 0o022:
            raise _unusable_error(self._file, "a file that others may write", "chmod go-w it")
        accounts = {}
        for number, line in enumerate(text.splitlines(), 1):
            if not line.strip() or line.startswith("#"):
                continue
            name, _, fields = line.strip().partition(":")
            role, _, hashed = fields.partition(":")
            if (
                not _NAME.fullmatch(name)
                or role not in ROLES
                or (hashed and not hashed.startswith("$argon2id$"))
            ):
                raise _unusable_error(self._file, f"line {number} is none")
            accounts[name] = Account(name, role, hashed)
        self._accounts = accounts
        self._read_at_ns = stat.st_mtime_ns


def add_account(file: Path, name: str, role: str, password: str) -> None:
    """Write an account to the file; it replaces one of the same name."""
    from argon2 import PasswordHasher

    if not _NAME.fullmatch(name) or role not in ROLES:
        raise _unusable_error(
            file, f"{name}:{role}", f"give NAME:ROLE, with a role of {', '.join(ROLES)}"
        )
    if len(password) < 8:  # NIST SP 800-63B, 5.1.1.1
        raise _unusable_error(file, "a password shorter than 8 characters", "choose a longer one")
    if file.exists():
        Accounts(file)
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    other_lines = [line for line in lines if line.partition(":")[0].strip() != name]
    text = "\n".join([*other_lines, f"{name}:{role}:{PasswordHasher().hash(password)}"]) + "\n"
    with atomic_write(file) as partial:
        partial.touch(0o600)
        partial.write_text(text, encoding="utf-8")


@functools.cache
def _unused_hash() -> str:
    """Return a hash that fits no real password and costs as much to check as any other."""
    from argon2 import PasswordHasher

    return PasswordHasher().hash(os.urandom(32).hex())


def _unusable_error(
    file: Path,
    problem: str,
    remedy: str = "make it with ⟦command = serve⟧, ⟦serve.auth = FILE⟧ and ⟦serve.add = NAME:ROLE⟧",
) -> InputError:
    return InputError(
        "The file of accounts cannot be used.",
        expected="lines NAME:ROLE:HASH, in a file that its owner alone may write",
        found=problem,
        where=f"⟦serve.auth = {str(file)!r}⟧",
        remedy=remedy,
    )
