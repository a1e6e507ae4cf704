"""The page served by a process of its own, and a real browser where there is one."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from tests.support.contrast import too_faint
from tests.support.serving import CHROMIUM_FLAGS, VIBRIDENT, Server, chromium, serving
from tests.support.sources import ROOT

LIMIT_MB = 100
#: Pictures that the tests take, to be looked at.
PICTURES = ROOT / "out" / "page"


@pytest.fixture(scope="session")
def history_store(tmp_path_factory) -> str:
    """The history that the page shows."""
    return str(tmp_path_factory.mktemp("store") / "history.db")


@pytest.fixture(scope="session")
def server(tmp_path_factory, history_store) -> Iterator[Server]:
    """``vibrident serve`` on a free port, its temporary files in a folder of the tests."""
    command = (*VIBRIDENT, "serve", "--limit-mb", str(LIMIT_MB), "--store", history_store)
    with serving(tmp_path_factory.mktemp("serve"), *command) as made:
        yield made


@pytest.fixture(scope="session")
def browser():
    """Headless Chromium that asks the network for nothing of its own."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as started:
        try:
            running = started.chromium.launch(executable_path=chromium(), args=CHROMIUM_FLAGS)
        except playwright.Error as error:
            reason = str(error).splitlines()[0]
            pytest.skip(
                f"no Chromium ({reason}): install the system's, run playwright install chromium, or set "
                "VIBRIDENT_CHROMIUM"
            )
        yield running
        running.close()


@pytest.fixture(scope="session")
def window(browser):
    """One for all tests: it compiles the page's libraries once. Each tab is another user."""
    return browser.new_context(accept_downloads=True, reduced_motion="reduce")


@pytest.fixture
def visit(server, window):
    """Open the page in a tab of its own; every request that leaves the server's address fails the test."""
    tabs, foreign, complaints = [], [], []

    def open_page(width: int = 1280, height: int = 900, *, may_complain: bool = False):
        page = window.new_page()
        tabs.append(page)
        page.set_viewport_size({"width": width, "height": height})
        here = (server.address, server.address.replace("http", "ws"), "data:", "blob:")
        page.on("request", lambda request: None if request.url.startswith(here) else foreign.append(request.url))
        if not may_complain:
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
        page.goto(server.address)
        page.get_by_role("heading", name="Data").wait_for()
        return page

    yield open_page
    for page in tabs:
        page.close()
    assert not foreign
    assert not complaints


@pytest.fixture(scope="session")
def picture():
    """Take a picture of the whole page, where somebody wants to look at it."""

    def take(page, name: str) -> None:
        if os.environ.get("VIBRIDENT_PICTURES"):
            page.wait_for_timeout(800)  # charts are drawn in steps
            PICTURES.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=PICTURES / f"{name}.png", full_page=True)

    return take


@pytest.fixture(scope="session")
def looks(picture):
    """Show the page at 1280 and 390 px, light and dark, and take a picture of each."""

    def each(page, name: str) -> Iterator[str]:
        for width in (1280, 390):
            page.set_viewport_size({"width": width, "height": 844})
            for scheme in ("light", "dark"):
                page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
                picture(page, f"{name}-{scheme}-{width}")
                yield scheme

    return each


@pytest.fixture(scope="session")
def violations():
    """Return the rules that axe finds broken on a page, and where.

    Contrast is left to ``too_faint``, which reads every look, unless it is asked for: axe takes
    most of its time for it.
    """
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed").Axe()

    def broken_rules(page, *, contrast: bool = False) -> list[tuple[str, list[str]]]:
        options = {"resultTypes": ["violations"], "rules": {"color-contrast": {"enabled": contrast}}}
        if not page.evaluate("'axe' in window"):
            page.evaluate(axe.axe_script)
        broken = page.evaluate("options => axe.run(options).then(result => result.violations)", options)
        return [(rule["id"], [node["html"][:160] for node in rule["nodes"]]) for rule in broken]

    return broken_rules


@pytest.fixture(scope="session")
def sound(looks, violations):
    """In each look all text can be read and nothing is wider than the window; axe sees both widths and both schemes."""

    def check(page, name: str) -> None:
        for number, _ in enumerate(looks(page, name)):
            if number in (0, 3):
                assert violations(page) == []
            assert too_faint(page) == []
            page.wait_for_function("document.documentElement.scrollWidth <= window.innerWidth")  # charts are fitted
        page.set_viewport_size({"width": 1280, "height": 900})
        page.emulate_media(color_scheme="light", reduced_motion="reduce")

    return check


@pytest.fixture(scope="session")
def press():
    """Go to an element by the tabulator, from the heading of its section, and press Enter."""

    def go(page, wanted: str, section: str) -> None:
        page.locator(section).wait_for()
        page.locator(section).evaluate("section => { section.tabIndex = -1; section.focus(); }")
        for _ in range(60):
            page.keyboard.press("Tab")
            if page.evaluate("wanted => document.activeElement.closest(wanted) !== null", wanted):
                page.keyboard.press("Enter")
                return
        raise AssertionError(f"the tabulator does not reach {wanted}")

    return go
