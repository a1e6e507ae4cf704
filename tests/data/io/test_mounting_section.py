"""[mounting] of a calibration file: one way to state it, each mistake with its sentence."""

import numpy as np
import pytest

from vibrident import InputError, read


def stated(folder, text):
    hz = np.geomspace(100.0, 10e3, 8)
    np.savetxt(
        folder / "frf.csv", np.transpose([hz, np.ones(8), np.zeros(8)]), delimiter=",", header="f,S,p", comments=""
    )
    path = folder / "cal.toml"
    path.write_text(f'[mounting]\n{text}\n[table]\nfile = "frf.csv"\nfrequency = 1\nmagnitude = 2\nphase = 3\n')
    return read(path).mounting


def test_stiffness_and_mass_give_the_frequency_and_its_u(tmp_path):
    text = "stiffness_n_per_m = 3.6e8\nmass_kg = 0.01\nstiffness_uncertainty = 0.06\nmass_uncertainty = 0.08"
    mounting = stated(tmp_path, text)
    assert mounting.frequency_hz == pytest.approx((3.6e10) ** 0.5 / (2 * np.pi))
    assert mounting.standard_uncertainty == pytest.approx(0.05)
    assert stated(tmp_path, "frequency_hz = 30e3\nstandard_uncertainty = 0.05").frequency_hz == 30e3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "Nothing is stated"),
        ("frequency_hz = 3e4\nstiffness_n_per_m = 1e8\nmass_kg = 0.01", "given twice"),
        ("mass_kg = 0.01", "Stiffness and mass together"),
        ("stiffness_n_per_m = 1e8", "Stiffness and mass together"),
        ("frequency_hz = 3e4\nmass_uncertainty = 0.1", "not stated has no use"),
        ("frequency_hz = 3e4\nmass_ratio = 0.1", "own resonance"),
        ("frequenzy_hz = 3e4", "not known here"),
    ],
)
def test_a_mistake_names_the_section(tmp_path, text, says):
    with pytest.raises(InputError, match=says) as caught:
        stated(tmp_path, text)
    assert "[mounting]" in caught.value.where
