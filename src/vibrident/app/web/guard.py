"""Guard the page: refuse foreign host names and other sites, and limit the size of uploads."""

from __future__ import annotations

import hashlib
import ipaddress
import re
import secrets
from typing import Any
from urllib.parse import urlsplit

from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response

from vibrident.app.web.authentication import Authenticator
from vibrident.app.web.language import SCOPE, choose_language
from vibrident.base.fields import Fields, NamedTexts

_ENVELOPE_BYTES = 1_000_000  # allowance for the browser's envelope around files
_MAX_LENGTH_DIGITS = 18
_POLICY_VIOLATION = 1008  # code of a WebSocket that is closed
_MAX_FULL_UPLOADS = 4  # most simultaneous uploads of the largest size, of all users together
OWNER = "vibrident.owner"  # key of a request's scope: whose browser it is
ACCOUNT = "vibrident.account"  # the same: who signed in, if the page has a door
_COOKIE_S = 30 * 86_400
_COOKIE = re.compile(r"[0-9a-f]{64}")
_HOST = re.compile(r"[\w.\-]+(:\d{1,5})?|\[[0-9a-fA-F:.]+\](:\d{1,5})?", re.ASCII)
_HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",  # without any, a form says that it comes from nowhere
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
_UNKNOWN_HOST = (
    "The page is not known by this name. Open the address that the server printed, or start the "
    "server with this name among its own."
)
_TOO_LARGE = "The files are too large for the page."
_BUSY = "The server takes as many files as it can at this moment. Try again in a minute."


def policy(host: str, nonce: str = "") -> str:
    """Return the content security policy: this server only, and inline scripts with the nonce.

    NiceGUI evaluates text that the server sends, and Vue sets styles of elements. Some browsers do
    not count the target of the page's WebSocket, ``host``, as ``'self'``.
    """
    inline = f"'nonce-{nonce}' " if nonce else ""
    return (
        f"default-src 'self'; script-src 'self' {inline}'unsafe-eval' blob:; style-src 'self' "
        "'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' "
        f"blob:; connect-src 'self' ws://{host} wss://{host}; "
        "object-src 'none'; frame-src 'none'; frame-ancestors 'none'; form-action 'self'; base-uri "
        "'self'"
    )


class BodyTooLarge(Exception):
    """The body exceeds the limit."""


class Guard:
    """ASGI middleware that passes allowed requests on to the page.

    Args:
        app: the guarded application.
        limit_bytes: most bytes of a request's body.
        names: allowed host names, beside the address at which a request arrives; others could be
            DNS rebinding.
        door: of a team's page; None lets in everybody who reaches it.
    """

    def __init__(
        self, app: Any, limit_bytes: int, names: frozenset[str], door: Authenticator | None = None
    ) -> None:
        self._app = app
        self._limit = limit_bytes + _ENVELOPE_BYTES
        self._door = door
        self._names = frozenset(map(_normal_host, names))
        self._coming = 0

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        plain_scope = {**scope, "headers": _plain_headers(scope)}
        connection = HTTPConnection(plain_scope)
        accepted = connection.headers.get("accept-language", "")
        scope[SCOPE] = plain_scope[SCOPE] = choose_language(connection.cookies, accepted)
        if scope["type"] == "websocket":
            await self._connected(scope, receive, send, connection)
            return
        response = await self._answer(Request(plain_scope, receive))
        if response is not None:
            response.headers.update(_HEADERS)
            await response(scope, receive, send)
            return
        account = self._door.visitor(connection) if self._door else None
        scope[OWNER], cookie = (account.name, {}) if account else browser_identity(connection)
        scope[ACCOUNT] = account
        await self._guarded(scope, receive, send, connection.headers["host"], cookie)

    async def _answer(self, request: Request) -> Response | None:
        """Return the answer to a request that the page shall not answer; None if it may."""
        length = request.headers.get("content-length", "0")
        if self._is_foreign(request):
            return _refusal(403, _UNKNOWN_HOST)
        if not length.isdecimal() or len(length) > _MAX_LENGTH_DIGITS:
            return _refusal(400, "The length of the request is not a number.")
        if int(length) > self._limit:
            return _refusal(413, _TOO_LARGE)
        if self._door and (response := await self._door.answer(request)) is not None:
            return response
        if self._coming + int(length) > _MAX_FULL_UPLOADS * self._limit:
            return _refusal(503, _BUSY)
        return None

    async def _connected(
        self, scope: Any, receive: Any, send: Any, connection: HTTPConnection
    ) -> None:
        """Pass a WebSocket on for as long as its visitor may be here."""

        def is_gone() -> bool:
            return self._door is not None and self._door.visitor(connection) is None

        async def checked() -> Any:
            message = await receive()
            end = {"type": "websocket.disconnect", "code": _POLICY_VIOLATION}
            return end if is_gone() else message

        if self._is_foreign(connection) or is_gone():
            await send({"type": "websocket.close", "code": _POLICY_VIOLATION})
        else:
            await self._app(scope, checked, send)

    def _is_foreign(self, connection: HTTPConnection) -> bool:
        """Return whether a request is for another host, or of another site."""
        return not self._is_own_host(connection) or _is_cross_site(connection)

    def _is_own_host(self, connection: HTTPConnection) -> bool:
        """Return whether the host is an allowed name, or the address that the request reached."""
        host = connection.headers.get("host", "")
        if not _HOST.fullmatch(host):
            return False
        try:
            name = _normal_host(urlsplit(f"//{host}").hostname or "")
        except ValueError:
            return False
        server_address = connection.scope.get("server")
        return name in self._names or (
            bool(server_address)
            and _is_address(name)
            and name == _normal_host(str(server_address[0]))
        )

    async def _guarded(
        self, scope: Any, receive: Any, send: Any, host: str, cookie: NamedTexts
    ) -> None:
        received = 0
        started = False
        nonce = secrets.token_hex(16)
        added = {"content-security-policy": policy(host, nonce), **_HEADERS, **cookie}
        added_headers = [(key.encode(), value.encode()) for key, value in added.items()]
        # the start of a page, until its scripts have the nonce
        page_start: Fields | None = None

        async def counted() -> Any:
            nonlocal received
            message = await receive()
            size = len(message.get("body", b""))
            received += size
            self._coming += size
            if received > self._limit or self._coming > _MAX_FULL_UPLOADS * self._limit:
                raise BodyTooLarge
            return message

        async def marked(message: Any) -> None:
            nonlocal started, page_start
            if message["type"] == "http.response.start":
                started = True
                message = {**message, "headers": [*message["headers"], *added_headers]}
                if dict(message["headers"]).get(b"content-type", b"").startswith(b"text/html"):
                    page_start = message
                    return
            elif page_start is not None:  # a page comes in one piece
                body = message.get("body", b"").replace(
                    b"<script", f'<script nonce="{nonce}"'.encode()
                )
                other_headers = [
                    header for header in page_start["headers"] if header[0] != b"content-length"
                ]
                await send({**page_start, "headers": other_headers})
                page_start = None
                message = {**message, "body": body}
            await send(message)

        try:
            await self._app(scope, counted, marked)
        except BodyTooLarge:
            if not started:
                large = received > self._limit
                refusal = _refusal(413, _TOO_LARGE) if large else _refusal(503, _BUSY)
                refusal.headers.update(_HEADERS)
                await refusal(scope, receive, send)
        finally:
            self._coming -= received


def browser_identity(connection: HTTPConnection) -> tuple[str, NamedTexts]:
    """Return the hash of a browser's token, and the header that sets its cookie if it has none."""
    scope = connection.scope
    name = f"vibrident-{(scope.get('server') or ('', 0))[1]}"  # browsers do not tell ports apart
    token = connection.cookies.get(name, "")
    header = {}
    if not _COOKIE.fullmatch(token):
        token = secrets.token_hex(32)
        if scope.get("path") == "/":
            flags = f"Path=/; Max-Age={_COOKIE_S}; HttpOnly; SameSite=Lax"
            header = {"set-cookie": f"{name}={token}; {flags}"}
    return hashlib.sha256(token.encode()).hexdigest(), header


def _plain_headers(scope: Any) -> list[tuple[bytes, bytes]]:
    """Return the headers; one with contradictory values gets a value that fits no rule."""
    headers: dict[bytes, bytes] = {}
    for key, value in scope["headers"]:
        headers[key] = value if headers.get(key, value) == value else b"\n"
    return [*headers.items()]


def _is_cross_site(connection: HTTPConnection) -> bool:
    """Return whether a page of another origin makes the request.

    Following a link to this page is allowed.
    """
    headers = connection.headers
    scope = connection.scope
    origin = headers.get("origin")
    try:
        if origin is not None and urlsplit(origin).netloc != headers["host"]:
            return True
    except ValueError:  # not an address, such as one with a single bracket
        return True
    if headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none"):
        return False
    visits = scope["type"] == "http" and scope.get("method") == "GET" and scope.get("path") == "/"
    fetch = (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest"))
    return not (visits and fetch == ("navigate", "document"))


def _normal_host(name: str) -> str:
    """Return a name or address in normal form."""
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return name.lower()
    mapped = getattr(address, "ipv4_mapped", None)
    return str(mapped or address)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _refusal(status: int, text: str) -> Response:
    nothing = "default-src 'none'; frame-ancestors 'none'"
    headers = {"connection": "close", "content-security-policy": nothing}
    return PlainTextResponse(text, status, headers)
