"""What the page lets in; the guard is asked as a server asks it, without one."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import pytest

from vibrident.errors import InputError
from vibrident.web.guard import POLICY, Guard
from vibrident.web.server import LOOPBACK, serve

LIMIT, ENVELOPE = 2_000_000, 1_000_000
HERE = "127.0.0.1:8080"


async def count(scope: Any, receive: Any, send: Any) -> None:
    """What is guarded: says how many bytes came; takes a websocket."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    received, more = 0, True
    while more:
        message = await receive()
        received, more = received + len(message["body"]), message["more_body"]
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": str(received).encode()})


def ask(
    *pieces: bytes, hosts: frozenset[str] | None = LOOPBACK, kind: str = "http", **headers: str
) -> list[dict[str, Any]]:
    """Send a body in pieces; returns what is answered."""
    said: list[dict[str, Any]] = []
    body = list(pieces or (b"",))

    async def receive() -> dict[str, Any]:
        piece = body.pop(0)
        return {"type": "http.request", "body": piece, "more_body": bool(body)}

    async def send(message: dict[str, Any]) -> None:
        said.append(message)

    pairs = [(key.replace("_", "-").encode(), value.encode("latin-1")) for key, value in headers.items()]
    asyncio.run(Guard(count, LIMIT, hosts)({"type": kind, "headers": pairs}, receive, send))
    return said


@pytest.mark.parametrize("host", [HERE, "localhost", "localhost:9", "[::1]:8080", "LOCALHOST:8080"])
def test_this_machine_is_welcome_and_is_told_the_policy(host):
    start, _ = ask(host=host)
    assert start["status"] == 200
    told = dict(start["headers"])
    assert told[b"content-security-policy"] == POLICY.encode()
    assert told[b"x-content-type-options"] == b"nosniff"
    assert told[b"referrer-policy"] == b"no-referrer"


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "", "localhost@evil", "[bad"]
)
def test_a_foreign_name_that_leads_here_is_refused(host):
    assert ask(host=host)[0]["status"] == 403


def test_served_to_others_any_name_will_do():
    assert ask(hosts=None, host="lab.example")[0]["status"] == 200
    assert ask(hosts=None, host="lab.example", origin="http://lab.example")[0]["status"] == 200
    assert ask(hosts=None, origin="null")[0]["status"] == 403


@pytest.mark.parametrize("hosts", [LOOPBACK, None])
@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:9999", "http://127.0.0.1", "", "http://[", "http://a]b"]
)
def test_another_site_is_refused(origin, hosts):
    assert ask(b"x", hosts=hosts, host=HERE, origin=origin)[0]["status"] == 403
    refused = {"type": "websocket.close", "code": 1008}
    assert ask(hosts=hosts, kind="websocket", host=HERE, origin=origin) == [refused]


def test_the_page_itself_is_no_other_site():
    assert ask(b"x", host=HERE, origin=f"http://{HERE}")[1]["body"] == b"1"
    assert ask(kind="websocket", host=HERE, origin=f"http://{HERE}") == [{"type": "websocket.accept"}]


def test_a_body_beyond_the_limit_is_refused_announced_or_not():
    most = LIMIT + ENVELOPE
    pieces = [b"x" * 1_000_000] * 3
    assert ask(*pieces, host=HERE)[1]["body"] == str(most).encode()
    assert ask(*pieces, host=HERE, content_length=str(most))[1]["body"] == str(most).encode()
    assert ask(host=HERE, content_length=str(most + 1))[0]["status"] == 413
    assert ask(*pieces, b"x", host=HERE)[0]["status"] == 413
    assert ask(*pieces, b"x", host=HERE, content_length="1")[0]["status"] == 413


@pytest.mark.parametrize("length", ["many", "-1", "1e3", "1_0", "²", "9" * 5000])
def test_a_length_that_is_no_number_is_refused(length):
    assert ask(host=HERE, content_length=length)[0]["status"] == 400


def test_a_place_that_cannot_be_had_gets_the_remedy_that_helps():
    pytest.importorskip("nicegui")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(InputError, match="leave --port out"):
            serve(host="127.0.0.1", port=other.getsockname()[1], show=False, limit_mb=1.0)
    with pytest.raises(InputError, match="leave --host out"):
        serve(host="203.0.113.7", port=0, show=False, limit_mb=1.0)  # of the block for documentation, RFC 5737
