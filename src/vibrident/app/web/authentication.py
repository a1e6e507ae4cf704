"""Authenticate visitors of a team's page, by password or proxy header, and write the audit log."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import html
import json
import os
import secrets
import time
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response

from vibrident.app.web.language import LOCALES, SCOPE, language, phrase
from vibrident.app.workflow.accounts import Account, Accounts
from vibrident.base.errors import InputError

SIGN_IN = "/sign-in"
SIGN_OUT = "/sign-out"
_SESSION_S = 12 * 3600.0  # seconds for which somebody stays signed in
_MAX_SESSIONS = 1000
_MAX_FORM_BYTES = 2000  # of a name and a password
_MAX_WAITING_SIGN_INS = 8  # most tries that wait for their turn
_PAGE = """<!doctype html><html lang="{lang}"><meta charset="utf-8"><meta name="viewport"
 content="width=device-width">
<meta name="color-scheme" content="light dark"><title>vibrident: {title}</title><style
 nonce="{nonce}">
body {{ font: 1rem/1.5 system-ui, sans-serif; max-width: 22rem; margin: 12vh auto;
  padding: 0 16px }}
label, input, button {{ display: block; width: 100%; box-sizing: border-box; font: inherit }}
input {{ padding: 8px; margin: 2px 0 14px }} button {{ padding: 10px }}
[role=alert] {{ font-weight: 650 }}
</style><main><h1>vibrident</h1>{said}<form method="post" action="{action}"><label
 for="name">{name}</label>
<input id="name" name="name" autocomplete="username" required autofocus><label
 for="password">{password}</label>
<input id="password" name="password" type="password" autocomplete="current-password" required>
<button>{button}</button></form></main></html>"""

_WORDS = {
    "title": phrase("sign in"),
    "name": phrase("Name"),
    "password": phrase("Password"),
    "button": phrase("Sign in"),
}
_TOO_MANY = phrase("Too many tries. Wait {seconds} s.")
_WRONG = phrase("Name and password do not belong together.")


class Authenticator:
    """Let requests in, and answer those that sign in or out.

    Args:
        accounts: of the file; None if everybody whom the proxy lets in may identify.
        audit: file of what was done by whom, a line of JSON each; None for none.
        sessions: file in which sessions outlive the server.
        proxy: address of a proxy before the page.
        user_header: header in which the proxy says who has signed in there, if it does.
    """

    def __init__(
        self,
        accounts: Accounts | None,
        audit: Path | None,
        sessions: Path,
        proxy: str | None = None,
        user_header: str | None = None,
    ) -> None:
        self._accounts = accounts
        self._audit = audit
        self._file = sessions
        self._proxy = proxy
        self._user_header = None if user_header is None else user_header.lower()
        self._waiting = 0
        self._sessions: dict[str, tuple[str, float]] = {}
        with contextlib.suppress(OSError, ValueError, TypeError):
            self._sessions = {
                key: (str(session[0]), float(session[1]))
                for key, session in json.loads(sessions.read_text()).items()
            }

    def note(self, account: str, action: str, **facts: Any) -> None:
        """Add a line on what was done by whom; it is on the disk when this returns."""
        if self._audit is None:
            return
        at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        line = json.dumps({"time": at, "account": account, "action": action, **facts}) + "\n"
        self._audit.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(
            os.open(self._audit, os.O_CREAT | os.O_WRONLY | os.O_APPEND, 0o600), "wb", 0
        ) as out:
            out.write(line.encode())
            os.fsync(out.fileno())

    def account(self, name: str) -> Account | None:
        """Return the account of this name, with its present role; None if there is none."""
        named = self._accounts.named(name) if self._accounts else None
        if named is None and self._user_header is not None:
            return Account(name, "look" if self._accounts else "identify", "")
        return named

    def visitor(self, request: HTTPConnection) -> Account | None:
        """Return the account that makes a request; None if it has no valid session."""
        if self._user_header is not None:
            name = request.headers.get(self._user_header, "")
            plain = 0 < len(name) <= 200 and name.isprintable()
            return self.account(name) if plain and self._is_proxied(request) else None
        name, until = self._sessions.get(_session_key(request), ("", 0.0))
        return self.account(name) if time.time() < until else None

    async def answer(self, request: Request) -> Response | None:
        """Return the answer to a request that the page does not answer; None if the page may."""
        path = request.scope.get("path")
        visitor = self.visitor(request)
        if self._user_header is not None:
            refusal = PlainTextResponse("Sign in at the proxy before this page.", 403)
            return refusal if visitor is None else None
        if path == SIGN_IN and request.method == "POST":
            return await self._sign_in(request)
        if path == SIGN_IN:
            return _form(request, 200)
        if path == SIGN_OUT and request.method == "POST":
            self._sessions.pop(_session_key(request), None)
            self._write()
            self.note(visitor.name if visitor else "", "signed out")
            return RedirectResponse(SIGN_IN, 303)
        if visitor is not None:
            return None
        if path == "/" and request.method == "GET":
            return RedirectResponse(SIGN_IN, 303)
        return PlainTextResponse("Sign in first.", 401)

    async def _sign_in(self, request: Request) -> Response:
        assert self._accounts is not None
        body = b""
        with contextlib.suppress(ClientDisconnect):  # then nobody reads the answer
            async for piece in request.stream():
                body += piece
                if len(body) > _MAX_FORM_BYTES:
                    break
        fields = parse_qs(body[:_MAX_FORM_BYTES].decode("utf-8", "replace"))
        name, password = (fields.get(key, [""])[0] for key in ("name", "password"))
        where = self._from(request)
        keys = (f"name {name}", f"address {where}")
        if (wait := self._accounts.wait_s(*keys)) > 0.0 or self._waiting >= _MAX_WAITING_SIGN_INS:
            return _form(request, 429, _TOO_MANY, seconds=f"{max(wait, 1.0):.0f}")
        self._waiting += 1
        try:
            account = await asyncio.to_thread(self._accounts.check, name, password, *keys)
        finally:
            self._waiting -= 1
        self.note(name[:64], "signed in" if account else "refused", address=where)
        if account is None:
            return _form(request, 403, _WRONG)
        token = secrets.token_hex(32)
        now = time.time()
        self._sessions = {
            key: session for key, session in self._sessions.items() if session[1] > now
        }
        if len(self._sessions) >= _MAX_SESSIONS:
            self._sessions.pop(next(iter(self._sessions)))
        self._sessions[hashlib.sha256(token.encode()).hexdigest()] = (name, now + _SESSION_S)
        self._write()
        response = RedirectResponse("/", 303)
        response.set_cookie(
            _cookie_name(request),
            token,
            max_age=int(_SESSION_S),
            secure=self._is_proxied(request)
            and request.headers.get("x-forwarded-proto") == "https",
            httponly=True,
        )
        return response

    def _is_proxied(self, request: HTTPConnection) -> bool:
        """Return whether the proxy passes a request on."""
        return self._proxy is not None and _peer_address(request) == self._proxy

    def _from(self, request: HTTPConnection) -> str:
        """Return the client's address, as the proxy states it where there is one."""
        peer = _peer_address(request)
        if self._is_proxied(request):
            return request.headers.get("x-forwarded-for", peer).rpartition(",")[2].strip()[:64]
        return peer

    def _write(self) -> None:
        partial = self._file.with_name(f"{self._file.name}.part")
        with os.fdopen(os.open(partial, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600), "w") as out:
            json.dump(self._sessions, out)
        partial.replace(self._file)


def _form(request: Request, status: int, message: str = "", **values: str) -> Response:
    """Return the form, in the visitor's language, below what is said of the last try."""
    speak = language(request.scope.get(SCOPE, "en"))
    nonce = secrets.token_hex(16)
    page = _PAGE.format(
        nonce=nonce,
        said=f'<p role="alert">{html.escape(speak(message, **values))}</p>' if message else "",
        action=SIGN_IN,
        lang=LOCALES[speak.code],
        **{slot: html.escape(speak(text)) for slot, text in _WORDS.items()},
    )
    policy = (
        f"default-src 'none'; style-src 'nonce-{nonce}'; form-action 'self'; frame-ancestors 'none'"
    )
    headers = {"content-security-policy": policy, "cache-control": "no-store"}
    return HTMLResponse(page, status, headers)


def build_authenticator(
    auth: Path | None,
    proxy: str | None,
    user_header: str | None,
    audit: Path | None,
    folder: Path,
    *,
    loopback: bool,
) -> Authenticator | None:
    """Return the authenticator of a team's page; None if only this machine can reach the page.

    InputError if others could use the page without signing in.
    """
    if user_header is not None and proxy is None:
        raise _unguarded_error(
            f"⟦serve.user_header = {user_header!r}⟧ without ⟦serve.proxy⟧",
            "the address of the proxy that sends the header",
        )
    if auth is None and user_header is None:
        if not loopback or proxy is not None:
            ways = "⟦serve.auth = FILE⟧, or ⟦serve.proxy = ADDRESS⟧ with ⟦serve.user_header = NAME⟧"
            raise _unguarded_error("neither", ways)
        return None
    accounts = Accounts(auth) if auth is not None else None
    return Authenticator(accounts, audit, folder / "sessions.json", proxy or None, user_header)


def _unguarded_error(settings: str, expected: str) -> InputError:
    return InputError(
        "Others could use this page without signing in.",
        expected=expected,
        found=settings,
        where="⟦here⟧",
        remedy="make accounts with ⟦command = serve⟧, ⟦serve.auth = FILE⟧ and "
        "⟦serve.add = NAME:ROLE⟧, or leave ⟦serve.host⟧ out",
    )


def _peer_address(request: HTTPConnection) -> str:
    return request.client.host if request.client else ""


def _cookie_name(request: HTTPConnection) -> str:
    return f"vibrident-in-{(request.scope.get('server') or ('', 0))[1]}"


def _session_key(request: HTTPConnection) -> str:
    token = request.cookies.get(_cookie_name(request), "")
    return hashlib.sha256(token.encode()).hexdigest()
