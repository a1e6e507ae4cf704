"""What comes before the page: uploads are cut at their limit, other sites are refused, the browser asks nobody else."""

from __future__ import annotations

from typing import Any
from urllib.parse import urlsplit

#: Room for what a browser writes around files.
_ENVELOPE_BYTES = 1_000_000
_MOST_DIGITS = 18
#: Everything comes from here; a script or a font of another machine would be refused by the browser itself.
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; connect-src 'self' ws: wss: data: "
    "blob:; frame-ancestors 'none'; form-action 'self'; base-uri 'self'"
)
_HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
)


class TooMuch(Exception):
    """More bytes came than may."""


class Guard:
    """ASGI middleware.

    Args:
        app: what it guards.
        limit_bytes: most bytes of a request's body.
        hosts: names that the page may be called by; None: any. A foreign name that leads here is another site's trick.
    """

    def __init__(self, app: Any, limit_bytes: int, hosts: frozenset[str] | None) -> None:
        self._app, self._limit, self._hosts = app, limit_bytes + _ENVELOPE_BYTES, hosts

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {key: value.decode("latin-1") for key, value in scope["headers"]}
        if not self._welcome(headers):
            await _refuse(scope, send, 403, b"This page is for this machine alone.")
        elif scope["type"] == "websocket":
            await self._app(scope, receive, send)
        elif not (length := headers.get(b"content-length", "0")).isdecimal() or len(length) > _MOST_DIGITS:
            await _refuse(scope, send, 400, b"The length of the request is not a number.")
        elif int(length) > self._limit:
            await _refuse(scope, send, 413, b"The files are too large for the page.")
        else:
            await self._guarded(scope, receive, send)

    def _welcome(self, headers: dict[bytes, str]) -> bool:
        host, origin = headers.get(b"host", ""), headers.get(b"origin")
        try:
            named = self._hosts is None or (urlsplit(f"//{host}").hostname or "") in self._hosts
            return named and (origin is None or urlsplit(origin).netloc == host != "")
        except ValueError:  # no address at all, such as one with a single bracket
            return False

    async def _guarded(self, scope: Any, receive: Any, send: Any) -> None:
        received, started = 0, False

        async def counted() -> Any:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > self._limit:
                raise TooMuch
            return message

        async def marked(message: Any) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                message = {**message, "headers": [*message["headers"], *_HEADERS]}
            await send(message)

        try:
            await self._app(scope, counted, marked)
        except TooMuch:
            if not started:
                await _refuse(scope, send, 413, b"The files are too large for the page.")


async def _refuse(scope: Any, send: Any, status: int, text: bytes) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": text})
