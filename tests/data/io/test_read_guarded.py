"""Binary files are read in a process of their own: the same numbers, and a crash or an endless file is bad input."""

import os
import time

import h5py
import numpy as np
import pytest

from vibrident.base.errors import InputError
from vibrident.data.io import read, read_guarded, reading

HEAD = '[reference]\ncolumn = "a"\n[response]\ncolumn = "b"\n[sampling]\nrate_hz = 1000.0\n'


@pytest.fixture
def calibration(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["a"], file["b"] = np.sin(np.arange(100.0)), np.cos(np.arange(100.0))
    (tmp_path / "c.toml").write_text(HEAD + '[[records]]\nfile = "*.h5"\nexcitation = "random"\n')
    return tmp_path / "c.toml"


def crash(_):
    os.abort()


def turn_in_a_circle(_):
    while True:
        time.sleep(0.01)


def test_the_numbers_are_the_same(calibration):
    (here,), (there,) = read(calibration).records, read_guarded(calibration).records
    np.testing.assert_array_equal(here.response, there.response)
    np.testing.assert_array_equal(here.reference, there.reference)
    assert here.provenance == there.provenance


@pytest.mark.parametrize(
    ("reader", "seconds", "words"), [(crash, 20.0, "crashed"), (turn_in_a_circle, 0.5, "takes longer")]
)
def test_what_brings_a_reader_down_is_bad_input(calibration, monkeypatch, reader, seconds, words):
    monkeypatch.setattr(reading, "_MIN_SECONDS", seconds)
    monkeypatch.setattr(reading, "read", reader)
    with pytest.raises(InputError, match=words) as caught:
        read_guarded(calibration)
    assert "c.toml" in caught.value.where
    assert caught.value.remedy


def test_text_needs_no_process(calibration, monkeypatch):
    (calibration.parent / "x.csv").write_text("a,b\n" + "".join(f"{k},{k * k % 7}\n" for k in range(50)))
    calibration.write_text(HEAD + '[[records]]\nfile = "x.csv"\nexcitation = "random"\n')
    monkeypatch.delattr(reading, "sandbox")
    assert read_guarded(calibration).records[0].samples == 50
