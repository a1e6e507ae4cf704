"""Copies count once; repeated measurements, however alike, count."""

import numpy as np
import pytest

from vibrident import Calibration, identify
from vibrident.data.records import Record
from vibrident.data.screening.copies import COUNTED_ONCE, notes_of_copies, without_copies


def record(name, motion, answer, **more):
    return Record(name, motion, answer, 1000.0, "random", **more)


@pytest.fixture
def channels():
    rng = np.random.default_rng(3)
    return rng.standard_normal(500), 0.01 * rng.standard_normal(500)


@pytest.mark.parametrize(
    "form",
    [
        lambda x: x.copy(),
        lambda x: np.round(x, 6),
        lambda x: np.array([float(f"{value:.7g}") for value in x]),
        lambda x: np.round(x / np.ptp(x) * 2**15) * np.ptp(x) / 2**15,
        lambda x: x.astype(np.float32).astype(float),
    ],
    ids=["copy", "six decimals", "seven digits", "16 bit", "float32"],
)
def test_another_form_of_the_same_samples_is_a_copy(channels, form):
    records = [record("a", *channels), record("b", *map(form, channels), start_time_s=5.0)]
    for order in (records, records[::-1]):
        (kept,) = without_copies(order)
        assert kept.name == order[0].name
        (text,) = notes_of_copies([(kept.name, kept.provenance.history)])
        assert f"{order[1].name} holds the same samples as {order[0].name}" in text
        assert kept.provenance.history == (f"{COUNTED_ONCE}{order[1].name}, which is left out",)


@pytest.mark.parametrize("bits", [8, 12, 16, None])
def test_repeated_measurements_are_no_copies(channels, bits):
    """The same motion twice, with noise a tenth of a converter's step and more."""
    rng = np.random.default_rng(4)
    step = 1e-5 if bits is None else np.ptp(channels[0]) / 2**bits
    for noise in (0.1, 1.0, 30.0):
        records = []
        for name in "abcd":
            both = [values * scale + noise * step * rng.standard_normal(500)
                    for values, scale in zip(channels, (1.0, 100.0), strict=True)]  # fmt: skip
            records.append(record(name, *(both if bits is None else (np.round(x / step) * step for x in both))))
        assert len(without_copies(records)) == 4


def test_other_rates_lengths_and_kinds_are_no_copies(channels):
    motion, answer = channels
    others = [
        record("a", motion, answer),
        Record("b", motion, answer, 2000.0, "random"),
        Record("c", motion, answer, 1000.0, "multisine"),
        record("d", motion[:-1], answer[:-1]),
        record("e", motion, -answer),
        record("f", motion, 2 * answer),
    ]
    assert len(without_copies(others)) == len(others)


def test_a_copy_adds_nothing_to_what_is_known(tmp_path):
    rng = np.random.default_rng(5)
    times = np.arange(3000) / 20_000.0
    records = []
    for frequency in (200.0, 500.0, 900.0, 1500.0, 2500.0):
        motion = np.sin(2 * np.pi * frequency * times)
        answer = motion / (1 - (frequency / 4000) ** 2) + 1e-3 * rng.standard_normal(times.size)
        records.append(Record(f"{frequency:g}", motion, answer, 20_000.0, "sine"))
    copies = [Record(f"copy of {r.name}", r.reference, r.response, r.sampling_rate_hz, "sine") for r in records]
    once = identify(Calibration(records=tuple(records)), estimator="ml")
    twice = identify(Calibration(records=(*records, *copies)), estimator="ml")
    for name, parameter in once.parameters.items():
        assert twice.parameters[name].value == parameter.value
        assert twice.parameters[name].standard_uncertainty == parameter.standard_uncertainty
    assert COUNTED_ONCE in str(twice.provenance)
