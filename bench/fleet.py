"""Cost and completeness of a fleet: ``python -m bench.fleet speed | memory | study``.

Figures are ratios of one run, to reduce the influence of other load; studies/fleet.md has them.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import hashlib
import io
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from tests.support.fleets import BROKEN, DEADLY, broken

import vibrident
from bench.fleet_page import keep
from vibrident.base import parcel
from vibrident.base.process import Process
from vibrident.data.io import write_calibration
from vibrident.lab.fleet import LocalScheduler, Orders, RunRequest, run, worker
from vibrident.lab.fleet.batch import Done, fingerprints
from vibrident.lab.fleet.key import Fingerprint, fingerprint
from vibrident.lab.fleet.parts import load_arrow, write_part
from vibrident.lab.fleet.row import IDENTIFIED, Row, _row
from vibrident.lab.fleet.schedulers import Reply
from vibrident.physics.simulation import simulate, with_noise

_ROUNDS = 2  # repetitions of each timing, in turn
RECORDS = 21
SAMPLES = 2000


def main(arguments: list[str] | None = None) -> int:
    """Print the figures of one part as JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.fleet", description=__doc__)
    parser.add_argument("part", choices=("speed", "memory", "study", "coordinator"))
    parser.add_argument("--count", type=int, default=0, help="calibrations")
    options = parser.parse_args(arguments)
    parts: dict[str, Callable[[int], dict[str, Any]]] = {
        "speed": speed,
        "memory": memory,
        "study": study,
        "coordinator": coordinator,
    }
    figures = parts[options.part](options.count)
    print(json.dumps(figures, indent=1))
    if options.part != "coordinator":
        keep(options.part, figures)
    return 0


def calibrations(folder: Path, count: int, seed: int = 0) -> list[Path]:
    """Simulated accelerometers of two types, their gains scattered; all 21 × 2000 samples."""
    rng = np.random.default_rng([12, seed])
    frequencies = np.geomspace(160.0, 5000.0, RECORDS).tolist()
    clean = simulate("paper", frequencies_hz=frequencies, samples=SAMPLES, start="steady", seed=1)
    files = []
    for number in range(count):
        gain = 1 + 0.01 * rng.standard_normal()
        noisy = with_noise(clean, response_noise=0.01, seed=seed + number)
        records = tuple(
            dataclasses.replace(record, response=gain * record.response) for record in noisy.records
        )
        sensor = {"type": "A-100" if number % 2 else "B-200", "serial_number": f"SN{number:05d}"}
        calibration = dataclasses.replace(noisy, records=records, sensor=sensor)
        files.append(write_calibration(folder / f"s{number:05d}", calibration))
    return files


def speed(count: int) -> dict[str, Any]:
    """Measure the cost of a fleet over identify_many, and the gain of two workers.

    The cost is measured calibration by calibration, plain and as a worker has it, in turn: other
    load affects both equally. What the coordinator needs is the part ``memory``'s. Two workers are
    compared with one, and beside it two processes that know nothing of each other with one: no
    scheduler gains more than these on the same machine. Times of workers are from the first begin
    to the last end, without start and page, which do not grow with the fleet; the least of some
    rounds, because other load only adds to them.
    """
    wanted = count or 16
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = calibrations(folder / "data", wanted)
        plain, fleet, results = _costs(files, folder)
        data = list(files[0].parent.iterdir())
        size = sum(file.stat().st_size for file in data)
        sizes_bytes = [file.stat().st_size for file in (folder / "results").iterdir()]
        wall = [[_wall(folder, workers) for workers in (1, 2)] for _ in range(_ROUNDS)]
        plainly = [[_plainly(files, processes) for processes in (1, 2)] for _ in range(_ROUNDS)]
        busy = np.median([[share for share, _ in pair] for pair in wall], axis=0)
    return {
        "calibrations": wanted,
        "seconds_of_a_calibration": plain,
        "bytes_of_a_calibration": size,
        "files_of_a_calibration": len(data),
        "bytes_of_a_result": float(np.mean(sizes_bytes)),
        "fleet_over_identify_many": fleet / plain,
        "fleet_with_results_over_identify_many": results / plain,
        "busy_share_of_one_worker": float(busy[0]),
        "busy_share_of_two_workers": float(busy[1]),
        "two_workers_over_one": min(one_worker[1] for one_worker, _ in wall)
        / min(two[1] for _, two in wall),
        "two_processes_over_one": min(one_process for one_process, _ in plainly)
        / min(two for _, two in plainly),
    }


def _costs(files: list[Path], folder: Path) -> tuple[float, float, float]:
    """Measure the processor's time for one: plain, with keys and row, with its whole result too."""
    (folder / "results").mkdir()
    without, with_results = (Orders(str(folder), results=wanted) for wanted in (False, True))
    used = np.zeros(3)
    for number, file in enumerate([files[0], *files]):
        ways = [
            lambda file=file: vibrident.identify(vibrident.read(file)),
            lambda file=file: _as_a_worker(str(file), without),
            lambda file=file: _as_a_worker(str(file), with_results),
        ]
        for way in (number % 3, (number + 1) % 3, (number + 2) % 3):
            begin = time.process_time()
            ways[way]()
            if number:  # the first one loads libraries
                used[way] += time.process_time() - begin
    plain, fleet, results = used / len(files)
    return float(plain), float(fleet), float(results)


def _as_a_worker(path: str, orders: Orders) -> None:
    key = fingerprint(path, orders).key
    (row,), _ = worker.identified([(path, key)], orders)
    assert row["status"] == IDENTIFIED
    parcel.send(io.BytesIO(), {"done": row})


def _wall(folder: Path, workers: int) -> tuple[float, float]:
    """Share of the time in which the workers were at work, and that time."""
    out = folder / f"{workers}"
    run(
        RunRequest([str(folder / "data")], Orders(str(out), results=False), fresh=True),
        LocalScheduler(workers),
    )
    tables = [
        pq.read_table(part_file, columns=["finished", "seconds"])
        for part_file in (out / "parts").glob("*.parquet")
    ]
    finished, seconds = (
        np.concatenate([table[name].to_numpy() for table in tables])
        for name in ("finished", "seconds")
    )
    elapsed = float(finished.max() - (finished - seconds).min())
    return float(seconds.sum()) / (workers * elapsed), elapsed


def _plainly(files: list[Path], processes: int) -> float:
    """Seconds of so many processes that share the files, and nothing else."""
    from bench.fleet import in_turn  # where another process finds it; here it is a part of __main__

    shares = [[str(file) for file in files[number::processes]] for number in range(processes)]
    with contextlib.ExitStack() as open_, ThreadPoolExecutor(processes) as pool:
        started = [open_.enter_context(Process()) for _ in shares]
        list(pool.map(lambda process: process.call(in_turn, shares[0][:1]), started))
        begin = time.perf_counter()
        list(pool.map(lambda process, share: process.call(in_turn, share), started, shares))
        return time.perf_counter() - begin


def in_turn(files: list[str]) -> int:
    """Read and identify calibrations; return how many."""
    return sum(1 for _ in vibrident.identify_many(files))


def memory(count: int) -> dict[str, Any]:
    """Measure the most memory of the coordinator, with 1 000 and with 100 000 simulated rows."""
    figures_by_rows = {}
    for rows in (1000, count or 100_000):
        command = [sys.executable, "-m", "bench.fleet", "coordinator", "--count", str(rows)]
        # As the command has it; read by an import.
        environment = {**os.environ, "ARROW_DEFAULT_MEMORY_POOL": "system"}
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
        figures_by_rows[rows] = json.loads(done.stdout)
    few, many = figures_by_rows.values()
    return {
        "rows": figures_by_rows,
        "memory_ratio": many["most_mb"] / few["most_mb"],
        "bytes_a_row": 1e6 * (many["most_mb"] - few["most_mb"]) / (many["rows"] - few["rows"]),
    }


def coordinator(count: int) -> dict[str, Any]:
    """Run with workers that do nothing but write rows.

    The folder walk, the batches, table and page are the real ones.
    """
    load_arrow()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number in range(count):
            if number % 1000 == 0:
                (folder / "data" / f"{number // 1000:04d}").mkdir(parents=True)
            (
                folder
                / "data"
                / f"{number // 1000:04d}"
                / f"calibration-of-sensor-{number:07d}.toml"
            ).touch()
        begin = time.perf_counter()
        begin_cpu = time.process_time()
        outcome = run(
            RunRequest([str(folder / "data")], Orders(str(folder / "out"), results=False)),
            _Simulated(),
        )
        cpu = time.process_time() - begin_cpu
        elapsed = time.perf_counter() - begin
        sizes = {path.name: path.stat().st_size for path in outcome.files}
        parts = sum(path.stat().st_size for path in (folder / "out/parts").iterdir())
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1024 if sys.platform != "darwin" else 1
    )
    return {
        "rows": outcome.tally.rows,
        "most_mb": most / 1e6,
        "seconds": elapsed,
        "milliseconds_a_row": 1e3 * cpu / outcome.tally.rows,
        "bytes_a_row_in_parts": parts / outcome.tally.rows,
        "files_bytes": sizes,
    }


class _Simulated:
    """Scheduler whose work is simulated: a quarter of a second a calibration, in name."""

    def __init__(self) -> None:
        self._replies: list[Reply] = []
        self._calls = 0

    def workers(self) -> int:
        return 64

    def submit(self, function: Callable[..., Any], *args: Any) -> int:
        self._calls += 1
        value = self._fingerprinted(args[0]) if function is fingerprints else self._worked(*args)
        self._replies.append(Reply(self._calls, value))
        return self._calls

    def next_reply(self, seconds: float) -> Reply | None:
        return self._replies.pop(0)

    def close(self, run_: str) -> None:
        pass

    @staticmethod
    def _fingerprinted(paths: list[str]) -> list[Fingerprint]:
        return [
            Fingerprint(hashlib.sha256(path.encode()).hexdigest(), "sine .csv 21 21")
            for path in paths
        ]

    @staticmethod
    def _worked(tasks: list[tuple[str, str]], orders: Orders) -> Done:
        rows = [_simulated_row(key) for _, key in tasks]
        part_file = write_part(orders.parts_folder, rows, orders.time_limit_s, None)
        return Done(part_file, {IDENTIFIED: len(rows)}, 0.25 * len(rows), {})


def _simulated_row(key: str) -> Row:
    rng = np.random.default_rng(int(key[:12], 16))
    gain, natural, damping, delay = 1 + 0.01 * rng.standard_normal(4)
    parameters = {
        "sensitivity": [0.01 * gain, 1e-5, "V/(m/s^2)"],
        "natural_frequency": [5000 * natural, 1.0, "Hz"],
        "damping_ratio": [0.02 * damping, 1e-4, "1"],
        "delay": [1e-6 * delay, 1e-8, "s"],
        "natural_angular_frequency": [31416 * natural, 6.0, "rad/s"],
        "resonance_frequency": [5000 * natural, 1.0, "Hz"],
        "conversion_coefficient": [1e7 * gain, 1e4, "1"],
    }
    identified = _row(
        key, IDENTIFIED, "", {"type": f"A-{int(key[:2], 16) % 4}", "serial_number": key[:10]}, 0.25
    )
    more = {
        "model": "accelerometer+delay",
        "estimator": "ml",
        "parameters": parameters,
        "adequate": True,
    }
    return {
        **identified,
        **more,
        "chi2_reduced": 1.0,
        "warnings": ["lack_of_fit"] if key[2] == "0" else [],
    }


def study(count: int) -> dict[str, Any]:
    """Run calibrations of which some are broken, with a command that is killed three times.

    One in twenty is broken, and two kill their process.
    """
    wanted = count or 200
    rng = random.Random(3)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spoilt = _spoilt(folder / "data", wanted)
        calibrations(folder / "data" / "good", wanted - spoilt)
        (folder / "site").mkdir()
        (folder / "site/sitecustomize.py").write_text(DEADLY)
        paths = os.pathsep.join([str(folder / "site"), os.environ.get("PYTHONPATH", "")])
        command = [
            sys.executable,
            "-c",
            "from vibrident.app.cli import main; main()",
            "fleet",
            str(folder / "data"),
        ]
        command += ["--out", str(folder / "out"), "--workers", "2", "-q"]
        environment = {**os.environ, "PYTHONPATH": paths}
        there = []
        for _ in range(3):
            before = len(list((folder / "out/parts").glob("*.parquet")))
            process = subprocess.Popen(command, env=environment)
            while (
                len(list((folder / "out/parts").glob("*.parquet"))) == before
                and process.poll() is None
            ):
                time.sleep(0.1)
            time.sleep(rng.uniform(0.0, wanted / 20))
            process.send_signal(signal.SIGKILL)
            process.wait()
            there.append(sum(1 for _ in _rows(folder / "out/parts")))
        code = subprocess.run(command, env=environment, check=False).returncode
        rows = pq.read_table(folder / "out/fleet.parquet").to_pylist()
        computed = list(_rows(folder / "out/parts"))
    statuses = {
        status: sum(row["status"] == status for row in rows)
        for status in ("identified", "refused", "failed")
    }
    return {
        "calibrations": wanted,
        "exit_code": code,
        "rows": len(rows),
        "names_that_differ": len({row["calibration"] for row in rows}),
        "rows_after_each_kill": there,
        "computed_twice": len(computed) - len(set(computed)),
        "failures": [" ".join(row["message"].split()) for row in rows if row["status"] == "failed"],
        **statuses,
    }


def _spoilt(folder: Path, wanted: int) -> int:
    """Return broken ones in each way, one in twenty, and two that kill their process."""
    count = max(wanted // 20 - 2, len(BROKEN)) // len(BROKEN)
    for number in range(count):
        broken(folder / f"broken{number}")
    for number, way in enumerate(("segfault", "exits"), start=1):
        file = calibrations(folder / way, 1, seed=1_000_000 * number)[0]
        (file.parent / way).touch()
    return count * len(BROKEN) + 2


def _rows(parts: Path) -> Iterator[str]:
    for path in parts.glob("*.parquet"):
        yield from pq.read_table(path, columns=["key"])["key"].to_pylist()


if __name__ == "__main__":
    sys.exit(main())
