"""Files stand in the order of the numbers in their names."""

from __future__ import annotations

import random

import pytest

from vibrident.data.io.record_files import natural_sort_key


@pytest.mark.parametrize(
    "names",
    [
        ["0_05hz.csv", "0_1hz.csv", "0_25Hz.csv", "0_5hz.csv", "1_0Hz.csv", "10_0Hz.csv"],
        ["9 Hz.csv", "10 Hz.csv", "31.5 Hz.csv", "500Hz.csv", "1kHz.csv", "1.25 kHz.csv"],
        ["run 1_2.csv", "run 1_10.csv", "run 2_1.csv"],  # no frequency: two numbers
        ["a01.csv", "a1.csv", "a2.csv", "b.csv"],
    ],
)
def test_numbers_in_names_decide(names):
    mixed = list(names)
    random.Random(1).shuffle(mixed)
    assert sorted(mixed, key=natural_sort_key) == names


def test_any_name_has_a_place():
    names = ["9" * 5000 + ".csv", "", "²", "٣Hz", "1_Hz", "Hz", ".5Hz", "1._5 Hz"]
    assert len(sorted(names, key=natural_sort_key)) == len(names)
