"""What files state of time is used or contradicted: each channel by its own clock, on one raster.

The truth is a sum of tones of the reference, and the response of an accelerometer to each; channels
are sampled from it wherever their clocks say.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.io.formats.csv import CsvFile

RATE = 2048.0
NATURAL_HZ, DAMPING, SENSITIVITY = 300.0, 0.1, 0.1
TONES = np.random.default_rng(8).uniform(5.0, 600.0, 60)
PHASES = np.random.default_rng(9).uniform(0.0, 2 * np.pi, 60)


def motion(time):
    return np.cos(2 * np.pi * np.outer(time, TONES) + PHASES).sum(axis=1)


def answer(time):
    ratio = TONES / NATURAL_HZ
    response = SENSITIVITY / (1 - ratio**2 + 2j * DAMPING * ratio)
    return (np.exp(1j * (2 * np.pi * np.outer(time, TONES) + PHASES)) @ response).real


def columns(path, **values):
    rows = zip(*values.values(), strict=True)
    text = ",".join(values) + "\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    path.write_text(text)


def calibration(folder, *, sampling="", entry="", reference='"a"', response='"v"'):
    (folder / "c.toml").write_text(
        f"[reference]\ncolumn = {reference}\n[response]\ncolumn = {response}\n[sampling]\n{sampling}\n"
        f'[[records]]\nfile = "x.csv"\nexcitation = "random"\n{entry}\n'
    )
    return folder / "c.toml"


def require_truth(path, *, samples=2000, atol=1e-5):
    """The channels are the motion and the answer at the same instants."""
    (record,) = read(path).records
    assert record.samples > samples
    time = record.start_time_s + record.time_s
    inside = record.mask
    np.testing.assert_allclose(record.reference[inside], motion(time)[inside], atol=30 * atol)
    np.testing.assert_allclose(record.response[inside], answer(time)[inside], atol=atol)
    return record


def decimals(values, places=9):
    return [f"{value:.{places}f}" for value in values]


@pytest.mark.parametrize("later", [0.0, 25.0, -17.0, 0.37, -3.21])
def test_each_file_has_its_own_clock(tmp_path, later):
    """By whole samples the channels are cut, by fractions resampled."""
    time = np.arange(4096) / RATE
    reference_time = time + later / RATE
    columns(tmp_path / "r.csv", **{"t [s]": decimals(reference_time, 12), "a": motion(reference_time)})
    columns(tmp_path / "x.csv", **{"t [s]": decimals(time, 12), "v": answer(time)})
    path = calibration(tmp_path, sampling='time_column = "t [s]"', entry='reference_file = "r.csv"')
    record = require_truth(path)
    if float(later).is_integer():
        assert record.samples == 4096 - abs(later)


@pytest.mark.parametrize(("digits", "width_s"), [(3, 1e-3), (6, 1e-6)])
def test_the_digits_of_a_stated_start_are_in_u(tmp_path, digits, width_s):
    """Starts of two files, 8.25 samples apart: each is known to its last decimal."""
    h5py = pytest.importorskip("h5py")
    time = np.arange(4096) / RATE
    later_s = 8.25 / RATE
    channels = {"r.h5": ("a", motion(time), 0.0), "x.h5": ("v", answer(time + later_s), later_s)}
    for file, (name, values, start_s) in channels.items():
        with h5py.File(tmp_path / file, "w") as made:
            made[name] = values
            made[name].attrs.update({"fs": RATE, "start_time": f"2026-11-22T10:00:{start_s:0{digits + 3}.{digits}f}"})
    path = calibration(tmp_path, entry='reference_file = "r.h5"')
    path.write_text(path.read_text().replace("x.csv", "x.h5"))
    (effect,) = read(path).effects
    assert effect.kind == "timing"
    assert effect.standard_uncertainty == pytest.approx(width_s / np.sqrt(6.0), rel=1e-9)


def test_a_second_time_column_is_the_clock_of_what_follows_it(tmp_path):
    time = np.arange(4096) / RATE
    other = time + 7.4 / RATE
    stamps = {"t1 [s]": decimals(time, 12), "v": answer(time), "t2 [s]": decimals(other, 12), "a": motion(other)}
    columns(tmp_path / "x.csv", **stamps)
    for sampling in ('time_column = "t1 [s]"', ""):
        require_truth(calibration(tmp_path, sampling=sampling))


@pytest.mark.parametrize("name", ["clock", "laser time [s]", "t_ref"])
@pytest.mark.parametrize("sampling", ['time_column = "t [s]"', f"rate_hz = {RATE}"])
def test_times_of_a_reference_file_count_whatever_their_name(tmp_path, name, sampling):
    """By their values at the known rate; they were left out: a delay of 25 samples that is none."""
    time = np.arange(4096) / RATE
    later = time + 25.0 / RATE
    columns(tmp_path / "r.csv", **{name: decimals(1e3 * later if name == "clock" else later), "a": motion(later)})
    columns(tmp_path / "x.csv", **{"t [s]": decimals(time), "v": answer(time)})
    path = calibration(tmp_path, sampling=sampling, entry='reference_file = "r.csv"')
    assert require_truth(path).samples == 4071


def test_times_named_after_their_channel(tmp_path):
    time = np.arange(4096) / RATE
    later = time + 25.0 / RATE
    stamps = {"a_time": decimals(later), "a": motion(later), "v_time": decimals(time), "v": answer(time)}
    columns(tmp_path / "x.csv", **stamps)
    for sampling in ('time_column = "v_time"', 'time_column = "a_time"'):
        (record,) = read(calibration(tmp_path, sampling=sampling)).records
        assert record.samples == 4071
        np.testing.assert_allclose(record.reference, motion(later)[:4071], atol=3e-4)
        np.testing.assert_allclose(record.response, answer(time)[25:], atol=1e-5)


def test_two_clocks_side_by_side_are_refused(tmp_path):
    time = np.arange(400) / RATE
    later = time + 25.0 / RATE
    columns(tmp_path / "x.csv", t_ref=decimals(later), t_out=decimals(time), a=motion(later), v=answer(time))
    with pytest.raises(InputError, match="different starts"):
        read(calibration(tmp_path, sampling='time_column = "t_out"'))


def test_dates_beside_seconds_are_refused(tmp_path):
    time = np.arange(400) / RATE
    columns(tmp_path / "r.csv", time=[f"2026-11-26T10:00:{second:09.6f}" for second in time], a=motion(time))
    columns(tmp_path / "x.csv", time=decimals(time + 5.0), v=answer(time))
    path = calibration(tmp_path, sampling='time_column = "time"', entry='reference_file = "r.csv"')
    with pytest.raises(InputError, match="cannot be compared"):
        read(path)
    columns(tmp_path / "r.csv", a=motion(time))  # as the remedy says
    assert read(path).records[0].samples == 400


@pytest.mark.parametrize("sampling", ["# fs = 2048\n", "# dt = 0.48828125 ms\n", ""])
def test_a_start_in_a_head_counts_beside_any_rate(tmp_path, sampling):
    """It was left out where the calibration file states the rate, or the other file the times."""
    time = np.arange(400) / RATE
    later = time + 64.0 / RATE
    for name, head, values in (("r.csv", "t0 = 0.03125 s\n", motion(later)), ("x.csv", "t0 = 0 s\n", answer(time))):
        rows = "".join(f"{value}\n" for value in values)
        (tmp_path / name).write_text(f"# {head}{sampling}{'a' if name == 'r.csv' else 'v'}\n{rows}")
    path = calibration(tmp_path, sampling=f"rate_hz = {RATE}", entry='reference_file = "r.csv"')
    (record,) = read(path).records
    np.testing.assert_allclose(record.reference, motion(later)[:336], atol=3e-4)
    np.testing.assert_allclose(record.response, answer(time)[64:], atol=1e-5)
    columns(tmp_path / "x.csv", time=decimals(time), v=answer(time))
    if not sampling:
        record = read(calibration(tmp_path, entry='reference_file = "r.csv"')).records[0]
        np.testing.assert_allclose(record.reference, motion(later)[:336], atol=3e-4)


@pytest.mark.parametrize("kind", ["text", "missing"])
def test_times_that_cannot_be_read_are_no_common_start(tmp_path, kind):
    time = np.arange(400) / RATE
    stamps = [f"00:{second:09.6f}" for second in time] if kind == "text" else ["", *decimals(time)[1:]]
    columns(tmp_path / "r.csv", time=stamps, a=motion(time))
    columns(tmp_path / "x.csv", time=decimals(time + 1.0), v=answer(time))
    path = calibration(tmp_path, sampling=f"rate_hz = {RATE}", entry='reference_file = "r.csv"')
    with pytest.raises(InputError, match="is not known"):
        read(path)
    columns(tmp_path / "r.csv", a=motion(time))  # as the remedy says
    columns(tmp_path / "x.csv", v=answer(time))
    assert read(path).records[0].samples == 400


@pytest.mark.parametrize("order", ["descending", "shuffled"])
def test_rows_in_another_order_than_their_times_are_refused(tmp_path, rng, order):
    rows = np.arange(400)[::-1] if order == "descending" else rng.permutation(400)
    time = rows / RATE
    columns(tmp_path / "x.csv", time=decimals(time), a=motion(time), v=answer(time))
    with pytest.raises(InputError, match="order of their times"):
        read(calibration(tmp_path, sampling=f"rate_hz = {RATE}"))


@pytest.mark.parametrize("first", [739000.0, 46000.0])
def test_day_numbers_are_not_taken_for_seconds(tmp_path, first):
    time = np.arange(400) / RATE
    columns(tmp_path / "x.csv", time=(first + time / 86400.0).tolist(), a=motion(time), v=answer(time))
    with pytest.raises(InputError, match="unit of the time column") as caught:
        read(calibration(tmp_path))
    assert "days" in caught.value.remedy


def test_times_of_as_many_digits_are_even(tmp_path):
    """Beyond 0.1 s they have a decimal less; they were taken for uneven, and resampled."""
    time = np.arange(400) / RATE
    columns(tmp_path / "x.csv", time=[f"{second:.6g}" for second in time], a=motion(time), v=answer(time))
    (record,) = read(calibration(tmp_path)).records
    assert record.samples == 400


@pytest.mark.parametrize("rows", [1, 2])
def test_one_or_two_rows_are_too_few(tmp_path, rows):
    columns(tmp_path / "x.csv", time=[0.0, 0.1][:rows], a=[1.0, 2.0][:rows], v=[1.0, 2.0][:rows])
    with pytest.raises(InputError, match=r"too short|two rows"):
        read(calibration(tmp_path, sampling='time_column = "time"'))


def test_two_time_columns_side_by_side_are_one_clock(tmp_path):
    time = np.arange(4096) / RATE
    dates = [f"2026-11-26T10:00:{second:09.6f}" for second in time]
    columns(tmp_path / "x.csv", time=decimals(time), date=dates, v=answer(time), a=motion(time))
    require_truth(calibration(tmp_path, sampling='time_column = "time"'))


@pytest.mark.parametrize(("rate", "own"), [(5000.0, RATE), (RATE, 5000.0), (RATE, RATE * (1 + 3e-5))])
def test_other_rasters_are_brought_to_the_slower(tmp_path, rate, own):
    time, other = np.arange(int(2.5 * rate)) / rate, np.arange(int(2.6 * own)) / own - 0.0123
    columns(tmp_path / "r.csv", time=decimals(other, 12), a=motion(other))
    columns(tmp_path / "x.csv", time=decimals(time, 12), v=answer(time))
    path = calibration(tmp_path, sampling='time_column = "time"', entry='reference_file = "r.csv"')
    record = require_truth(path)
    assert record.sampling_rate_hz == pytest.approx(min(rate, own), rel=1e-9)
    assert any("resampled" in step for step in record.provenance.history)


def test_channels_that_do_not_overlap_are_refused(tmp_path):
    time = np.arange(4096) / RATE
    columns(tmp_path / "r.csv", time=decimals(time + 5.0), a=motion(time))
    columns(tmp_path / "x.csv", time=decimals(time), v=answer(time))
    with pytest.raises(InputError, match="not recorded at the same time"):
        read(calibration(tmp_path, entry='reference_file = "r.csv"'))


@pytest.mark.parametrize("jitter", [0.03, 0.2, 0.45])
def test_uneven_stamps_are_evened(tmp_path, rng, jitter):
    """Taken as even the response would be off by its slope: 0.03 of an interval is 3 % at 300 Hz."""
    time = (np.arange(6000) + rng.uniform(-jitter, jitter, 6000)) / RATE
    columns(tmp_path / "x.csv", time=decimals(time, 12), a=motion(time), v=answer(time))
    record = require_truth(calibration(tmp_path))
    assert any("evened" in step for step in record.provenance.history)
    with pytest.raises(InputError, match="not taken at an even rate"):
        read(calibration(tmp_path, sampling=f"rate_hz = {RATE}"))


def test_stamps_that_are_rounded_are_even(tmp_path):
    """To a millisecond, twice the interval: nothing is known of the samples' own times."""
    time = np.arange(6000) / RATE
    columns(tmp_path / "x.csv", time=decimals(time, 3), a=motion(time), v=answer(time))
    with pytest.raises(InputError, match="times are rounded"):
        read(calibration(tmp_path, sampling='time_column = "time"'))
    for places in (4, 6):
        columns(tmp_path / "x.csv", time=decimals(time, places), a=motion(time), v=answer(time))
        (record,) = read(calibration(tmp_path)).records
        assert record.samples == 6000
        assert record.sampling_rate_hz == pytest.approx(RATE, rel=1e-5)


@pytest.mark.parametrize("tick", [1 / 32768, 1e-4])
def test_an_even_clock_read_in_ticks_is_even(tmp_path, tick):
    time = np.arange(6000) / RATE
    stamps = np.floor(time / tick) * tick
    columns(tmp_path / "x.csv", time=decimals(stamps, 9), a=motion(time), v=answer(time))
    (record,) = read(calibration(tmp_path)).records
    assert (record.samples, record.valid.all()) == (6000, True)


def test_lost_and_doubled_samples_are_found_by_their_stamps(tmp_path):
    time = np.arange(6000) / RATE
    rows = np.sort(np.concatenate([np.delete(np.arange(6000), [700, 701, 3000]), [50, 51, 52]]))
    columns(tmp_path / "x.csv", time=decimals(time[rows]), a=motion(time[rows]), v=answer(time[rows]))
    record = require_truth(calibration(tmp_path))
    assert np.flatnonzero(~record.mask).tolist() == [700, 701, 3000]


def test_two_values_at_one_time_are_refused(tmp_path):
    time = np.arange(600) / RATE
    stamps = time.copy()
    stamps[40] = stamps[39]
    columns(tmp_path / "x.csv", time=decimals(stamps), a=motion(time), v=answer(time))
    with pytest.raises(InputError, match="same time"):
        read(calibration(tmp_path))


@pytest.mark.parametrize(("unit_s", "first"), [(1.0, 1.764e9), (1e-3, 1.764e12), (1e-6, 1.764e15)])
def test_times_of_the_epoch_are_recognised(tmp_path, unit_s, first):
    """Milliseconds since 1970 were 1,870 years of record."""
    time = np.arange(6000) / 50.0
    stamps = [f"{value:.3f}" for value in first + time / unit_s]
    columns(tmp_path / "x.csv", timestamp=stamps, a=motion(time), v=answer(time))
    (record,) = read(calibration(tmp_path, sampling='time_column = "timestamp"')).records
    assert record.sampling_rate_hz == pytest.approx(50.0, rel=1e-6)
    assert any("since 1970" in step for step in record.provenance.history)


@pytest.mark.parametrize("step", [1.0, 20.0, 488.28125])
def test_a_counter_or_another_unit_is_not_taken_for_seconds(tmp_path, step):
    time = np.arange(600) / RATE
    columns(tmp_path / "x.csv", t=np.arange(600) * step, a=motion(time), v=answer(time))
    with pytest.raises(InputError, match="unit of the time column is not known"):
        read(calibration(tmp_path, sampling='time_column = "t"'))


def test_what_is_not_a_number_outside_the_part_does_no_harm(tmp_path):
    time = np.arange(6000) / RATE
    later = time + 0.1 / RATE
    values = [*answer(later)[:-5], *["nan"] * 5]
    columns(tmp_path / "x.csv", time=decimals(later, 12), v=values)
    columns(tmp_path / "r.csv", time=decimals(time, 12), a=motion(time))
    path = calibration(tmp_path, entry='reference_file = "r.csv"\nstop_s = 2.5')
    assert require_truth(path).samples < 2.5 * RATE
    with pytest.raises(InputError, match="not a number"):
        read(calibration(tmp_path, entry='reference_file = "r.csv"'))


def test_a_fraction_costs_the_sensor_nothing(tmp_path, rng):
    """The delay of channels that begin 0.37 samples apart is zero within 4 u, and u knows the stamps."""
    time = np.arange(6000) / RATE
    other = time + 0.37 / RATE
    noise = 1e-3 * rng.normal(size=time.size)
    columns(tmp_path / "r.csv", time=decimals(other, 6), a=motion(other))
    columns(tmp_path / "x.csv", time=decimals(time, 6), v=answer(time) + noise)
    path = calibration(tmp_path, entry='reference_file = "r.csv"')
    result = vibrident.identify(read(path), model="accelerometer+delay")
    for name, truth in {
        "sensitivity": SENSITIVITY,
        "natural_frequency": NATURAL_HZ,
        "damping_ratio": DAMPING,
        "delay": 0.0,
    }.items():
        stated = result.parameters[name]
        assert abs(stated.value - truth) < 4 * stated.standard_uncertainty
    assert result.parameters["delay"].standard_uncertainty > 1e-6 / np.sqrt(12)


@pytest.mark.parametrize("text", ["0,7,2014/07/30", "9,-7,a"])
def test_columns_that_are_no_times_are_not_converted(tmp_path, monkeypatch, text):
    """Text, constants and falling numbers beside the channels: each cost a pass over the file."""
    time = np.arange(3000) / RATE
    spare = [f"{first},{5 - row},{text}" for row, first in enumerate(decimals(0.0 * time))]
    columns(tmp_path / "x.csv", **{"p,q,r,s,d": spare}, a=motion(time), v=answer(time))
    converted = []
    load = CsvFile.load
    monkeypatch.setattr(CsvFile, "load", lambda file, places: converted.extend(places) or load(file, places))
    require_truth(calibration(tmp_path, sampling=f"rate_hz = {RATE}"))
    assert set(converted) == {5, 6}


@settings(max_examples=60)
@given(st.lists(st.sampled_from(["0", "1", "1.5", "2e0", "-1", "\u22121", "", "x", "nan"]), min_size=2, max_size=40))
def test_a_column_that_is_a_time_may_rise(tmp_path_factory, cells):
    """What a few rows say agrees with what all say: no time is lost by them."""
    path = tmp_path_factory.mktemp("column") / "x.csv"
    path.write_text("a,b\n" + "".join(f"0,{cell}\n" for cell in cells), encoding="utf-8")
    try:
        file = CsvFile(path)
        (values,) = file.load([1])
    except InputError:
        return
    is_time = bool(np.all(np.diff(values) >= 0.0) and values[-1] > values[0])
    assert file.may_rise(1) or not is_time


def test_rounding_repeats_times_at_a_stated_rate(tmp_path):
    """10 240 Hz in steps of 0.1 ms: two rows in forty-two have one time; 10 000 Hz was read, and the rate refused."""
    time = np.arange(3000) / 10240.0
    columns(tmp_path / "x.csv", t=decimals(time, 4), a=decimals(motion(time)), v=decimals(answer(time)))
    (record,) = read(calibration(tmp_path, sampling="rate_hz = 10240")).records
    assert record.samples == 3000
    assert record.sampling_rate_hz == 10240.0
    with pytest.raises(InputError, match="give rate_hz where they are rounded"):
        read(calibration(tmp_path, sampling='time_column = "t"'))


def test_times_that_rounding_repeats_ask_for_the_rate(tmp_path):
    """In milliseconds 20 samples of 20 kHz have one time: they do not fail to increase."""
    time = np.arange(4001) / 20e3
    columns(tmp_path / "x.csv", t=decimals(time, 3), a=decimals(motion(time)), v=decimals(answer(time)))
    with pytest.raises(InputError, match="The times are rounded") as refusal:
        read(calibration(tmp_path))
    assert "rate_hz" in refusal.value.remedy
    assert "about 20000" in refusal.value.remedy
