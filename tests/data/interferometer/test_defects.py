"""What real optical signals do: within the uncertainty, or said with its code."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.interferometer.choice import choose
from vibrident.data.interferometer.effects import combined, cyclic_error
from vibrident.data.interferometer.phase import PhasePath, unwrapped
from vibrident.data.interferometer.setting import signals_in_memory
from vibrident.data.interferometer.sine import fit_sine
from vibrident.data.interferometer.survey import survey
from vibrident.physics.simulation.optics import Optics, write_optical_calibration

FREQUENCIES = [150.0, 400.0, 1000.0]
COMMON = {"start": "steady", "sampling_rate_hz": 4e5, "samples": 60_000, "response_noise": 1e-3}


def read(folder, optics, frequencies=FREQUENCIES, amplitude=10.0, **more):
    settings = {**COMMON, "frequencies_hz": frequencies, "amplitude": amplitude, **more}
    truth = write_optical_calibration(folder, "paper", "sine", optics, seed=4, **settings)
    return vibrident.read(folder / "calibration.toml"), truth


def amplitudes_off(calibration, truth):
    """Relative error of the displacement's amplitude, and its standard uncertainty by noise and effects."""
    found = []
    for record, exact in zip(calibration.records, truth.records, strict=True):
        sine = fit_sine(record.reference, record.mask, record.sampling_rate_hz, record.frequency_hz)
        true = fit_sine(exact.reference, exact.mask, exact.sampling_rate_hz, exact.frequency_hz)
        scale, optical = abs(record.optical.setting.metres_per_radian), record.optical
        noise = optical.phase_noise_rad * scale / true.amplitude * np.sqrt(2.0 / optical.samples)
        effects = [
            effect.standard_uncertainty * np.interp(true.frequency_hz, *np.array(effect.pattern).T[:2])
            for effect in calibration.effects
            if effect.pattern
        ]
        found.append((sine.amplitude / true.amplitude - 1.0, float(np.hypot(noise, np.linalg.norm(effects))) + 2e-8))
    return np.array(found).T


def codes(calibration):
    return {finding.code for record in calibration.records for finding in record.optical.findings}


@pytest.mark.parametrize(
    ("optics", "said"),
    [
        (Optics(bits=8), set()),
        (Optics(noise=0.05, random=True), set()),
        (Optics(fading=0.3), set()),
        (Optics(dropouts=4), {"fringe_slip"}),
        (Optics(dropouts=2, dropout_s=3e-3), {"fringe_slip"}),
        (Optics(drift=0.1), {"ellipse_unstable"}),
        (Optics(cyclic_rad=(0.01, 0.01, 0.01)), set()),
        (Optics(noise=0.03, drift=0.04, dropouts=2, cyclic_rad=(0.0, 0.0, 0.01)), {"fringe_slip", "ellipse_unstable"}),
    ],
)
@pytest.mark.quick("optics0-said0", "optics2-said2", "optics3-said3", "optics7-said7")
def test_displacement_is_right_within_its_uncertainty_and_what_was_found_is_said(tmp_path, optics, said):
    calibration, truth = read(tmp_path, optics)
    off, u = amplitudes_off(calibration, truth)
    assert np.all(np.abs(off) < 4.0 * u)
    assert codes(calibration) == said


def test_a_cyclic_error_is_measured_taken_out_and_a_row_of_the_budget(tmp_path):
    calibration, truth = read(tmp_path, Optics(cyclic_rad=(0.0, 0.02, 0.005)))
    off, u = amplitudes_off(calibration, truth)
    assert np.all(np.abs(off) < 4.0 * u)
    assert np.max(u) < 1e-4  # uncorrected, this error moves the amplitude at 1000 Hz by 2e-3
    measured = {order: (size, u) for order, size, u in calibration.records[0].optical.cyclic}
    for order, true in ((2, 0.02), (4, 0.005)):
        assert abs(measured[order][0] - true) < 4.0 * measured[order][1] + 0.03 * true
    assert any(effect.kind == "cyclic" for effect in calibration.effects)


def test_a_small_motion_takes_its_ellipse_from_a_larger_one(tmp_path):
    """10 kHz at 100 m/s² is 0.16 fringe: right with an ellipse from a larger motion, honest without."""
    optics = Optics(noise=0.02, amplitudes=(1.0, 0.8), quadrature_error_rad=0.15)
    calibration, truth = read(tmp_path / "with", optics, [1000.0, 10_000.0], 100.0)
    off, u = amplitudes_off(calibration, truth)
    assert np.all(np.abs(off) < 4.0 * u)
    assert u[1] < 3e-3
    assert codes(calibration) == set()
    calibration, truth = read(tmp_path / "without", optics, [10_000.0], 100.0)
    off, u = amplitudes_off(calibration, truth)
    assert np.abs(off[0]) < 3.0 * u[0]
    assert u[0] > 0.02
    assert codes(calibration) == {"few_fringes"}


def test_motion_that_is_too_fast_for_the_sampling_is_refused(tmp_path):
    with pytest.raises(InputError, match="too fast"):
        read(tmp_path, Optics(rate_hz=1e5), [20.0], 10.0, sampling_rate_hz=1e5, samples=30_000)


def with_signals(folder, change):
    """A calibration whose photodetector signals, shape (2, n), are changed."""
    settings = {**COMMON, "frequencies_hz": [400.0, 1000.0], "amplitude": 10.0, "samples": 20_000}
    write_optical_calibration(folder, "paper", "sine", Optics(bits=12), seed=4, **settings)
    for path in folder.glob("*.h5"):
        with h5py.File(path, "r+") as file:
            changed = change(np.stack([file["u1"][:], file["u2"][:]]).astype(float))
            for name, values in zip(("u1", "u2"), changed, strict=True):
                del file[name]
                file[name] = values
    return vibrident.read(folder / "calibration.toml")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda u: np.stack([u[0], np.full(u.shape[1], 7.0)]), "constant"),
        (lambda u: np.stack([u[0], 2.0 * u[0] + 1.0]), "the same"),
    ],
)
def test_a_dead_detector_is_refused(tmp_path, change, word):
    with pytest.raises(InputError, match=word):
        with_signals(tmp_path, change)


def test_a_detector_at_its_limit_is_named(tmp_path):
    assert codes(with_signals(tmp_path / "free", lambda u: u)) == set()
    clipped = with_signals(tmp_path / "clipped", lambda u: np.stack([np.minimum(u[0], 0.9 * u[0].max()), u[1]]))
    assert codes(clipped) == {"clipped"}
    assert "signal 1" in clipped.records[0].optical.findings[-1].message


def test_slow_motion_of_the_table_is_taken_out(tmp_path):
    calibration, truth = read(tmp_path, Optics(table_m=3e-7), [400.0, 1000.0])
    off, _ = amplitudes_off(calibration, truth)
    assert np.max(np.abs(off)) < 1e-4  # the table moves by more than the sensor


def drawn_by(phase, *, drift=0.0, fading=0.0):
    """Signals of a phase, with offsets that drift, and light that fades and comes back."""
    turn = np.linspace(0.0, 1.0, phase.size)
    light = 1.0 + fading * np.sin(9.0 * turn)
    u = np.stack([drift * turn + light * np.cos(phase), 0.1 - drift * turn + 0.9 * light * np.sin(phase + 0.1)])
    return signals_in_memory(u + 0.01 * np.random.default_rng(1).standard_normal(u.shape), 1e6)


def test_an_arc_of_fading_light_takes_the_ellipse_of_a_larger_motion():
    """Its own ellipse seemed to change by 19 %, and was followed. One that drifts with that of the others is."""
    time = np.arange(60_000) / 1e6
    large, small = (size * np.cos(2.0 * np.pi * 1600.0 * time) for size in (20.0, 2.0))
    fading, drifting = (
        choose([survey(drawn_by(size, **fault)) for size in (large, small)], "ab")[1]
        for fault in ({"fading": 0.3}, {"drift": 0.06})
    )
    assert not fading.knots
    assert "few_fringes" not in {finding.code for finding in fading.findings}
    off = np.abs(fading.ellipse.centre - [0.0, 0.1])
    assert np.all(off < 3.0 * np.sqrt(np.diag(fading.ellipse.shape_covariance)[:2]))
    assert drifting.knots


def test_pieces_of_time_that_know_their_ellipse_little_do_not_make_it_change():
    """Before a shock the phase moves on an arc; the plain mean of all pieces was off by the errors of these."""
    time = np.arange(120_000) / 1e6
    for middle in range(6):
        phase = middle + np.where(time < 0.06, 1.3, 40.0) * np.sin(2.0 * np.pi * 400.0 * time)
        assert survey(drawn_by(phase)).knots == ()


@pytest.mark.slow
def test_clean_signals_raise_no_alarm():
    """24 set-ups of four records; 60 gave none either (studies/interferometer.md)."""
    random, alarms, rate = np.random.default_rng(7), 0, 1e6
    for _ in range(24):
        centre, sizes, angle = random.uniform(-0.2, 0.2, 2), random.uniform(0.75, 1.25, 2), random.uniform(-0.25, 0.25)
        noise, drawn = random.choice([0.003, 0.01, 0.05]), []
        for frequency in (60.0, 150.0, 400.0, 1000.0):
            time = np.arange(30_000) / rate
            x = 10.0 / (2.0 * np.pi * frequency) ** 2 * np.cos(2.0 * np.pi * frequency * time + random.uniform(0, 6))
            phase = 4.0 * np.pi * x / 632.991e-9 + random.uniform(0.0, 6.0)
            u = centre[:, None] + sizes[:, None] * np.stack([np.cos(phase), np.sin(phase + angle)])
            drawn.append(signals_in_memory(np.rint(2000.0 * (u + noise * random.standard_normal(u.shape))), rate))
        seen = [survey(signals) for signals in drawn]
        chosen, measured = choose(seen, "abcd"), []
        alarms += sum(bool(choice.findings) for choice in chosen)
        for signals, choice in zip(drawn, chosen, strict=True):
            path = PhasePath()
            list(unwrapped(signals, choice.ellipse, choice.knots, path))
            alarms += bool(path.gaps) or path.counted != path.by_phase
            measured.append(
                cyclic_error(signals, choice.ellipse, choice.knots, path.length / 6.283 / signals.samples, frequency)
            )
        whole = combined([one for one in measured if one is not None])
        alarms += any(whole.rarity(order) < 1e-4 for order in range(3))
    assert alarms == 0
