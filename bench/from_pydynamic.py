"""Functions of PyDynamic beside this package's on the same data, into studies/pydynamic.md."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from bench.against import ENVIRONMENTS, ask
from bench.publish import put_between
from vibrident import Calibration, ResponseTable, correct, identify
from vibrident.data.records import FloatArray
from vibrident.export.filters import model_filter
from vibrident.export.sensor import read_sensor
from vibrident.physics.models import parse
from vibrident.result import Result
from vibrident.show.media import markdown

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "studies" / "pydynamic.md"
NAMES_PAGE = ROOT / "docs" / "pydynamic.md"
TRUE = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
NAMES = ("sensitivity", "damping_ratio", "natural_frequency")  # in the order of PyDynamic
RATE_HZ = 12800.0
HZ = np.geomspace(10.0, 1000.0, 21)
GRID_HZ = np.linspace(10.0, 0.2 * RATE_HZ, 400)
AT_HZ = np.array([100.0, 600.0, 1000.0])
TONES_HZ = 12.8 * np.array([10, 25, 50, 75])  # whole periods in 1,000 samples
# V, standard deviations of white noise.
TONE_NOISE = 1e-3
SHOCK_NOISE = 1e-3
LOW_PASS_HZ = 2000.0
SHOCK_SAMPLES = 600


def main() -> None:
    """Compute both, and write the table."""
    inputs = _inputs()
    theirs = ask(
        ENVIRONMENTS / "pydynamic" / "bin" / "python", "pydynamic_functions_peer.py", inputs
    )
    table = ResponseTable(
        HZ, inputs["size"], inputs["phase"], inputs["size_u"], inputs["size_u"] / inputs["size"]
    )
    result = identify(Calibration(table=table, model="accelerometer"))
    named = NAMES_PAGE.read_text(encoding="utf-8")
    missing = [name for name in theirs["names"] if f"`{name}`" not in named]
    if missing:
        raise ValueError(
            f"{NAMES_PAGE}: expected every public function of PyDynamic, found none of "
            f"{', '.join(missing)}"
        )
    rows = [
        *_fits(theirs, result),
        *_curves(theirs, result),
        *_tones(theirs, inputs),
        *_shocks(theirs, inputs, result),
    ]
    head = ("same data", "PyDynamic " + theirs["version"], "ours", "truth")
    cells = [(what, f"{a}: {x}", f"{b}: {y}", truth) for a, b, what, x, y, truth in rows]
    put_between(PAGE, "pydynamic", "\n" + markdown.table(head, cells) + "\n")


def _response(hz: FloatArray) -> np.ndarray:
    return parse("accelerometer").frequency_response(TRUE, hz)


def _inputs() -> dict[str, Any]:
    rng = np.random.default_rng(20)
    u = 2e-3 * np.abs(_response(HZ))  # of real and imaginary part
    points = _response(HZ) + u * (rng.normal(size=HZ.size) + 1j * rng.normal(size=HZ.size))
    time = np.arange(1000) / RATE_HZ
    references = 10.0 * np.cos(2 * np.pi * TONES_HZ[:, None] * time)
    gains = _response(TONES_HZ)[:, None]
    responses = 10.0 * np.real(gains * np.exp(2j * np.pi * TONES_HZ[:, None] * time))
    t = np.arange(SHOCK_SAMPLES) / RATE_HZ
    pulse = 100.0 * np.exp(-0.5 * ((t - 0.015) / 4e-4) ** 2)
    hz = np.fft.rfftfreq(4 * SHOCK_SAMPLES, 1 / RATE_HZ)
    felt = np.fft.irfft(np.fft.rfft(pulse, 4 * SHOCK_SAMPLES) * _response(hz))[:SHOCK_SAMPLES]
    lines = np.fft.rfftfreq(SHOCK_SAMPLES, 1 / RATE_HZ)
    low_pass = 0.5 * (1 + np.cos(np.pi * np.clip((lines - LOW_PASS_HZ) / LOW_PASS_HZ, 0.0, 1.0)))
    return {
        "frequency_hz": HZ,
        "parts": np.concatenate([points.real, points.imag]),
        "parts_u": np.tile(u, 2),
        "size": np.abs(points),
        "phase": np.angle(points),
        "size_u": u,
        "true": np.array([TRUE[name] for name in NAMES]),
        "grid_hz": GRID_HZ,
        "at_hz": AT_HZ,
        "rate_hz": RATE_HZ,
        "references": references,
        "responses": responses + TONE_NOISE * rng.normal(size=responses.shape),
        "tone_noise": TONE_NOISE,
        "pulse": pulse,
        "shock": felt + SHOCK_NOISE * rng.normal(size=SHOCK_SAMPLES),
        "shock_noise": SHOCK_NOISE,
        "low_pass": low_pass,
        "low_pass_hz": LOW_PASS_HZ,
        "fit_to_hz": LOW_PASS_HZ,
    }


def _fits(theirs: dict[str, Any], result: Result) -> list[tuple[str, ...]]:
    units = {"sensitivity": "V/(m/s²)", "damping_ratio": "", "natural_frequency": "Hz"}
    rows = []
    for k, name in enumerate(NAMES):
        value = theirs["fit_som"]["values"][k]
        u = theirs["fit_som"]["u"][k]
        ours_here = result.parameters[name]
        stated = [
            f"{v:.6g}, u {s:.2g}"
            for v, s in ((value, u), (ours_here.value or math.nan, ours_here.standard_uncertainty))
        ]
        what = f"{name.replace('_', ' ')} {units[name]} of 21 points good to 0.2 %".replace(
            "  ", " "
        )
        rows.append(
            ("`fit_som`", "`identify` of a `ResponseTable`", what, *stated, f"{TRUE[name]:g}")
        )
    return rows


def _curves(theirs: dict[str, Any], result: Result) -> list[tuple[str, ...]]:
    wanted = _response(GRID_HZ)

    def off(parts: Any) -> str:
        theirs_here = (
            np.array(parts[0]) + 1j * np.array(parts[1]) if isinstance(parts, list) else parts
        )
        # Samples of delay.
        shifts = [np.exp(2j * np.pi * GRID_HZ * shift / RATE_HZ) for shift in (-1, 0, 1)]
        errors = [float(np.max(np.abs(theirs_here * shift / wanted - 1.0))) for shift in shifts]
        return f"{min(errors):.1e}"

    filtered, _ = model_filter(read_sensor(identify_exactly()), RATE_HZ)
    ours = filtered.response(GRID_HZ) / filtered.late(GRID_HZ)
    sensor = result.to_sensor()
    ours_here = sensor.uncertainty(AT_HZ)[0] * np.abs(sensor.frequency_response(AT_HZ))
    rows = [
        (
            "`sos_FreqResp`",
            "`to_sensor().frequency_response`",
            "curve to 0.2 of the rate: largest relative deviation",
            off(theirs["sos_FreqResp"]),
            off(parse("accelerometer").frequency_response(TRUE, GRID_HZ)),
            "0",
        ),
        (
            "`sos_phys2filter`, `impinvar`",
            "`export --format c`: model",
            "filter at 12.8 kHz: the same, but for delay",
            off(theirs["impinvar"]),
            off(ours),
            "0",
        ),
    ]
    for hz, u, mine in zip(AT_HZ, theirs["sos_absphase"], ours_here, strict=True):
        what = f"u of the magnitude at {hz:g} Hz, V/(m/s²)"
        rows.append(
            ("`sos_absphase`", "`to_sensor().uncertainty`", what, f"{u:.2e}", f"{mine:.2e}", "–")
        )
    return rows


def identify_exactly() -> Result:
    """Return a result with the true values, for the filter."""
    response = _response(HZ)
    table = ResponseTable(
        HZ, np.abs(response), np.angle(response), 1e-9 * np.abs(response), np.full(HZ.size, 1e-9)
    )
    return identify(Calibration(table=table, model="accelerometer"))


def _tones(theirs: dict[str, Any], inputs: dict[str, Any]) -> list[tuple[str, ...]]:
    calibration = Calibration.from_arrays(
        inputs["references"], inputs["responses"], RATE_HZ, excitation="sine", model="accelerometer"
    )
    measured = identify(calibration).measured
    rows = []
    for k, hz in enumerate(TONES_HZ):
        gain, u = theirs["Time2AmpPhase"][k]
        ours_here = f"{measured.magnitude[k]:.6f}, u {measured.magnitude_uncertainty[k]:.1e}"
        what = f"sensitivity at {hz:g} Hz; noise of 1 mV, told to PyDynamic, estimated by ours"
        truth = f"{abs(_response(np.array([hz]))[0]):.6f}"
        rows.append(
            (
                "`GUM_DFT`, `Time2AmpPhase`",
                "`measured` of `identify`",
                what,
                f"{gain:.6f}, u {u:.1e}",
                ours_here,
                truth,
            )
        )
    return rows


def _shocks(
    theirs: dict[str, Any], inputs: dict[str, Any], result: Result
) -> list[tuple[str, ...]]:
    shock = Calibration.from_arrays(None, inputs["shock"], RATE_HZ, excitation="decay")
    rows = []
    # Ours falls to half at 1.5 times its highest frequency; a Kaiser low-pass at its own.
    for name, how, to_hz in (
        ("FIRuncFilter", "`LSFIR`, `kaiser_lowpass`, `FIRuncFilter`", LOW_PASS_HZ / 1.5),
        ("DFT_deconv", "`GUM_DFT`, `DFT_deconv`, `GUM_iDFT`", LOW_PASS_HZ),
    ):
        (ours_here,) = correct(result, shock, band_hz=(0.0, to_hz)).corrections
        ours = _judged(ours_here.acceleration, ours_here.standard_uncertainty, inputs["pulse"])
        theirs_here = theirs[name]
        judged = _judged(
            np.array(theirs_here["acceleration"]), np.array(theirs_here["u"]), inputs["pulse"]
        )
        what = (
            "pulse of 100 m/s² and 0.4 ms from the response: "
            "rms error, mean u in m/s²; samples within 2 u"
        )
        rows.append((how, "`correct`", what, judged, ours, "0; 95 %"))
    return rows


def _judged(theirs_here: FloatArray, u: FloatArray, true: FloatArray) -> str:
    inner = slice(60, -60)  # without the ends, where a filter of PyDynamic has no samples yet
    off = (theirs_here - true)[inner]
    inside = 100 * np.mean(np.abs(off) < 2 * u[inner])
    return f"{np.sqrt(np.mean(off**2)):.3f}, {np.mean(u[inner]):.3f}; {inside:.0f} %"


if __name__ == "__main__":
    main()
