"""A team's page in a real browser: signing in by keyboard, what each role may do, and the audit log."""

from __future__ import annotations

import json

import pytest
from tests.support.sample_results import table2
from tests.support.serving import VIBRIDENT, WAIT_MS, serving, upload

pytest.importorskip("argon2")

from vibrident.app.workflow.accounts import add_account

SECRET = "correct horse"
ROWS = "time,reference,response\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50))


@pytest.fixture(scope="module")
def team(tmp_path_factory):
    folder = tmp_path_factory.mktemp("team")
    for name, role in (("eve", "look"), ("bob", "approve")):
        add_account(folder / "accounts", name, role, SECRET)
    options = ("--auth", str(folder / "accounts"), "--audit", str(folder / "audit.jsonl"))
    with serving(folder, *VIBRIDENT, "serve", "--port", "0", *options) as made:
        yield made


def sign_in(page, team, name: str, password: str = SECRET) -> None:
    page.goto(team.address)
    page.get_by_label("Name").fill(name)
    page.keyboard.press("Tab")
    page.keyboard.type(password)
    page.keyboard.press("Enter")


def test_signing_in_by_keyboard(browser, team, looks, violations, sound):
    context = browser.new_context(reduced_motion="reduce")
    page = context.new_page()
    sign_in(page, team, "bob", "wrong")
    page.get_by_role("alert").wait_for()
    for number, _ in enumerate(looks(page, "sign-in")):
        if number in (0, 3):  # axe takes seconds: both widths and both schemes, each once
            assert violations(page, contrast=True) == []
    page.get_by_label("Name").wait_for()
    sign_in(page, team, "bob")
    page.get_by_text("No data yet.").wait_for(timeout=WAIT_MS)
    assert page.get_by_text("bob", exact=True).is_visible()
    sound(page, "signed-in")
    page.get_by_role("button", name="Sign out").press("Enter")
    page.get_by_label("Password").wait_for()
    page.goto(team.address)
    page.get_by_label("Password").wait_for()
    context.close()


@pytest.mark.slow
def test_a_role_that_looks_sees_results_and_identifies_nothing(browser, team, tmp_path):
    (tmp_path / "a.csv").write_text(ROWS)
    result = table2().save(tmp_path / "earlier.json")
    context = browser.new_context(accept_downloads=True)
    page = context.new_page()
    sign_in(page, team, "eve")
    page.get_by_text("No data yet.").wait_for(timeout=WAIT_MS)
    upload(page, tmp_path / "a.csv")
    page.get_by_text("Your account may not upload data.").wait_for(timeout=WAIT_MS)
    page.get_by_role("button", name="Load the simulated demo").click()
    page.get_by_text("Your account may not identify.").wait_for(timeout=WAIT_MS)
    upload(page, result)
    page.locator("#result .verdict").first.wait_for(timeout=WAIT_MS)
    with page.expect_download(timeout=WAIT_MS):
        page.locator("#get-md").click()
    context.close()
    done = [json.loads(line) for line in (team.folder / "audit.jsonl").read_text().splitlines()]
    (issued,) = [row for row in done if row["action"] == "issued"]
    assert (issued["account"], issued["document"][-3:], len(issued["sha256"])) == ("eve", ".md", 64)
