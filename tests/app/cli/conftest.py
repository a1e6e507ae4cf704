"""A small simulated calibration as files, its result, and the command line run in this process."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support import shell
from tests.support.shell import printed
from typer.testing import Result

Run = Callable[..., Result]
SMALL = ("--frequencies", "100,300,500,630,800", "--rate", "12800", "--samples", "2000", "--response-noise", "0.01")


@pytest.fixture(scope="session")
def run() -> Run:
    """Run ``vibrident`` with these arguments, in this process."""
    return shell.run


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> Path:
    """A folder with calibration.toml, five records and truth.json; do not change it."""
    folder = tmp_path_factory.mktemp("made") / "small"
    printed("simulate", "--out", folder, *SMALL, "--seed", 7)
    return folder


@pytest.fixture(scope="session")
def identified(made, tmp_path_factory) -> Path:
    """The result.json of that calibration; do not change it."""
    folder = tmp_path_factory.mktemp("identified") / "out"
    printed("identify", made / "calibration.toml", "--out", folder, "--no-pictures")
    return folder / "result.json"


@pytest.fixture
def calibration(made, tmp_path) -> Path:
    """A copy of the calibration file among its records, to be spoiled."""
    folder = tmp_path / "data"
    shutil.copytree(made, folder)
    return folder / "calibration.toml"
