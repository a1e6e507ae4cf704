"""However large or strange a file is, nothing holds up the server's loop, on which all its users wait."""

from __future__ import annotations

import json
import sys
import urllib.request
from pathlib import Path

import pytest
from tests.support.serving import serving, upload

WAIT_MS = 120_000
MOST_STALL_S = 0.050
#: ``vibrident serve`` with a clock in its loop. A stall is what passed between two ticks that should be a millisecond
#: apart, and no more than the process computed meanwhile: other processes may have the processor.
_SERVER = """
import asyncio, json, sys, time
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


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("stall"), sys.executable, "-c", _SERVER) as made:
        yield made


def worst_stall_s(address: str) -> float:
    with urllib.request.urlopen(f"{address}stall", timeout=20) as answer:
        return json.load(answer)


def large_json(folder: Path) -> Path:
    (place := folder / "result.json").write_text(
        json.dumps({"schema": "vibrident.result/1", "x": [[0.5] * 9] * 250_000})
    )
    assert place.stat().st_size > 10_000_000
    return place


def large_toml(folder: Path) -> Path:
    entries = "".join(f'[[records]]\nfile = "{i}.csv"\nexcitation = "sine"\n' for i in range(40_000))
    (place := folder / "calibration.toml").write_text("[reference]\ncolumn = 2\n[response]\ncolumn = 3\n" + entries)
    assert place.stat().st_size > 1_800_000
    return place


def large_csv(folder: Path) -> Path:
    (place := folder / "a.csv").write_text("time,reference,response\n" + "0.001,1.25,-0.75\n" * 2_000_000)
    assert place.stat().st_size > 30_000_000
    return place


def wide_csv(folder: Path) -> Path:
    names = [f"channel {i}" for i in range(9_000)]
    rows = "\n".join(",".join(f"{i}.{j % 10}" for j in range(len(names))) for i in range(20))
    (place := folder / "wide.csv").write_text(",".join(names) + "\n" + rows + "\n")
    return place


@pytest.mark.parametrize("make", [large_json, large_toml, large_csv, wide_csv])
@pytest.mark.quick("large_json", "large_toml")
def test_nothing_holds_up_the_loop(server, visit, tmp_path, make):
    page = visit(may_complain=True)
    page.get_by_role("button", name="Start anew").click()
    worst_stall_s(server.address)
    upload(page, make(tmp_path))
    page.locator("#confirm, [role=alert]").first.wait_for(timeout=WAIT_MS)
    shown = page.locator("#columns .js-plotly-plot, [role=alert], #calibration-came").first
    shown.wait_for(timeout=WAIT_MS)
    assert 0.0 < worst_stall_s(server.address) < MOST_STALL_S
