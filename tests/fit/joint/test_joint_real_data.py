"""Joint fits of measured calibrations of other people (data README)."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from tests.support.real_data import calibration_beside_data

import vibrident
from vibrident.data.records import Calibration
from vibrident.result import Result

#: Part of the peak above which the first lobe counts.
EDGE = 0.05
#: Motion of the seismometer's centre of mass over that of the laser's point (calcontrol.cal, lcalconst).
MASS_PER_LASER = 0.579
#: Reference fits of the data README, 0.3 to 3 Hz, with their formal standard uncertainties: laser, coil.
SEISMOMETER = {
    "natural_frequency": ((0.4747, 0.0006), (0.4765, 0.0010)),
    "damping_ratio": ((0.7105, 0.0020), (0.7145, 0.0036)),
}


def read(toml: str, data: str, folder: Path, part: str = "") -> Calibration:
    folder.mkdir()
    path = calibration_beside_data(toml, data, folder)
    path.write_text(path.read_text(encoding="utf-8") + part, encoding="utf-8")
    return vibrident.read(path)


def within(calibration: Calibration, band_hz: tuple[float, float]) -> Calibration:
    """Every third of the records whose names give a frequency in the band."""
    named = {record.name: float(record.name.removesuffix("Hz.csv").replace("_", ".")) for record in calibration.records}
    kept = [record for record in calibration.records if band_hz[0] <= named[record.name] <= band_hz[1]]
    return dataclasses.replace(calibration, records=tuple(kept[::3]))


def lobe_rms(result: Result, shock: Calibration) -> float:
    """Rms of measured minus predicted response over the rms of the response, in the shock's main lobe."""
    prediction = vibrident.predict(result, shock).predictions[0]
    response = prediction.record.response
    below = np.flatnonzero(np.abs(response) < EDGE * np.max(np.abs(response)))
    peak = int(np.argmax(np.abs(response)))
    first, last = below[below < peak].max() + 1, min([*below[below > peak], response.size])
    lobe = slice(int(first), int(last))
    compared = prediction.compared[lobe]
    assert np.mean(compared) > 0.9
    residual = (response[lobe] - prediction.predicted[lobe])[compared]
    return float(np.sqrt(np.mean(residual**2) / np.mean(response[lobe][compared] ** 2)))


@pytest.mark.parametrize("part_s", [(0.0, 4.45e-4), (1e-4, 4.6e-4), (2e-4, 4.5e-4)])
@pytest.mark.quick("part_s0")
def test_table_and_shock_of_an_accelerometer(tmp_path: Path, part_s: tuple[float, float]) -> None:
    """The main lobe is predicted within 1 %; by the sine table alone within some per cent. What remains is named.

    The shock's sensitivity is half a per cent below the table's, whichever part of it is used.
    """
    sine = read("ptb-shock-sine.toml", "ptb-shock", tmp_path / "sine")
    lobe = f"start_s = {part_s[0]}\nstop_s = {part_s[1]}\n"
    shock = read("ptb-shock.toml", "ptb-shock", tmp_path / "shock", lobe)
    by_table, by_shock = vibrident.identify_together([sine, shock], model="accelerometer+delay")
    for name in ("sensitivity", "natural_frequency", "damping_ratio"):
        assert by_table.parameters[name].value == pytest.approx(by_shock.parameters[name].value, rel=1e-9)
    assert lobe_rms(by_shock, shock) < 0.01
    assert lobe_rms(vibrident.identify(sine, model="accelerometer+delay"), shock) > 0.02
    # They disagree: the joint uncertainty is enlarged by the Birge ratio, and covers the shock's own value.
    sensitivity = by_shock.parameters["sensitivity"]
    assert abs(sensitivity.value - 0.2267) < 3.0 * sensitivity.standard_uncertainty
    assert sensitivity.standard_uncertainty < 0.001
    # Alone the table says 50.2(1.0) kHz and the shock 53.7(0.5) kHz, with dampings that disagree.
    assert 48e3 < by_shock.parameters["natural_frequency"].value < 55e3
    # Damping and delay trade off: the value moves along the valley with the machine's arithmetic, by
    # less than its u, and is said not to be determined.
    damping = by_shock.parameters["damping_ratio"]
    assert damping.interval_95[0] < 0.2
    assert damping.interval_95[1] > 0.02
    assert damping.value < 0.2 or not damping.identifiable
    alone = by_shock.settings["joint"]["shared"][0]["separate"]["ptb-shock.toml"]
    assert abs(alone["value"] - 0.22665) < 3.0 * np.hypot(alone["standard_uncertainty"], 8e-5)
    for result in (by_table, by_shock):
        assert "estimators_disagree" in result.warning_codes
    assert "lack_of_fit" in by_table.warning_codes


@pytest.mark.slow
def test_both_pickups_of_a_seismometer(tmp_path: Path) -> None:
    """Over the band of the reference fits: below it the springs bend, above it the laser sees micrometres."""
    laser, coil = (within(read(f"sm3-{n}.toml", "sm3", tmp_path / n), (0.3, 3.0)) for n in ("laser", "coil"))
    results = vibrident.identify_together([laser, coil])
    joint = results[0].settings["joint"]
    assert [row["name"] for row in joint["shared"]] == list(SEISMOMETER)
    assert joint["consistency"]["consistent"]
    for row in joint["shared"]:
        found = results[0].parameters[row["name"]]
        u = found.standard_uncertainty or 0.0
        assert u < min(one["standard_uncertainty"] for one in row["separate"].values())
        for value, formal in SEISMOMETER[row["name"]]:
            assert abs(found.value - value) < 3.0 * np.hypot(u, formal)
    # The coil over the velocity of the mass, by the laser: 173.5 V/(m/s) ± 0.8 % over 0.3 to 2 Hz (data README).
    coil_per_laser = results[1].parameters["generator_constant"].value / (
        results[0].parameters["conversion_coefficient"].value * MASS_PER_LASER
    )
    assert coil_per_laser == pytest.approx(173.5, rel=0.008)
