"""A fit takes a band of the data alone: what is outside has no part in it, by whichever way the band is stated."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from vibrident import Calibration, InputError, Record, ResponseTable, Result, identify, read
from vibrident.app.cli import app
from vibrident.data.io import write_calibration
from vibrident.physics.models import parse

TRUE = {"sensitivity": 0.1, "natural_frequency": 400.0, "damping_ratio": 0.1}
RATE, SAMPLES = 4096.0, 4096
BAND = (60.0, 700.0)
RNG = np.random.default_rng(4)


def response_at(hz: np.ndarray) -> np.ndarray:
    """That of an accelerometer in the band, and a fifth more outside it."""
    outside = (hz < BAND[0]) | (hz > BAND[1])
    return parse("accelerometer").frequency_response(TRUE, hz) * np.where(outside, 1.2, 1.0)


def channels(hz: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    turn = np.exp(2j * np.pi * (np.outer(np.arange(SAMPLES) / RATE, hz) + rng.random(hz.size)))
    motion, response = np.sum(turn, axis=1).real, (turn @ response_at(hz)).real
    return motion, response + 1e-3 * np.std(response) * rng.standard_normal(SAMPLES)


def multisine() -> Calibration:
    return Calibration.from_arrays(
        *channels(np.arange(10.0, 1500.0, 5.0), np.random.default_rng(1)), RATE, excitation="multisine"
    )


def sines() -> Calibration:
    at = (20.0, 80.0, 160.0, 320.0, 400.0, 500.0, 640.0, 1200.0)
    rng = np.random.default_rng(2)
    pairs = [channels(np.array([hz]), rng) for hz in at]
    return Calibration(tuple(Record(f"{hz:g} Hz", *pair, RATE) for hz, pair in zip(at, pairs, strict=True)))


def table() -> Calibration:
    at = np.geomspace(10.0, 1500.0, 60)
    response = response_at(at)
    noise = 1e-3 * np.random.default_rng(3).standard_normal((2, at.size))
    columns = np.abs(response) * (1.0 + noise[0]), np.angle(response) + noise[1]
    u = {"magnitude_uncertainty": 1e-3 * np.abs(response), "phase_uncertainty_rad": np.full(at.size, 1e-3)}
    return Calibration(table=ResponseTable(at, *columns, **u))


def right(result: Result) -> bool:
    each = [(result.parameters[name], true) for name, true in TRUE.items()]
    return result.fit.adequate and all(abs(p.value - true) < 4.0 * p.standard_uncertainty for p, true in each)


@pytest.mark.parametrize("make", [multisine, sines, table], ids=lambda make: make.__name__)
@pytest.mark.quick("sines", "table")
def test_in_the_band_the_model_is_right_and_outside_it_is_not_asked(make):
    calibration = make()
    assert "lack_of_fit" in identify(calibration).warning_codes
    result = identify(calibration, band_hz=BAND)
    assert not result.warnings, result.warnings
    assert right(result)
    measured = result.measured.frequency_hz
    assert measured.min() >= BAND[0] * 0.9
    assert measured.max() <= BAND[1] * 1.1


def test_a_file_states_the_band_and_the_command_line_another(tmp_path):
    path = write_calibration(tmp_path, sines())
    text = path.read_text(encoding="utf-8").replace("[[records]]", "[[records]]\nfrom_hz = 60.0\nto_hz = 700.0")
    stated = tmp_path / "stated.toml"
    stated.write_text(text, encoding="utf-8")
    assert {record.band_hz for record in read(stated).records} == {BAND}
    assert right(identify(stated))
    words = ["identify", str(path), "--band", "60:700", "--out", str(tmp_path / "out"), "--no-pictures", "--quiet"]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    by_command, by_file = Result.load(tmp_path / "out" / "result.json"), identify(stated)
    assert by_command.parameters["sensitivity"].value == by_file.parameters["sensitivity"].value
    again = read(write_calibration(tmp_path / "again", read(stated)))
    assert {record.band_hz for record in again.records} == {BAND}


def test_a_table_in_a_file_states_its_band(tmp_path):
    path = write_calibration(tmp_path, table())
    text = path.read_text(encoding="utf-8").replace("[table]", "[table]\nfrom_hz = 60.0\nto_hz = 700.0")
    path.write_text(text, encoding="utf-8")
    at = read(path).table.frequency_hz
    assert (at.min() >= 60.0, at.max() <= 700.0) == (True, True)


@pytest.mark.parametrize(
    ("band", "sentence"),
    [
        ((700.0, 60.0), "The limits of the band are not usable"),
        ((0.0, 60.0), "The limits of the band are not usable"),
        ((1600.0, 1700.0), "No data are in the band"),
    ],
)
@pytest.mark.parametrize("make", [multisine, sines, table], ids=lambda make: make.__name__)
def test_what_is_no_band_is_refused_in_one_sentence(make, band, sentence):
    with pytest.raises(InputError, match=sentence):
        identify(make(), band_hz=band)
