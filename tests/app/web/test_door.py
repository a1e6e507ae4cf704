"""Who gets in to a team's page, and what is refused; the guard is asked as a server asks it."""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlencode

import pytest
from tests.support.serving import VIBRIDENT, alone

pytest.importorskip("argon2")

from vibrident.app.web.authentication import Authenticator, build_authenticator
from vibrident.app.web.guard import ACCOUNT, OWNER, Guard
from vibrident.app.web.users import Users
from vibrident.app.workflow import accounts
from vibrident.app.workflow.accounts import Accounts, add_account
from vibrident.base.errors import InputError

HOST = b"127.0.0.1:8080"
SECRET = "correct horse"


async def page(scope: Any, receive: Any, send: Any) -> None:
    """What is guarded: says who came."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        while (message := await receive())["type"] != "websocket.disconnect":
            await send({"type": "websocket.send", "text": message["text"]})
        return
    account = scope[ACCOUNT]
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})
    await send({"type": "http.response.body", "body": f"<script>{scope[OWNER]} {account and account.role}".encode()})


@pytest.fixture(scope="module", autouse=True)
def cheap():
    """A hash takes long, on purpose; here it takes what the algorithm needs at least."""
    from argon2 import PasswordHasher

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("argon2.PasswordHasher", partial(PasswordHasher, time_cost=1, memory_cost=8, parallelism=1))
        yield


@pytest.fixture(scope="module")
def hashed(tmp_path_factory):
    file = tmp_path_factory.mktemp("accounts") / "accounts"
    for name, role in (("eve", "look"), ("ina", "identify"), ("bob", "approve")):
        add_account(file, name, role, SECRET)
    return file


@pytest.fixture
def file(hashed, tmp_path):
    return Path(shutil.copy(hashed, tmp_path / "accounts"))


@pytest.fixture
def door(file, tmp_path):
    return Authenticator(Accounts(file), tmp_path / "audit.jsonl", tmp_path / "sessions.json")


def ask(
    door: Authenticator, path: str = "/", method: str = "GET", body: bytes = b"", at: str = "10.0.0.9", **headers: str
):
    """Status, headers and body of an answer."""
    said: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: dict[str, Any]) -> None:
        said.append(message)

    pairs = [(key.replace("_", "-").encode(), value.encode()) for key, value in headers.items()]
    scope = {"type": "http", "method": method, "path": path, "server": ("127.0.0.1", 8080), "client": (at, 1)}
    alone(Guard(page, 10_000, frozenset(), door)({**scope, "headers": [(b"host", HOST), *pairs]}, receive, send))
    return said[0]["status"], dict(said[0]["headers"]), said[1]["body"]


def sign_in(door: Authenticator, name: str, password: str = SECRET, **more: str):
    return ask(door, "/sign-in", "POST", urlencode({"name": name, "password": password}).encode(), **more)


def cookie(told: dict[bytes, bytes]) -> str:
    return told[b"set-cookie"].decode().partition(";")[0]


def test_nobody_comes_in_without_signing_in(door):
    status, told, _ = ask(door)
    assert (status, told[b"location"]) == (303, b"/sign-in")
    for path in ("/_nicegui/3/x.js", "/_nicegui_ws/socket.io/", "/sign-in/../x", "//", "/sign-out"):
        assert ask(door, path)[0] == 401
    status, told, text = ask(door, "/sign-in")
    assert status == 200
    assert b"default-src 'none'" in told[b"content-security-policy"]
    assert b"<form" in text


def test_who_signs_in_comes_in_until_signed_out_and_the_next_server_knows(door, file, tmp_path):
    status, told, _ = sign_in(door, "ina")
    assert (status, told[b"location"]) == (303, b"/")
    flags = told[b"set-cookie"].decode()
    assert "HttpOnly" in flags
    assert "samesite=lax" in flags.lower()
    inside = {"cookie": cookie(told)}
    status, told, text = ask(door, **inside)
    assert status == 200
    assert text.endswith(b">ina identify")
    assert f"'nonce-{text.decode().split(chr(34))[1]}'" in told[b"content-security-policy"].decode()

    token = inside["cookie"].partition("=")[2]
    assert token not in (tmp_path / "sessions.json").read_text()  # who reads it cannot come in
    again = Authenticator(Accounts(file), None, tmp_path / "sessions.json")
    assert ask(again, **inside)[0] == 200
    assert ask(door, "/sign-out", "POST", **inside)[0] == 303
    assert ask(door, **inside)[0] == 303
    done = [json.loads(line)["action"] for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
    assert done == ["signed in", "signed out"]


@pytest.mark.parametrize("forged", ["", "0" * 64, "vibrident-in-8080=", "vibrident-in-8080=" + "0" * 64, "=;;=;\x00"])
def test_a_made_up_session_is_none(door, forged):
    sign_in(door, "ina")
    assert ask(door, cookie=forged)[0] == 303


def test_a_session_ends_by_time_and_with_its_account(door, file, monkeypatch):
    inside = {"cookie": cookie(sign_in(door, "bob")[1])}
    lines = file.read_text().splitlines()
    file.write_text("\n".join(line.replace("bob:approve", "bob:look") for line in lines))
    assert ask(door, **inside)[2].endswith(b"bob look")  # a role holds at once
    file.write_text("\n".join(line for line in lines if not line.startswith("bob")))
    assert ask(door, **inside)[0] == 303
    inside = {"cookie": cookie(sign_in(door, "ina")[1])}
    later = time.time() + 13 * 3600
    monkeypatch.setattr(time, "time", lambda: later)
    assert ask(door, **inside)[0] == 303


def test_guesses_have_to_wait_longer_and_longer_and_tell_no_names(door, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(accounts, "time", SimpleNamespace(monotonic=lambda: now[0]))
    said = []
    for number in range(200):
        now[0] = 30.0 * number
        status, _, text = sign_in(door, "bob", f"guess {number}", at=f"10.0.0.{number}")
        said.append(status)
        if number == 0:
            other = sign_in(door, "nobody", "x", at="10.9.0.1")[2]
            assert other.partition(b"<main>")[2] == text.partition(b"<main>")[2]
        if said.count(403) > 12:
            break
    assert said[:5] == [403] * 5
    assert now[0] > 500.0  # thirteen guesses, from an address each
    assert sign_in(door, "bob")[0] == 429  # the right password waits too
    now[0] += 1000.0
    assert sign_in(door, "bob")[0] == 303


def test_websockets_end_with_their_session(door):
    inside = cookie(sign_in(door, "ina")[1])
    said: list[dict[str, Any]] = []
    coming = [{"type": "websocket.receive", "text": "one"}, {"type": "websocket.receive", "text": "two"}]

    async def receive() -> dict[str, Any]:
        if len(coming) == 1:
            door._sessions.clear()
        return coming.pop(0)

    async def send(message: dict[str, Any]) -> None:
        said.append(message)

    scope = {"type": "websocket", "path": "/_nicegui_ws/", "server": ("127.0.0.1", 8080), "client": ("::1", 1)}
    guard = Guard(page, 10_000, frozenset(), door)
    alone(guard({**scope, "headers": [(b"host", HOST), (b"cookie", inside.encode())]}, receive, send))
    assert [message.get("text") for message in said] == [None, "one"]
    said.clear()
    alone(guard({**scope, "headers": [(b"host", HOST)]}, receive, send))
    assert said == [{"type": "websocket.close", "code": 1008}]


def test_a_proxy_vouches_for_people_from_its_own_address_alone(file, tmp_path):
    for auth, role in ((None, "identify"), (file, "look")):
        made = build_authenticator(auth, "10.0.0.1", "X-User", None, tmp_path, loopback=False)
        assert made is not None
        assert ask(made, at="10.0.0.1", x_user="zoe")[2].endswith(f"zoe {role}".encode())
        assert ask(made, at="10.0.0.2", x_user="zoe")[0] == 403
        assert ask(made, at="10.0.0.2", x_user="zoe", x_forwarded_for="10.0.0.1")[0] == 403
        assert ask(made, at="10.0.0.1")[0] == 403
        assert ask(made, at="10.0.0.1", x_user="zoe\x07")[0] == 403
    assert ask(made, at="10.0.0.1", x_user="bob")[2].endswith(b"bob approve")


def test_behind_tls_the_cookie_is_for_tls_alone(file, tmp_path):
    made = build_authenticator(file, "10.0.0.1", None, None, tmp_path, loopback=False)
    assert made is not None
    assert b"Secure" in sign_in(made, "ina", at="10.0.0.1", x_forwarded_proto="https")[1][b"set-cookie"]
    assert b"Secure" not in sign_in(made, "ina", at="10.0.0.2", x_forwarded_proto="https")[1][b"set-cookie"]


@pytest.mark.parametrize(
    ("auth", "proxy", "header"), [(None, None, None), (None, "10.0.0.1", None), (None, None, "X-User")]
)
def test_an_open_address_needs_a_door(auth, proxy, header, tmp_path):
    with pytest.raises(InputError, match="without signing in"):
        build_authenticator(auth, proxy, header, None, tmp_path, loopback=False)


def test_the_command_refuses_in_one_message():
    command = [*VIBRIDENT, "serve", "--host", "0.0.0.0", "--no-browser"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "Others could use this page without signing in." in done.stderr
    assert done.stderr.startswith("Error: ")
    assert "Traceback" not in done.stderr


def test_an_account_is_made_from_a_shell(tmp_path):
    file = tmp_path / "accounts"
    command = [*VIBRIDENT, "serve", "--auth", str(file), "--add", "ada:approve"]
    for word, code in ((SECRET, 0), ("short", 2)):
        done = subprocess.run(command, input=f"{word}\n", capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == code
        assert "Traceback" not in done.stderr
    assert SECRET not in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o600
    ada = Accounts(file).check("ada", SECRET)
    assert ada is not None
    assert ada.role == "approve"


@pytest.mark.parametrize("text", ["bob", "bob:king:", "bob:look:plain text", "../x:look:", ":look:"])
def test_a_file_that_is_none_is_refused(tmp_path, text):
    (tmp_path / "accounts").write_text(text)
    with pytest.raises(InputError, match="line 1 is none"):
        Accounts(tmp_path / "accounts")
    (tmp_path / "accounts").chmod(0o666)
    with pytest.raises(InputError, match="others may write"):
        Accounts(tmp_path / "accounts")


def test_roles(door, tmp_path):
    everybody = Users(tmp_path, 1.0, door=door)
    may = {}
    for name in ("eve", "ina", "bob", "gone"):
        user = everybody.attach(SimpleNamespace(tab_id=name, has_socket_connection=False), name)
        may[name] = [user.may(role) for role in accounts.ROLES]
        if not may[name][1]:
            with pytest.raises(InputError, match="may not identify"):
                user.require("identify", "identify")
    assert may == {"eve": [True, False, False], "ina": [True, True, False], "bob": [True] * 3, "gone": [False] * 3}
