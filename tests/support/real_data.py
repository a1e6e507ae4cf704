"""Find the real calibration data, which are not part of the repository, and lay calibration files beside them."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration
from vibrident.result import Result

_CALIBRATIONS = Path(__file__).parents[1] / "calibrations"
_BESIDE_CHECKOUT = Path(__file__).resolve().parents[3] / "shared" / "data"
SINE_TABLE = "sinusoidal_calibration_with_uncertainties.csv"


def real_data(name: str) -> Path:
    """Return the folder or file of that name; skip the test where the data are not there."""
    root = Path(os.environ.get("VIBRIDENT_DATA") or _BESIDE_CHECKOUT)
    if not (root / name).exists():
        pytest.skip(f"no real data {name!r} in {root}; set VIBRIDENT_DATA to the folder that holds it")
    return root / name


def calibration_beside_data(toml_name: str, data_name: str, tmp_path: Path) -> Path:
    """Copy a calibration file of tests/calibrations into tmp_path, link the data beside it; return its path.

    For "ptb-shock" the table of sine points with its stated uncertainties is made there too.
    """
    folder = real_data(data_name)
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    if data_name == "ptb-shock":
        _write_sine_table(folder / "sinusoidal_calibration_values.txt", tmp_path / SINE_TABLE)
    return Path(shutil.copy(_CALIBRATIONS / toml_name, tmp_path / toml_name))


def seismometer(pickup: str, tmp_path: Path, step: int = 2) -> Calibration:
    """The seismometer's sines by a pickup, "laser" or "coil": of the 17 steps, every second from 0.2 Hz, or all."""
    calibration = vibrident.read(calibration_beside_data(f"sm3-{pickup}.toml", "sm3", tmp_path))
    return replace(calibration, records=calibration.records[step - 1 :: step])


def seismometer_once(pickup: str, folders: pytest.TempPathFactory, step: int = 2) -> Result:
    """Return what is identified from these sines by the defaults.

    The first test that asks identifies; the others of this run, in whatever process, load its result.json.
    """
    base = folders.getbasetemp()
    folder_of_run = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    document = folder_of_run / f"identified-{pickup}-{step}.json"
    if not document.exists():
        folder = folders.mktemp("identified")
        written = vibrident.identify(seismometer(pickup, folder, step)).save(folder / "result.json")
        written.replace(document)
    return Result.load(document)


def _write_sine_table(source: Path, target: Path) -> None:
    """Add the standard uncertainties that the data's README states by band; the phase is in degrees."""
    frequency_hz, magnitude, phase_deg = np.loadtxt(source, unpack=True)
    relative = np.select(
        [frequency_hz <= 5e3, frequency_hz <= 10e3, frequency_hz <= 15e3],
        [0.5e-2, 0.15e-2, 0.25e-2],
        default=0.5e-2,
    )
    u_phase_deg = np.where(frequency_hz <= 5e3, 0.25, 0.5)
    columns = np.column_stack([frequency_hz, magnitude, phase_deg, relative * magnitude, u_phase_deg])
    header = "frequency_hz,magnitude,phase_deg,magnitude_uncertainty,phase_uncertainty_deg"
    np.savetxt(target, columns, fmt="%.17g", delimiter=",", header=header, comments="")
