"""What is done to a team's page at the socket: forged headers, sessions, guesses from many addresses, uploads.

Each attack prints what it met; studies/security.md has the lines of one run.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import statistics
import sys
import threading
import time
from collections import Counter
from functools import partial
from urllib.parse import urlencode, urlsplit

import pytest
from tests.support.serving import VIBRIDENT, Server, serving

pytest.importorskip("argon2")

from vibrident.app.workflow.accounts import add_account

SECRET = "correct horse"
PROXY = "127.0.0.3"
ANSWER_S = 120.0  # longest wait for an answer, on a busy machine
#: The address that the server sees is ours to choose on Linux alone, where all of 127/8 is this machine.
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs several addresses of this machine")


@pytest.fixture(scope="module")
def accounts(tmp_path_factory):
    file = tmp_path_factory.mktemp("accounts") / "accounts"
    for name, role in (("ina", "identify"), ("bob", "approve")):
        add_account(file, name, role, SECRET)
    return file


@pytest.fixture(scope="module")
def team(accounts, tmp_path_factory):
    folder = tmp_path_factory.mktemp("team")
    options = ("--host", "127.0.0.1", "--port", "0", "--auth", str(accounts), "--audit", str(folder / "audit.jsonl"))
    with serving(folder, *VIBRIDENT, "serve", *options) as made:
        yield made


@pytest.fixture(scope="module")
def proxied(accounts, tmp_path_factory):
    folder = tmp_path_factory.mktemp("proxied")
    options = ("--port", "0", "--auth", str(accounts), "--proxy", PROXY, "--user-header", "X-Forwarded-User")
    with serving(folder, *VIBRIDENT, "serve", *options, "--audit", str(folder / "audit.jsonl")) as made:
        yield made


def asked(
    server: Server, path: str = "/", method: str = "GET", body: str = "", at: str = "127.0.0.1", **headers: str
) -> tuple[int, dict[str, str], bytes]:
    """Status, headers and body of an answer to a request that comes from an address."""
    here = urlsplit(server.address)
    connection = http.client.HTTPConnection(here.hostname or "", here.port, timeout=ANSWER_S, source_address=(at, 0))
    try:
        named = {key.replace("_", "-"): value for key, value in headers.items()}
        connection.request(method, path, body or None, named)
        answer = connection.getresponse()
        return answer.status, {key.lower(): value for key, value in answer.getheaders()}, answer.read()
    finally:
        connection.close()


def sign_in(server: Server, name: str, password: str, **more: str):
    return asked(server, "/sign-in", "POST", urlencode({"name": name, "password": password}), **more)


def handshake(server: Server, **headers: str) -> int:
    more = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13"}
    key = {"Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ=="}
    return asked(server, "/_nicegui_ws/socket.io/?EIO=4&transport=websocket", **more, **key, **headers)[0]


def test_no_header_makes_a_neighbour_the_proxy(proxied):
    says = {"X_Forwarded_User": "bob"}
    forged = (
        {"X_Forwarded_For": PROXY},
        {"X_Forwarded_For": f"{PROXY}, {PROXY}"},
        {"X_Real_IP": PROXY},
        {"Forwarded": f"for={PROXY}"},
        {"X_Forwarded_For": PROXY, "X_Forwarded_Proto": "https", "X_Forwarded_Host": "lab.example"},
        {"X_Client_IP": PROXY, "True_Client_IP": PROXY, "CF_Connecting_IP": PROXY},
    )
    met = [asked(proxied, **says, **one)[0] for one in forged]
    met += [handshake(proxied, **says, **one) for one in forged]
    through = asked(proxied, at=PROXY, **says)[0]
    names = [asked(proxied, at=PROXY, X_Forwarded_User=name)[0] for name in ("", "x" * 201)]
    print(f"forged proxy headers from 127.0.0.1: {Counter(met)}; from {PROXY}: {through}; no name, a long one: {names}")
    assert set(met) == {403}
    assert through == 200
    assert names == [403, 403]


def test_a_session_is_neither_fixed_nor_replayed(team):
    name = f"vibrident-in-{urlsplit(team.address).port}"
    fixed = f"{name}={'a' * 64}"
    status, told, _ = sign_in(team, "ina", SECRET, Cookie=fixed)
    inside = told["set-cookie"].partition(";")[0]
    met = {
        "signed in": status,
        "with the cookie chosen before": asked(team, Cookie=fixed)[0],
        "with the new one": asked(team, Cookie=inside)[0],
        "two cookies of one name": asked(team, Cookie=f"{fixed}; {inside}")[0],
        "in the address": asked(team, f"/?{inside}")[0],
        "signed out": asked(team, "/sign-out", "POST", Cookie=inside)[0],
        "replayed": asked(team, Cookie=inside)[0],
        "replayed to a WebSocket": handshake(team, Cookie=inside),
        "signing out from another site": asked(team, "/sign-out", "POST", Origin="http://evil.example")[0],
    }
    print(f"sessions: {met}")
    assert fixed != inside
    assert list(met.values())[:3] == [303, 303, 200]
    assert met["in the address"] == 303
    assert (met["replayed"], met["replayed to a WebSocket"]) == (303, 403)
    assert met["signing out from another site"] == 403


def test_strangers_cannot_upload_or_hold_the_server(team):
    """Twenty uploads of all that a user may send, from nobody: refused before a byte of them is taken."""
    here = urlsplit(team.address)
    head = f"POST /_nicegui/client/x/upload/1 HTTP/1.1\r\nHost: {here.netloc}\r\nContent-Length: 100000000\r\n\r\n"
    met, taken = [], []
    with contextlib.ExitStack() as stack:
        connect = partial(socket.create_connection, (here.hostname, here.port), ANSWER_S)
        sockets = [stack.enter_context(connect()) for _ in range(20)]
        for one in sockets:
            one.sendall(head.encode() + b"x" * 10_000)
        for one in sockets:
            met.append(int(one.recv(4000).split()[1]))
        for _ in range(20):
            begin = time.monotonic()
            assert asked(team, "/sign-in")[0] == 200
            taken.append(time.monotonic() - begin)
    print(f"twenty uploads of nobody: {Counter(met)}; the form meanwhile: longest {max(taken):.3f} s")
    assert set(met) == {401}


@pytest.mark.slow
def test_guesses_at_speed_from_many_addresses(team):
    """32 at a time from 200 addresses: few are checked, and everybody else is answered and comes in. Last of the file:
    whoever comes after it waits."""
    met: Counter[int] = Counter()
    until = time.monotonic() + 3.0

    def guess(worker: int) -> None:
        number = worker
        while time.monotonic() < until:
            met[sign_in(team, "bob", f"guess {number}", at=f"127.0.{1 + number % 2}.{1 + number // 2 % 100}")[0]] += 1
            number += 32

    threads = [threading.Thread(target=guess, args=(worker,)) for worker in range(32)]
    for thread in threads:
        thread.start()
    taken, entered = [], 0
    while time.monotonic() < until:
        begin = time.monotonic()
        entered += asked(team, "/sign-in", at="127.9.0.1")[0] == 200
        taken.append(time.monotonic() - begin)
        time.sleep(0.1)
    begin = time.monotonic()
    other = sign_in(team, "ina", SECRET, at="127.9.0.2")[0]
    for thread in threads:
        thread.join()
    right = sign_in(team, "bob", SECRET, at="127.9.0.3")[0]
    print(
        f"guesses: {sum(met.values())} in 3 s from 200 addresses: {met[403]} checked, {met[429]} told to wait; "
        f"the form meanwhile: median {statistics.median(taken):.3f} s, longest {max(taken):.3f} s; "
        f"another account signs in: {other}; the right password of this one: {right}"
    )
    assert met[303] == 0
    assert met[403] <= 13  # five, and those that were waiting for their turn by then
    assert (other, right) == (303, 429)
    assert entered == len(taken)
    refused = [json.loads(line) for line in (team.folder / "audit.jsonl").read_text().splitlines()]
    assert sum(one["action"] == "refused" for one in refused) == met[403]
