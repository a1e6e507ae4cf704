"""The C code compiled by gcc: equal to Python, to the model over the band, and to what its comments say."""

from __future__ import annotations

import ctypes
import itertools
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from tests.support.exported import CASES, PAPER, case, paper, result

from vibrident.base.errors import InputError
from vibrident.export import export
from vibrident.export.formats.c import firmware
from vibrident.export.sensor import read_sensor

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
RATES = {"coil": 1000.0, "coil inverted": 1000.0, "coil two modes": 1000.0, "piezo": 102400.0}
#: Those whose impulse response ends within a few thousand samples.
SHORT = (
    "paper",
    "inverted",
    "critical",
    "overdamped",
    "late",
    "very late",
    "mems",
    "two modes",
    "coil",
    "coil two modes",
)
HARNESS = """
#include "sensor.h"
#define RUN(S, T) \\
    void run_model##S(const T *x, T *y, int n) { \\
        sensor_filter##S f; int k; sensor_filter_init##S(&f, &sensor_model##S); \\
        for (k = 0; k < n; k++) y[k] = sensor_filter_step##S(&f, x[k]); } \\
    void run_correction##S(const T *x, T *y, int n) { \\
        sensor_filter##S f; int k; sensor_filter_init##S(&f, &sensor_correction##S); \\
        for (k = 0; k < n; k++) y[k] = sensor_filter_step##S(&f, x[k]); } \\
    void run_cell##S(const T *x, T *y, int n) { \\
        sensor_cell##S c; int k; sensor_cell_init##S(&c); \\
        for (k = 0; k < n; k++) y[k] = sensor_cell_step##S(&c, x[k]); }
RUN(, double)
RUN(_f32, float)
"""
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")


class Compiled:
    def __init__(self, made, rate, folder):
        self.header, self.source = export(made, "c", folder, rate_hz=rate)
        (folder / "harness.c").write_text(HARNESS)
        target = folder / "sensor.so"
        subprocess.run(["gcc", *FLAGS, "-O2", "-c", "-fPIC", str(self.source), "-o", str(folder / "s.o")], check=True)
        command = ["gcc", "-std=c99", "-O2", "-shared", "-fPIC", str(folder / "s.o"), str(folder / "harness.c")]
        subprocess.run([*command, "-o", str(target)], check=True)
        self.library = ctypes.CDLL(str(target))
        self.text = self.header.read_text()

    def run(self, what, samples, dtype=np.float64):
        x = np.ascontiguousarray(samples, dtype)
        y = np.empty_like(x)
        name = f"run_{what}" + ("_f32" if dtype == np.float32 else "")
        getattr(self.library, name)(x.ctypes.data_as(ctypes.c_void_p), y.ctypes.data_as(ctypes.c_void_p), len(x))
        return y.astype(float)

    def array(self, name, size, kind=ctypes.c_double):
        return np.array((kind * size).in_dll(self.library, name), float)

    def number(self, pattern):
        return float(re.search(pattern, self.text)[1])


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    known = {}

    def get(name):
        if name not in known:
            rate = RATES.get(name, 51200.0)
            sensor = read_sensor(case(name))
            known[name] = Compiled(case(name), rate, tmp_path_factory.mktemp("c")), firmware(sensor, rate), sensor
        return known[name]

    return get


def in_python(filter_, x):
    """Taps, then sections in δ, sample after sample."""
    y = np.convolve(x, filter_.taps.taps)[: len(x)]
    y = np.concatenate([np.zeros(filter_.taps.lead), y])[: len(x)]
    for b0, b1, b2, a1, a2 in filter_.sections.rows:
        s0 = s1 = 0.0
        out = np.empty_like(y)
        for k, value in enumerate(y):
            out[k] = b0 * value + s0
            s0, s1 = s0 + b1 * value - a1 * out[k] + s1, s1 + b2 * value - a2 * out[k]
        y = out
    return y


@needs_gcc
@pytest.mark.parametrize("name", CASES)
def test_compiled_filters_equal_python(name, compiled):
    code, made, _ = compiled(name)
    rate = made.rate_hz
    x = np.random.default_rng(3).normal(size=3000)
    for what, filter_ in (("model", made.model), ("correction", made.correction)):
        wanted = in_python(filter_, x)
        size = np.max(np.abs(wanted))
        np.testing.assert_allclose(code.run(what, x), wanted, rtol=0, atol=1e-12 * size)
        # A float keeps 24 bits of each tap, coefficient and sample: the error grows with the sums they are part of.
        terms = np.abs(filter_.taps.taps).sum() * np.max(
            np.abs(filter_.sections.response(np.geomspace(1e-3, 0.5, 500) * rate))
        )
        error = np.max(np.abs(code.run(what, x, np.float32) - wanted))
        assert error < 30 * 2.0**-24 * max(terms, size)


@needs_gcc
@pytest.mark.parametrize("name", SHORT)
def test_compiled_model_is_the_model_over_the_band(name, compiled):
    """Response to an impulse, transformed: 1e-9 in double, 1e-5 in float."""
    code, made, sensor = compiled(name)
    rate = made.rate_hz
    n = 40000
    impulse = np.zeros(n)
    impulse[0] = 1.0
    f = np.geomspace(*sensor.band_hz, 40)
    turn = np.exp(-2j * np.pi * np.outer(f, np.arange(n)) / rate)
    latency = int(code.number(r"SENSOR_MODEL_LATENCY (\d+)"))
    wanted = sensor.response(f) * np.exp(-2j * np.pi * f * latency / rate)
    found = code.run("model", impulse)
    assert abs(found[-1]) < 1e-15 * np.max(np.abs(found))
    np.testing.assert_allclose(turn @ found, wanted, rtol=1e-9)
    np.testing.assert_allclose(turn @ code.run("model", impulse, np.float32), wanted, rtol=1e-5)


@needs_gcc
@pytest.mark.parametrize("name", ["paper", "two modes", "coil inverted", "overdamped"])
def test_compiled_cell_is_the_network_by_first_order_hold(name, compiled):
    from vibrident.physics.discretisation import method
    from vibrident.physics.models.state_space import realise

    code, made, sensor = compiled(name)
    rate = made.rate_hz
    system = realise(sensor.model.rational(sensor.values))
    phi, gamma, c, d = (np.asarray(w) for w in method("foh").weights(system, 1.0 / rate, 0.0, 2))
    a = np.random.default_rng(5).normal(size=600)
    a[0] = 0.0  # the cell starts at rest, the network's record at its first sample
    x, wanted = np.zeros(len(phi)), []
    for now, following in itertools.pairwise(a):
        inputs = np.array([0.5 * (now + following), 0.5 * (following - now)])
        wanted.append(c @ x + d @ inputs)
        x = phi @ x + gamma @ inputs
    wanted = np.array(wanted)
    size = np.max(np.abs(wanted))
    np.testing.assert_allclose(code.run("cell", a)[:-1], wanted, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(code.run("cell", a, np.float32)[:-1], wanted, rtol=0, atol=3e-6 * size)


@needs_gcc
@pytest.mark.parametrize("name", CASES)
def test_cmsis_arrays_are_the_same_sections(name, compiled):
    from scipy import signal

    code, made, sensor = compiled(name)
    rate = made.rate_hz
    f = sensor.band
    for what, filter_ in (("model", made.model), ("correction", made.correction)):
        count, taps = (int(code.number(rf"SENSOR_{what.upper()}_{p} (\d+)")) for p in ("SECTIONS", "TAPS"))
        rows = code.array(f"sensor_{what}_sos", 5 * count).reshape(-1, 5)
        sos = np.column_stack([rows[:, :3], np.ones(count), -rows[:, 3:]])
        _, h = signal.freqz_sos(sos, 2 * np.pi * f / rate)
        np.testing.assert_allclose(
            h, filter_.sections.response(f), rtol=1e-5 if sensor.model.name.count("highpass") else 1e-8
        )
        np.testing.assert_array_equal(code.array(f"sensor_{what}_fir", taps), filter_.taps.taps)


@needs_gcc
@pytest.mark.parametrize("name", ["paper", "inverted", "late", "mems", "two modes", "critical", "coil two modes"])
def test_correction_undoes_the_model(name, compiled):
    """Tones through both filters come back as they were, late by both latencies, to the error in the comment."""
    code, made, sensor = compiled(name)
    rate = made.rate_hz
    stated = code.number(r"error (\S+) \(double\), \S+ \(float\), over")
    n = 30000
    t = np.arange(n) / rate
    tones = np.geomspace(*sensor.band_hz, 7) * np.array([1, 1, 1, 1, 1, 1, 0.999])
    a = np.sum(np.sin(2 * np.pi * tones[:, None] * t + np.arange(7)[:, None]), axis=0)
    back = code.run("correction", code.run("model", a))
    latency = sum(int(code.number(rf"SENSOR_{p}_LATENCY (\d+)")) for p in ("MODEL", "CORRECTION"))
    late = np.concatenate([np.zeros(latency), a])[:n]
    error = np.max(np.abs((back - late)[n // 2 :]))
    assert error < 7 * stated * 1.1 + 1e-9
    assert error > 0.01 * stated  # the comment is no empty caution


@needs_gcc
@pytest.mark.parametrize("name", CASES)
def test_correction_is_stable_and_band_limited(name, compiled):
    code, made, sensor = compiled(name)
    rate = made.rate_hz
    rows = code.array("sensor_correction_sos", 5 * int(code.number(r"SENSOR_CORRECTION_SECTIONS (\d+)"))).reshape(-1, 5)
    poles = np.concatenate([np.roots([1, -row[3], -row[4]]) for row in rows])
    assert np.max(np.abs(poles)) < 1.0
    stopped = code.number(r"less than 0.1 from (\S+) Hz on")
    inside = np.max(np.abs(made.correction.response(sensor.band)))
    if stopped < 0.499 * rate:
        outside = np.abs(made.correction.response(np.linspace(1.01 * stopped, 0.5 * rate, 500)))
        assert np.max(outside) < 0.11 * inside
    assert stopped < 6 * sensor.band_hz[1]


@needs_gcc
@pytest.mark.parametrize("name", ["paper", "mems", "coil"])
def test_comments_state_the_errors_that_the_code_has(name, compiled):
    code, made, sensor = compiled(name)
    f = sensor.band
    wanted = sensor.response(f) * made.model.late(f)
    stated = code.number(r"error (\S+) \(double\)")
    assert stated == pytest.approx(np.max(np.abs(made.model.response(f) / wanted - 1)), rel=0.01)
    assert stated < 1e-9
    assert code.number(r"error \S+ \(double\), (\S+) \(float\)") < 1e-5
    cell = made.cell.response(f) / sensor.without(sensor.apart).response(f)
    assert code.number(r"hold, without latency.*\n \*   error (\S+)") == pytest.approx(
        np.max(np.abs(cell - 1)), rel=0.01
    )


def test_every_parameter_and_its_uncertainty_stand_in_the_comment(tmp_path):
    made = case("everything")
    for path in export(made, "c", tmp_path, rate_hz=51200.0):
        text = path.read_text()
        for name, p in made.parameters.items():
            assert f"{name} = {p.value!r}" in text
            assert f"u = {p.standard_uncertainty!r}" in text
        about = text[: text.index(" */\n")]
        assert "*/" not in about  # the sensor's serial number tries to end it
    assert "the code holds no uncertainties" in text


def test_the_cells_error_falls_with_the_square_of_the_interval():
    sensor = read_sensor(paper())
    f = sensor.band
    errors = []
    for rate in (25600.0, 51200.0, 102400.0):
        cell = firmware(sensor, rate).cell
        errors.append(np.max(np.abs(cell.response(f) / sensor.response(f) - 1)))
    slopes = np.diff(np.log2(errors))
    np.testing.assert_allclose(slopes, -2.0, atol=0.05)


def test_rate_is_the_networks_where_none_is_given(tmp_path):
    made = replace(paper(), weights={"sampling_interval_s": 1 / 25600.0})
    header, _ = export(made, "c", tmp_path, name="msv")
    assert "#define MSV_RATE_HZ 25600.0" in header.read_text()


def test_what_would_be_wrong_is_refused(tmp_path):
    with pytest.raises(InputError, match="needs a sampling rate"):
        export(paper(), "c", tmp_path)
    with pytest.raises(InputError, match="does not fit this sampling rate"):
        export(paper(), "c", tmp_path, rate_hz=2000.0)
    with pytest.raises(InputError, match="resonance is above half"):
        export(case("piezo"), "c", tmp_path, rate_hz=51200.0)
    with pytest.raises(InputError, match="name cannot be used"):
        export(paper(), "c", tmp_path, rate_hz=51200.0, name="2; rm")
    with pytest.raises(InputError, match="too long for a delay line"):
        export(result("accelerometer+delay", {**PAPER, "delay": 1.0}), "c", tmp_path, rate_hz=51200.0)
    assert not list(tmp_path.iterdir())


@needs_gcc
def test_negative_delay_costs_latency_only(tmp_path):
    made = result("accelerometer+delay", {**PAPER, "delay": -2e-4})
    code = Compiled(made, 51200.0, tmp_path)
    assert code.number(r"SENSOR_MODEL_LATENCY (\d+)") >= 11
    assert code.number(r"error (\S+) \(double\)") < 1e-9
