"""On a team's page one account hands a draft in, another reviews and issues it; a killed server loses nothing."""

from __future__ import annotations

import json
import signal
import socket
from pathlib import Path

import pytest
from tests.support.lives import certifiable
from tests.support.serving import VIBRIDENT, WAIT_MS, serving, upload
from tests.support.signing import PHRASE, key_file

from vibrident.lab.issue.verification import verify

pytest.importorskip("argon2")

from vibrident.app.workflow.accounts import add_account

SECRET = "correct horse"


@pytest.fixture
def start(tmp_path):
    """Return what starts the server of a team in one folder, again and again."""
    for name, role in (("alice", "approve"), ("bob", "approve"), ("eve", "look")):
        add_account(tmp_path / "accounts", name, role, SECRET)
    (tmp_path / "phrase").write_text(PHRASE)
    options = {
        "--auth": tmp_path / "accounts",
        "--audit": tmp_path / "audit.jsonl",
        "--store": tmp_path / "h.db",
        "--key": key_file(tmp_path),
        "--passphrase-file": tmp_path / "phrase",
    }
    words = [str(word) for pair in options.items() for word in pair]

    def begin(ending: int = signal.SIGTERM):
        with socket.socket() as probe:  # the usual port may be another server's when this one is killed
            probe.bind(("127.0.0.1", 0))
            port = str(probe.getsockname()[1])
        return serving(tmp_path, *VIBRIDENT, "serve", "--port", port, *words, ending=ending)

    return begin


def signed_in(browser, server, name: str):
    page = browser.new_context(accept_downloads=True, reduced_motion="reduce").new_page()
    page.goto(server.address, timeout=WAIT_MS)
    page.get_by_label("Name").fill(name, timeout=WAIT_MS)
    page.get_by_label("Password").fill(SECRET)
    page.keyboard.press("Enter")
    page.get_by_role("heading", name="Data").wait_for(timeout=WAIT_MS)
    return page


def press(page, name: str) -> None:
    button = page.get_by_role("button", name=name)
    button.wait_for(timeout=WAIT_MS)
    button.focus()
    page.keyboard.press("Enter")


def said(page, words: str) -> None:
    page.get_by_text(words).wait_for(timeout=WAIT_MS)


def test_from_a_draft_to_a_signed_certificate(browser, start, tmp_path, sound):
    result = certifiable().save(tmp_path / "result.json")
    with start(signal.SIGKILL) as server:
        page = signed_in(browser, server, "alice")
        upload(page, result)
        press(page, "Hand in for review")
        said(page, "Draft 1 waits for a review by another account.")
        said(page, "Another account reviews what you handed in.")
        assert page.get_by_role("button", name="Accept draft 1").count() == 0
        eve = signed_in(browser, server, "eve")
        said(eve, "Handed in by alice")
        assert eve.get_by_role("button", name="Accept draft 1").count() == 0
        page = signed_in(browser, server, "bob")
        said(page, "Handed in by alice")
        assert page.get_by_role("button", name="Issue and sign").count() == 0
        sound(page, "draft")
        press(page, "Accept draft 1")
        said(page, "reviewed by bob.")
    with start() as server:
        page = signed_in(browser, server, "bob")
        said(page, "reviewed by bob.")
        press(page, "Issue and sign draft 1")
        said(page, "issued by bob")
        sound(page, "issued")
        for label in ("Certificate (PDF)", "DCC"):
            with page.expect_download(timeout=WAIT_MS) as waiting:
                press(page, f"{label}, Certificate")
            file = tmp_path / waiting.value.suggested_filename
            waiting.value.save_as(file)
            assert verify(Path(file), tmp_path / "key.pem").trusted
    done = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
    noted = [(row["account"], row["action"]) for row in done if "draft" in row]
    assert noted == [("alice", "handed in"), ("bob", "reviewed"), ("bob", "issued")]
