"""Waiting times: for the page, for a certificate, for answers from a thousand sensors.

Computing time, here and in the server: other programs may have the processor. The page is driven by
a browser (playwright's, or the one that VIBRIDENT_CHROMIUM names).
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from tests.support.databases import filled
from tests.support.exported import paper
from tests.support.serving import CHROMIUM_FLAGS, chromium, serving, upload

from bench.figures import Figure, Options, Section, steps

SENSORS = 1000
CALIBRATIONS = 10
MAX_STALL_S = 0.050
#: ``vibrident serve`` with a clock in its loop. A stall is what passed between two ticks that
#: should be a millisecond apart, and no more than the process computed meanwhile.
_SERVER = """
import asyncio, time
from nicegui import app
from vibrident.app.web.server import serve

worst = {"stall": 0.0}

async def watch():
    while True:
        passed, computed = time.perf_counter(), time.process_time()
        await asyncio.sleep(0.001)
        stall = min(time.perf_counter() - passed, time.process_time() - computed)
        worst["stall"] = max(worst["stall"], stall)

@app.get("/stall")
def stall():
    found = worst["stall"]
    worst["stall"] = 0.0
    return found

@app.on_startup
def begin():
    asyncio.create_task(watch())

serve(host="127.0.0.1", port=0, show=False, limit_mb=100.0)
"""


def measure(options: Options) -> Section:
    """Return each in turn."""
    del options
    sections = {"page": _page, "certificate": _certificate, "history": _history}
    figures = [figure for name, take in steps("waits", list(sections.items())) for figure in take()]
    return Section("waits", "What a person waits for, seconds of computing", tuple(figures))


def _page() -> list[Figure]:
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder), sys.executable, "-c", _SERVER) as server,
    ):
        start = Figure("the page answers", {"s": server.busy_s}, "seconds", high=3.0)
        files = (_large_json, _large_toml, _large_csv, _wide_csv)
        stalls = {}
        note = ""
        try:
            stalls = {make.__name__.strip("_"): _stall(server.address, make) for make in files}
        except Exception as error:  # no playwright, or no browser
            note = str(error).splitlines()[0]
        held = Figure(
            "longest hold-up of its loop by a file", stalls, "seconds", high=MAX_STALL_S, note=note
        )
        return [start, held]


def _stall(address: str, make: Callable[[Path], Path]) -> float:
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        running = started.chromium.launch(executable_path=chromium(), args=CHROMIUM_FLAGS)
        page = running.new_page()
        page.goto(address)
        page.locator("input[type=file]").first.wait_for(state="attached")
        _worst(address)
        upload(page, make(Path(folder)))
        page.locator("#confirm, [role=alert]").first.wait_for(timeout=120_000)
        page.locator("#columns .js-plotly-plot, [role=alert], #calibration-came").first.wait_for(
            timeout=120_000
        )
        running.close()
        return _worst(address)


def _worst(address: str) -> float:
    with urllib.request.urlopen(f"{address}stall", timeout=20) as answer:
        return json.load(answer)


def _large_json(folder: Path) -> Path:
    (path := folder / "result.json").write_text(
        json.dumps({"schema": "vibrident.result/1", "x": [[0.5] * 9] * 250_000})
    )
    return path


def _large_toml(folder: Path) -> Path:
    entries = "".join(
        f'[[records]]\nfile = "{i}.csv"\nexcitation = "sine"\n' for i in range(40_000)
    )
    (path := folder / "calibration.toml").write_text(
        "[reference]\ncolumn = 2\n[response]\ncolumn = 3\n" + entries
    )
    return path


def _large_csv(folder: Path) -> Path:
    (path := folder / "a.csv").write_text(
        "time,reference,response\n" + "0.001,1.25,-0.75\n" * 2_000_000
    )
    return path


def _wide_csv(folder: Path) -> Path:
    names = [f"channel {i}" for i in range(9_000)]
    rows = "\n".join(",".join(f"{i}.{j % 10}" for j in range(len(names))) for i in range(20))
    (path := folder / "wide.csv").write_text(",".join(names) + "\n" + rows + "\n")
    return path


def _certificate() -> list[Figure]:
    from vibrident.show import report

    report.content(paper(), "pdf")
    spent = _computing_s(partial(report.content, paper(), "pdf"), times=1)
    return [Figure("a certificate, not the first", {"s": spent}, "seconds", high=1.0)]


def _history() -> list[Figure]:
    from vibrident.lab.history import document, query
    from vibrident.lab.history.due import Tolerance
    from vibrident.lab.history.store import Store

    with tempfile.TemporaryDirectory() as folder:
        filled(url := str(Path(folder) / "h.db"), SENSORS, CALIBRATIONS)
        with Store(url) as store:
            sensor = query.find(store, "00500")
            requests: dict[str, Callable[[], Any]] = {
                "list": partial(query.overviews, store),
                "find": partial(query.find, store, "00500"),
                "all calibrations": partial(query.entries, store),
                "show": partial(
                    document.of_sensor,
                    store,
                    sensor,
                    document.Question(tolerance=lambda _: Tolerance(0.01)),
                ),
            }
            seconds = {name: _computing_s(ask) for name, ask in requests.items()}
    return [
        Figure(
            f"asked of {SENSORS} sensors, {CALIBRATIONS} calibrations each",
            seconds,
            "seconds",
            high=0.1,
        )
    ]


def _computing_s(act: Callable[[], Any], times: int = 5) -> float:
    act()  # what it loads is not counted
    begun = time.process_time()
    for _ in range(times):
        act()
    return (time.process_time() - begun) / times
