"""Eight people identify at once: everybody else is still answered."""

from __future__ import annotations

import http.client
import multiprocessing
import statistics
import time
from multiprocessing.connection import Connection
from urllib.parse import urlsplit

import pytest
from tests.support.serving import simulated, upload

WAIT_MS = 300_000


def asked_until_told(address: str, told: Connection) -> None:
    """Ask for the page again and again; the seconds that each answer takes. In a process that does nothing else."""
    host, taken = urlsplit(address), list[float]()
    while not told.poll(0.05):
        begin = time.perf_counter()
        connection = http.client.HTTPConnection(host.hostname or "", host.port, timeout=120)
        connection.request("GET", "/")
        assert connection.getresponse().read()
        connection.close()
        taken.append(time.perf_counter() - begin)
    told.send(taken)


@pytest.mark.slow
@pytest.mark.alone
def test_eight_fits_at_once_leave_the_page_answering(visit, server, tmp_path):
    made = simulated(tmp_path / "made")
    pages = [visit(may_complain=True) for _ in range(8)]
    for page in pages:
        upload(page, *made)
        page.locator("#confirm").click(timeout=WAIT_MS)
        page.locator("#start").wait_for(timeout=WAIT_MS)
    ours, theirs = multiprocessing.Pipe()
    asking = multiprocessing.get_context("spawn").Process(target=asked_until_told, args=(server.address, theirs))
    asking.start()
    for page in pages:
        page.locator("#start").click()
    for page in pages:
        page.get_by_text("Identified.").wait_for(timeout=WAIT_MS)
    ours.send("over")
    taken = ours.recv()
    asking.join()
    print(f"{len(taken)} answers: median {statistics.median(taken):.4f} s, longest {max(taken):.3f} s")
    assert statistics.median(taken) < 0.05
    assert max(taken) < 0.5
