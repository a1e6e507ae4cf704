"""Snapshot of all that the program says of twenty-five calibrations, to compare commits.

    python -m bench.snapshot before        # on one commit
    python -m bench.snapshot after         # on the other
    diff -r before after                   # empty: a refactoring that changed no number and no file

All kinds of excitation, a table, a decay, a joint fit, raw light, a cubic spring; real records
where there are any (``VIBRIDENT_DATA``). It knows the command line alone, so it runs on commits
whose modules lie elsewhere (``PYTHONPATH=/that/checkout/src python -m bench.snapshot before``).
Clocks stand still meanwhile.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import io
import json
import os
import re
import runpy
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import time_machine

ROOT = Path(__file__).resolve().parents[1]
NOISE = ("--response-noise", "0.01")
#: Formats and what they need beside a result.
EXPORTS = {
    "c": ("--rate", "51200"),
    "csv": (),
    "dcc": ("--country", "DE"),
    "fmu": ("--rate", "51200"),
    "sacpz": ("--channel", "XX.STA.00.HHZ"),
    "stationxml": ("--channel", "XX.STA.00.HHZ"),
}
TABLE = """[sensor]
model = "accelerometer"
[table]
file = "table.csv"
frequency = 1
magnitude = 2
phase = 3
magnitude_uncertainty = 4
phase_uncertainty = 5
"""


DECAY = """[sensor]
model = "accelerometer"
[response]
column = 1
[sampling]
rate_hz = 2000.0
[[records]]
file = "decay.csv"
excitation = "decay"
"""
CERTIFICATE = """
[certificate]
number = "2026-1"
laboratory = "Laboratory"
customer = "Customer"
date_of_calibration = 2026-01-01
approved_by = "A. B."
"""


@dataclass(frozen=True)
class Case:
    """A simulated calibration, and how it is identified.

    Attributes:
        simulated: arguments of `simulate`.
        identified: arguments of `identify`.
        uses: also predict, correct, compare, plan.
    """

    name: str
    simulated: tuple[str, ...]
    identified: tuple[str, ...] = ()
    uses: bool = False


def _simulation(sensor: str, excitation: str, *more: str) -> tuple[str, ...]:
    return ("--sensor", sensor, "--excitation", excitation, *more)


CASES = (
    Case("sine", _simulation("paper", "sine", "--samples", "4000", *NOISE), uses=True),
    Case(
        "sine-ml", _simulation("paper", "sine", "--samples", "4000", *NOISE), ("--estimator", "ml")
    ),
    Case(
        "sine-lsm",
        _simulation("paper", "sine", "--samples", "4000", *NOISE),
        ("--estimator", "lsm"),
    ),
    Case("multisine", _simulation("paper", "multisine", "--samples", "8000", *NOISE), uses=True),
    Case("sweep", _simulation("paper", "sweep", "--samples", "8000", *NOISE)),
    Case("random", _simulation("paper", "random", "--samples", "8000", *NOISE), uses=True),
    Case("shock", _simulation("paper", "shock", "--samples", "4000", *NOISE), uses=True),
    Case(
        "both-noises",
        _simulation("paper", "random", "--samples", "8000", "--reference-noise", "0.01", *NOISE),
    ),
    Case("inverted", _simulation("inverted", "sine", "--samples", "2000", *NOISE)),
    Case("piezo", _simulation("piezo", "sweep", "--samples", "8000", *NOISE)),
    Case(
        "geophone",
        _simulation("geophone", "random", "--samples", "8000", "--quantity", "velocity", *NOISE),
    ),
    Case("seismometer", _simulation("seismometer", "sine", "--samples", "4000", *NOISE)),
    Case(
        "displacement",
        _simulation("paper", "sine", "--samples", "4000", "--quantity", "displacement", *NOISE),
    ),
    Case(
        "two-mode",
        _simulation("two-mode", "random", "--samples", "8000", "--response-noise", "0.001"),
    ),
    Case(
        "wrong-model",
        _simulation("two-mode", "sine", "--samples", "4000", *NOISE),
        ("--model", "accelerometer"),
    ),
    Case(
        "cubic",
        _simulation(
            "cubic",
            "sine",
            "--samples",
            "2000",
            "--frequencies",
            "100:800",
            "--response-noise",
            "1e-4",
        ),
    ),
    Case(
        "euler-adam",
        _simulation("paper", "random", "--samples", "2000"),
        (
            "--estimator",
            "ipnn",
            "--discretisation",
            "euler",
            "--optimiser",
            "adam",
            "--steps",
            "60",
        ),
    ),
    Case(
        "light",
        _simulation(
            "paper",
            "sine",
            "--frequencies",
            "80:800",
            "--samples",
            "2000",
            "--interferometer",
            "quadrature",
        ),
    ),
    Case(
        "heterodyne",
        _simulation("paper", "shock", "--samples", "2000", "--interferometer", "heterodyne"),
    ),
)
#: Calibration files of the tests for measured data.
REAL = {"mpu9250": "mpu9250", "ptb-shock": "ptb-shock", "sm3-coil": "sm3"}


def main(arguments: list[str] | None = None) -> int:
    """Write the folder; returns 0."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.snapshot", description="All output, for `diff -r`."
    )
    parser.add_argument("folder", type=Path, help="made anew")
    parser.add_argument("--only", nargs="+", help="cases")
    options = parser.parse_args(arguments)
    shutil.rmtree(options.folder, ignore_errors=True)
    folder = options.folder.resolve()
    folder.mkdir(parents=True)
    os.environ["COLUMNS"] = "120"
    time.perf_counter = lambda: 0.0
    with time_machine.travel(datetime.datetime(2026, 1, 2, tzinfo=datetime.UTC), tick=False):
        _take_all(folder, options.only)
    return 0


def _take_all(folder: Path, only: list[str] | None) -> None:
    wanted = [case for case in CASES if not only or case.name in only]
    for case in wanted:
        _take(case, folder / case.name)
    if not only:
        _joint(folder)
        _table(folder)
        _decay(folder)
        _history(folder)
        for name, source in REAL.items():
            _real(name, source, folder / f"real-{name}")


def _take(case: Case, folder: Path) -> None:
    with _inside(folder):
        _run("simulate", "--out", "data", "--seed", "3", *case.simulated)
        _certify(Path("data/calibration.toml"))
        _run("inspect", "data/calibration.toml")
        _identify("data/calibration.toml", *case.identified)
        if case.uses:
            _run("predict", "result/result.json", "data/calibration.toml", "--out", "predicted")
            _run("correct", "result/result.json", "data/calibration.toml", "--out", "corrected")
            _run(
                "compare",
                "data/calibration.toml",
                "--truth",
                "data/truth.json",
                "--out",
                "compared",
            )
            _run("plan", "--from", "result/result.json", "--out", "planned")


def _certify(calibration: Path) -> None:
    """State what a certificate asks for."""
    text = calibration.read_text().replace("[sensor]\n", '[sensor]\nserial_number = "S_1"\n', 1)
    calibration.write_text(text + CERTIFICATE)


def _joint(folder: Path) -> None:
    with _inside(folder / "joint"):
        _run(
            "simulate",
            "--out",
            "a",
            "--seed",
            "4",
            *_simulation("paper", "sine", "--samples", "2000", *NOISE),
        )
        _run(
            "simulate",
            "--out",
            "b",
            "--seed",
            "5",
            *_simulation("paper", "random", "--samples", "4000", *NOISE),
        )
        _certify(Path("a/calibration.toml"))
        _identify("a/calibration.toml", "b/calibration.toml")


def _table(folder: Path) -> None:
    measured = json.loads((folder / "sine" / "result" / "result.json").read_text())["measured"]
    columns = (
        "frequency_hz",
        "magnitude",
        "phase_deg",
        "magnitude_uncertainty",
        "phase_deg_uncertainty",
    )
    rows = zip(*(measured[name] for name in columns), strict=True)
    with _inside(folder / "table"):
        Path("calibration.toml").write_text(TABLE)
        Path("table.csv").write_text(
            ",".join(columns) + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)
        )
        _identify("calibration.toml")


def _decay(folder: Path) -> None:
    time_s = np.arange(8000) / 2000.0
    moved = np.exp(-6.0 * time_s) * np.cos(200.0 * time_s) + 1e-4 * np.random.default_rng(3).normal(
        size=time_s.size
    )
    with _inside(folder / "decay"):
        Path("calibration.toml").write_text(DECAY)
        np.savetxt("decay.csv", moved)
        _identify("calibration.toml")


def _history(folder: Path) -> None:
    store = ("--store", "laboratory.db")
    results = [f"../{name}/result/result.json" for name in ("sine", "random", "shock")]
    with _inside(folder / "history"):
        _run("history", "add", *results, *store)
        _run("history", "list", *store)
        _run("history", "show", "S_1", "--format", "json", *store)
        _run("history", "export", "table.csv", *store)
        Path("laboratory.db").unlink()


def _real(name: str, source: str, folder: Path) -> None:
    data = Path(os.environ.get("VIBRIDENT_DATA", ROOT.parent / "shared" / "data")) / source
    if not data.is_dir():
        sys.stderr.write(f"no measured data: {name} is left out\n")
        return
    with _inside(folder):
        for file in data.iterdir():
            Path(file.name).symlink_to(file)
        shutil.copy(ROOT / "tests" / "calibrations" / f"{name}.toml", "calibration.toml")
        _identify("calibration.toml")
        for link in Path().iterdir():
            if link.is_symlink():
                link.unlink()


def _show_and_export() -> None:
    for form in ("md", "html", "pdf"):
        _run("report", "result/result.json", "--format", form, "--out", f"report-{form}")
    for form, more in EXPORTS.items():
        _run("export", "result/result.json", "--format", form, "--out", "exported", *more)
    for packed in Path("exported").glob("*.fmu"):  # its members state when they were packed
        shutil.unpack_archive(packed, packed.with_suffix(""), "zip")
        packed.unlink()
        # With an identifier drawn at random.
        description = packed.with_suffix("") / "modelDescription.xml"
        description.write_text(re.sub('guid="[^"]*"', "", description.read_text()))


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    folder.mkdir(parents=True)
    with contextlib.chdir(folder):
        yield


def _identify(*arguments: str) -> None:
    """Identify, show and export; a case that is refused would compare nothing."""
    if code := _run("identify", *arguments, "--out", "result"):
        raise SystemExit(
            f"{Path.cwd().name} is not identified (exit code {code}): see "
            f"{Path('printed.txt').resolve()}"
        )
    _show_and_export()


def _run(*arguments: str) -> object:
    """Run a command in this process; its output and exit code are kept."""
    sys.stderr.write(f"{Path.cwd().name}: vibrident {' '.join(arguments)}\n")
    with (
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as err,
    ):
        code = _exit_code(arguments)
    with Path("printed.txt").open("a") as log:
        printed = (out.getvalue() + err.getvalue()).replace(str(Path.cwd()), "HERE")
        log.write(f"$ vibrident {' '.join(arguments)}\n{printed}exit code {code}\n\n")
    return code


def _exit_code(arguments: Sequence[str]) -> object:
    before = sys.argv
    sys.argv = ["vibrident", *arguments]
    try:
        runpy.run_module("vibrident", run_name="__main__", alter_sys=False)
    except SystemExit as ended:
        return ended.code
    finally:
        sys.argv = before
    return 0


if __name__ == "__main__":
    sys.exit(main())
