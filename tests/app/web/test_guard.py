"""What the page lets in; the guard is asked as a server asks it, without one."""

from __future__ import annotations

import asyncio
import re
import socket
from collections.abc import Sequence
from typing import Any

import pytest
from tests.support.serving import alone

from vibrident.app.web.guard import Guard, policy
from vibrident.app.web.server import page_names, reachable_address, serve
from vibrident.app.workflow.accounts import LOOPBACK
from vibrident.base.errors import InputError

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
    *pieces: bytes,
    names: frozenset[str] = LOOPBACK,
    kind: str = "http",
    at: str = "127.0.0.1",
    more: Sequence[tuple[bytes, bytes]] = (),
    **headers: str,
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
    scope = {"type": kind, "method": "GET", "path": "/", "server": (at, 8080), "headers": [*pairs, *more]}
    alone(Guard(count, LIMIT, names)(scope, receive, send))
    return said


@pytest.mark.parametrize("host", [HERE, "localhost", "localhost:9", "[::1]:8080", "LOCALHOST:8080"])
def test_this_machine_is_welcome_and_is_told_the_policy(host):
    start, _ = ask(host=host)
    assert start["status"] == 200
    told = dict(start["headers"])
    nonce = re.search(r"'nonce-([0-9a-f]{32})'", told[b"content-security-policy"].decode())
    assert nonce
    assert told[b"content-security-policy"] == policy(host, nonce[1]).encode()
    assert told[b"x-frame-options"] == b"DENY"
    assert told[b"x-content-type-options"] == b"nosniff"
    assert told[b"referrer-policy"] == b"same-origin"


@pytest.mark.parametrize("host", [HERE, "[::1]:8080", "lab.example"])
def test_the_policy_lets_the_page_talk_to_its_own_origin_alone(host):
    rules = {words[0]: set(words[1:]) for words in map(str.split, policy(host).split(";"))}
    assert rules["connect-src"] == {"'self'", f"ws://{host}", f"wss://{host}"}
    own = {"'self'", "'unsafe-inline'", "'unsafe-eval'", "'none'", "data:", "blob:"}
    assert all(words <= own for name, words in rules.items() if name != "connect-src")


STRANGERS = [
    "evil.example",
    "evil.example:8080",
    "127.0.0.1.evil.example",
    "",
    "localhost@evil",
    "[bad",
    "[::ffff:192.0.2.9]",
    "192.0.2.9",
    "2130706433",
    "localhost:8080 evil.example",
    "localhost;script-src *",
    "localhost:99999999",
]


@pytest.mark.parametrize("host", STRANGERS)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_foreign_name_that_leads_here_is_refused(host, kind):
    for names in (LOOPBACK, page_names("0.0.0.0")):  # DNS rebinding works as well on a page for all
        said = ask(host=host, kind=kind, names=names, origin=f"http://{host}")
        assert said[0].get("status", said[0].get("code")) in (403, 1008)


def test_two_names_at_once_are_none():
    assert ask(host=HERE, more=[(b"host", b"evil.example")])[0]["status"] == 403
    assert ask(host=HERE, more=[(b"host", HERE.encode())])[0]["status"] == 200


def test_served_to_others_it_answers_to_its_address_and_names_alone():
    everywhere = page_names("0.0.0.0") | {"Lab.example"}
    for host in ("lab.example:8080", socket.gethostname(), "127.0.0.1"):
        assert ask(names=everywhere, host=host, origin=f"http://{host}")[0]["status"] == 200
    assert ask(names=everywhere, host="192.0.2.7:8080", at="192.0.2.7")[0]["status"] == 200
    assert ask(names=everywhere, host="192.0.2.8:8080", at="192.0.2.7")[0]["status"] == 403
    assert ask(names=everywhere, host="192.0.2.7", at="::ffff:192.0.2.7")[0]["status"] == 200
    assert ask(names=everywhere, host="[2001:DB8::7]:8080", at="2001:db8::7")[0]["status"] == 200


def test_another_site_may_link_here_and_no_more():
    assert ask(host=HERE, sec_fetch_site="cross-site")[0]["status"] == 403  # an image, say
    for site in ("cross-site", "same-site"):
        fetch = {"sec_fetch_site": site, "sec_fetch_mode": "navigate"}
        assert ask(host=HERE, sec_fetch_dest="document", **fetch)[0]["status"] == 200
        assert ask(host=HERE, sec_fetch_dest="iframe", **fetch)[0]["status"] == 403
    assert ask(host=HERE, sec_fetch_site="same-origin", origin=f"http://{HERE}")[0]["status"] == 200


def test_uploads_under_way_are_bounded_in_all():
    """Four of the largest size; the fifth waits its turn."""
    said: list[int] = []

    async def all_at_once() -> None:
        held = asyncio.Event()

        async def holding(scope: Any, receive: Any, send: Any) -> None:
            await receive()
            await held.wait()
            await count(scope, receive, send)

        guard = Guard(holding, LIMIT, LOOPBACK)

        async def one() -> None:
            pieces = [(b"x" * (LIMIT + ENVELOPE), True), (b"", True), (b"", False)]

            async def receive() -> dict[str, Any]:
                body, more = pieces.pop(0)
                return {"type": "http.request", "body": body, "more_body": more}

            async def send(message: dict[str, Any]) -> None:
                if "status" in message:
                    said.append(message["status"])

            await guard({"type": "http", "headers": [(b"host", HERE.encode())]}, receive, send)

        tasks = [asyncio.create_task(one()) for _ in range(5)]
        while not said:
            await asyncio.sleep(0)
        held.set()
        await asyncio.gather(*tasks)

    alone(all_at_once())
    assert sorted(said) == [200, 200, 200, 200, 503]


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:9999", "http://127.0.0.1", "", "http://[", "http://a]b"]
)
def test_another_site_is_refused(origin):
    assert ask(b"x", host=HERE, origin=origin)[0]["status"] == 403
    refused = {"type": "websocket.close", "code": 1008}
    assert ask(kind="websocket", host=HERE, origin=origin) == [refused]


def test_a_refusal_has_the_headers_too():
    for refused in (ask(host="evil.example"), ask(host=HERE, content_length="many"), ask(host=HERE, origin="null")):
        told = dict(refused[0]["headers"])
        assert told[b"content-security-policy"].startswith(b"default-src 'none'")
        assert told[b"x-frame-options"] == b"DENY"
        assert told[b"x-content-type-options"] == b"nosniff"


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
        with pytest.raises(InputError, match="leave port out"):
            serve(host="127.0.0.1", port=other.getsockname()[1], show=False, limit_mb=1.0)
    with pytest.raises(InputError, match="leave host out"):
        serve(host="203.0.113.7", port=0, show=False, limit_mb=1.0)  # of the block for documentation, RFC 5737


@pytest.mark.parametrize("host", ["127.0.0.1", "lab.example", "::1"])
def test_the_address_that_is_printed_is_the_one_given(host):
    assert reachable_address(host) == host


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_the_address_that_is_printed_can_be_opened(host):
    try:
        listening = socket.create_server((host, 0), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError:
        pytest.skip("this machine has no such network")
    with listening:
        shown = reachable_address(host)
        assert shown not in ("0.0.0.0", "::")
        socket.create_connection((shown, listening.getsockname()[1]), timeout=5).close()
