"""Cold start: ``vibrident identify`` from the shell against ``import jax``, and its peak memory."""

from __future__ import annotations

import compileall
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import vibrident
from bench.figures import Figure, Options, Section, steps
from bench.pairs import Ratio
from bench.speed import noisy
from vibrident.data.io.writer import write_calibration

#: Targets over the time of ``import jax``: with pictures, without, and of the help.
START_TARGET = 4.0
PLAIN_TARGET = 2.2
HELP_TARGET = 0.4
MEMORY_TARGET = 700.0  # most memory, MB
IMPORT = [sys.executable, "-c", "import jax"]
LAUNCHER = [sys.executable, "-I", "-S", str(Path(__file__).with_name("child.py"))]


@dataclass(frozen=True)
class Child:
    """Time and memory of a command."""

    wall_s: float
    peak_mb: float


class CommandFailed(Exception):
    """The command failed; the message says how it ended."""


def measure(options: Options) -> Section:
    """Pairs of cold starts: later ones, and ones without a cache."""
    pairs = 2 if options.quick else max(3, options.pairs // 2)
    remarks = (
        "21 × 16 000 samples read from CSV files, estimator as chosen by the command (auto); "
        "every start is a process of its own; the files are in the page cache. Peak memory: "
        "ru_maxrss of the child.",
    )
    # As pip does when it installs a package.
    compileall.compile_dir(str(Path(vibrident.__file__).parent), quiet=2)
    with tempfile.TemporaryDirectory(prefix="vibrident-bench-") as folder:
        temporary = Path(folder)
        calibration = write_calibration(temporary / "records", noisy())
        try:
            figures = _starts(calibration, temporary, pairs)
        except (CommandFailed, OSError) as error:
            figures = [
                Figure("vibrident identify / import jax", {}, high=START_TARGET, note=str(error))
            ]
    return Section("cold", "Cold start, from the shell", tuple(figures), {"pairs": pairs}, remarks)


def _starts(calibration: Path, temporary: Path, pairs: int) -> list[Figure]:
    program = str(Path(sys.executable).with_name("vibrident"))
    identify = [program, "identify", str(calibration), "--out", str(temporary / "result")]

    def measured_pairs(
        name: str, command: list[str], cache: str = "cache"
    ) -> list[tuple[Child, Child]]:
        return [
            (run(command, {"VIBRIDENT_CACHE": str(temporary / cache.format(number))}), run(IMPORT))
            for number in steps(f"cold: {name}", range(pairs))
        ]

    run(identify), run(IMPORT)  # fills the page cache
    drawn = measured_pairs("identify", identify)
    first = measured_pairs("identify, first run", identify, "cache-{}")
    plain = measured_pairs("identify --no-pictures", [*identify, "--no-pictures"])
    helped = measured_pairs("--help", [program, "--help"])
    return [
        _ratio("identify, with pictures / import jax", drawn, START_TARGET),
        _ratio("identify, with pictures, without a cache / import jax", first, START_TARGET),
        _ratio("identify --no-pictures / import jax", plain, PLAIN_TARGET),
        _ratio("vibrident --help / import jax", helped, HELP_TARGET),
        _memory("peak memory of identify --no-pictures", plain),
    ]


def _ratio(what: str, pairs: list[tuple[Child, Child]], high: float) -> Figure:
    ratio = Ratio(tuple(a.wall_s for a, _ in pairs), tuple(b.wall_s for _, b in pairs))
    return Figure(what, {"ratio": ratio.median}, high=high, note=ratio.note)


def _memory(what: str, pairs: list[tuple[Child, Child]]) -> Figure:
    peak = max(a.peak_mb for a, _ in pairs)
    plain = max(b.peak_mb for _, b in pairs)
    note = f"{peak / plain:.2g} × that of import jax"
    return Figure(what, {"peak": peak}, "megabytes", high=MEMORY_TARGET, note=note)


def run(command: list[str], extra: dict[str, str] | None = None) -> Child:
    """Run a command through the launcher.

    Raises:
        CommandFailed: its exit status is not 0.
    """
    done = subprocess.run(
        [*LAUNCHER, *command],
        env={**os.environ, **(extra or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise CommandFailed(f"{Path(command[0]).name} could not be started: {_last(done.stderr)}")
    figures = json.loads(done.stdout)
    if figures["status"]:
        message = f"{Path(command[0]).name} {command[1]} ended with status {figures['status']}"
        raise CommandFailed(f"{message}: {_last(done.stderr)}")
    return Child(figures["wall_s"], figures["peak_bytes"] / 1e6)


def _last(text: str) -> str:
    lines = [line for line in text.strip().splitlines() if line.strip()]
    return lines[-1].strip() if lines else "no message"
