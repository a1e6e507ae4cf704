"""Eight people identify at once: everybody else is still answered."""

from __future__ import annotations

import http.client
import multiprocessing
from urllib.parse import urlsplit

import pytest
from tests.support.serving import simulated, upload

WAIT_MS = 300_000
FITS = 8
#: Answers before the first fit is done. A server that computes itself gives one at most: that which it was giving.
MIN_ANSWERS = 10


def ask_until_over(address: str, answers, over) -> None:
    """Ask for the page again and again, and count the answers. In a process that does nothing else."""
    host = urlsplit(address)
    while not over.wait(0.05):
        connection = http.client.HTTPConnection(host.hostname or "", host.port, timeout=WAIT_MS / 1000)
        connection.request("GET", "/")
        assert connection.getresponse().read()
        connection.close()
        answers.value += 1


@pytest.mark.slow
def test_eight_fits_at_once_leave_the_page_answering(visit, server, tmp_path):
    made = simulated(tmp_path / "made")
    pages = [visit(may_complain=True) for _ in range(FITS)]
    for page in pages:
        upload(page, *made)
        page.locator("#confirm").click(timeout=WAIT_MS)
        page.locator("#start").wait_for(timeout=WAIT_MS)
    processes = multiprocessing.get_context("spawn")
    answers, over = processes.Value("i", 0), processes.Event()
    asking = processes.Process(target=ask_until_over, args=(server.address, answers, over))
    asking.start()
    while asking.is_alive() and not answers.value:  # it loads first
        pages[0].wait_for_timeout(50)
    begun = answers.value
    for page in pages:
        page.locator("#start").click()
    counts = []  # of answers, when each of the fits is seen to be done
    for page in pages:
        page.get_by_text("Identified.").wait_for(timeout=WAIT_MS)
        counts.append(answers.value - begun)
    over.set()
    asking.join()
    print(f"{counts[0]} answers before the first fit was done, {counts[-1]} before the last")
    assert asking.exitcode == 0
    assert counts[0] >= MIN_ANSWERS
