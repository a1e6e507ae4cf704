"""Peak memory of ``identify`` beyond the data, a sample: each in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from pathlib import Path

from bench.figures import Figure, Options, Section, steps
from bench.speed import broad, noisy
from bench.truth import RATE_HZ, RESPONSE_NOISE, SENSOR
from vibrident import Calibration, identify
from vibrident.base.memory import return_freed
from vibrident.physics.simulation import simulate, with_noise

TARGET = 120.0
LONG_SAMPLES = 1_600_000
CASES = {
    "sines": "21 × 16 000 samples of sines",
    "random": "21 × 16 000 samples of random motion",
    "long": "1.6 million samples of random motion in one record",
}
POLL_INTERVAL_S = 0.001  # seconds between two looks at the resident memory


def measure(options: Options) -> Section:
    """Measure each case in a process of its own."""
    del options
    figures = []
    for name, words in steps("memory", list(CASES.items())):
        done = subprocess.run(
            [sys.executable, "-m", "bench.memory", name],
            capture_output=True,
            text=True,
            check=False,
        )
        peak_bytes = json.loads(done.stdout) if done.returncode == 0 else None
        note = (
            ""
            if peak_bytes is not None
            else (done.stderr.strip().splitlines() or ["no message"])[-1]
        )
        figures.append(
            Figure(
                words,
                {} if peak_bytes is None else {"bytes": peak_bytes},
                "bytes",
                high=TARGET,
                note=note,
            )
        )
    remarks = (
        "Largest resident memory during identify less that before it, which holds the data, over "
        "all samples.",
    )
    return Section(
        "memory", "Peak memory beyond the data, bytes a sample", tuple(figures), {}, remarks
    )


def calibration(name: str) -> Calibration:
    """Return the data of a case."""
    if name == "sines":
        return noisy()
    if name == "random":
        return broad("random")
    truth = simulate(
        SENSOR,
        "random",
        sampling_rate_hz=RATE_HZ,
        samples=LONG_SAMPLES,
        frequencies_hz=[10.0, 4000.0],
        seed=3,
    )
    return with_noise(truth, response_noise=RESPONSE_NOISE, seed=2)


def bytes_a_sample(name: str) -> float:
    """Peak beyond what was resident before."""
    identify(noisy(2000))  # what is loaded and kept for all is no memory of these data
    data = calibration(name)
    return_freed()
    before = _resident()
    peak = [0]
    over = threading.Event()

    def watch() -> None:
        while not over.is_set():
            peak[0] = max(peak[0], _resident())
            time.sleep(POLL_INTERVAL_S)

    watcher = threading.Thread(target=watch)
    watcher.start()
    identify(data)
    over.set()
    watcher.join()
    return (peak[0] - before) / sum(record.samples for record in data.records)


def _resident() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096


if __name__ == "__main__":
    print(json.dumps(bytes_a_sample(sys.argv[1])))
