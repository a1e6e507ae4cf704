"""Write the tracker as C99: learner, detector and corrector in one header and one source.

The corrector is the model's inverse, a(t) = (V + 2 δ/ωn V̇ + V̈/ωn²)/S0: three fixed filters, a
low-pass and its derivatives, each times a coefficient that follows the parameters.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.escaping import c_comment
from vibrident.data.records import FloatArray
from vibrident.export.filters import checked_rate
from vibrident.export.form import Options, fill_template, write_c_comment
from vibrident.export.sensor import ExportedSensor, identity
from vibrident.use.tracking import learner, network, tracker
from vibrident.use.tracking.information import (
    INITIAL_INFORMATION,
    MIN_INDEPENDENT_PART,
    RETAINED_INFORMATION,
)
from vibrident.use.tracking.knowledge import SECONDS_A_YEAR
from vibrident.use.tracking.state import TrackerSettings
from vibrident.use.tracking.tracker import Tracker

REACH = 48  # samples of the corrector on either side
#: The corrector passes all up to so much of the sampling rate beyond the band, and nothing
#: TRANSITION further on.
FLAT = 0.03
TRANSITION = 0.1
BLACKMAN = (0.42, 0.5, 0.08)  # cosines of its window (Oppenheim & Schafer 2010, sec. 7.5)


def build_tracker(sensor: ExportedSensor, rate_hz: float, settings: TrackerSettings) -> Tracker:
    """Return the Python tracker that the C code equals.

    Raises:
        InputError: the model is not one that the C code has, or an uncertainty is not stated.
    """
    model = sensor.model
    if model.core.output != "displacement" or not all(addon.is_delay for addon in model.add_ons):
        raise InputError(
            "This sensor cannot be exported as a tracker.",
            expected="a displacement pickup of second order, with or without a delay",
            found=repr(sensor.model.name),
            where="result, model",
            remedy="leave ⟦export.online⟧ out, or track it with ⟦command = track⟧",
        )
    sensor.identified.require_uncertainty()
    return Tracker(
        sensor.model,
        sensor.values,
        sensor.identified.covariance,
        rate_hz,
        sensor.quantity,
        settings,
    )


def corrector(high_hz: float, rate_hz: float, ahead_s: float) -> FloatArray:
    """Design a low-pass and its first two derivatives, shape (3, 2 REACH + 1).

    The oldest sample comes first; the filters are late by REACH samples. Kernel and window are
    differentiated together, so that the three filters are consistent.

    Args:
        high_hz: highest frequency of the band.
        rate_hz: sampling rate.
        ahead_s: time by which the filters are earlier, less than a sampling interval.
    """
    passed_hz = high_hz + FLAT * rate_hz
    f = np.linspace(0.0, passed_hz + TRANSITION * rate_hz, 4001)
    share = np.clip((f - passed_hz) / (f[-1] - passed_hz), 0.0, 1.0)
    spectrum = 1.0 + np.cos(np.pi * share)  # twice the real half: both signs of frequency
    t = ahead_s - np.arange(-REACH, REACH + 1) / rate_hz
    angular = 2j * np.pi * f
    window_angular = 1j * np.pi * rate_hz / (REACH + 1)
    waves = np.exp(angular * t[:, None]) * spectrum
    # derivatives of kernel and window, orders 0 to 2
    kernel = [np.trapezoid((waves * angular**n).real, f, axis=1) / rate_hz for n in range(3)]
    window = [
        sum(
            c * ((window_angular * n) ** order * np.exp(window_angular * n * t)).real
            for n, c in enumerate(BLACKMAN)
        )
        for order in range(3)
    ]
    return np.array(
        [
            kernel[0] * window[0],
            kernel[1] * window[0] + kernel[0] * window[1],
            kernel[2] * window[0] + 2.0 * kernel[1] * window[1] + kernel[0] * window[2],
        ]
    )


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.h`` and ``NAME.c``."""
    rate = checked_rate(sensor, options.rate_hz)
    high = sensor.band_hz[1]
    widest = 0.5 - FLAT - TRANSITION
    if high > widest * rate:
        raise InputError(
            "The sampling rate is too low for the corrector.",
            expected=f"{high / widest:.6g} Hz or more, for a band up to {high:.6g} Hz",
            found=f"{rate:.6g} Hz",
            where="⟦export.rate_hz⟧",
            remedy="give a higher ⟦export.rate_hz⟧, or a lower ⟦export.band_hz⟧",
        )
    settings = TrackerSettings()
    tracked = build_tracker(sensor, rate, settings)
    values = _template_values(sensor, tracked, rate, options.name)
    paths = [folder / f"{options.name}.{suffix}" for suffix in ("h", "c")]
    for path in paths:
        path.write_text(fill_template(f"online{path.suffix}", values), encoding="utf-8")
    return paths


def _template_values(
    sensor: ExportedSensor, tracked: Tracker, rate: float, name: str
) -> dict[str, str]:
    net = tracked.network
    settings = tracked.settings
    thresholds = tracked.knowledge.thresholds
    lag = net.first + net.taps - 1
    delay = float(sensor.model.delay_s(sensor.values)) if net.model.has_delay else 0.0
    late = round(delay * rate)
    start = [sensor.values[parameter] for parameter in net.model.parameter_names]
    drift = float(np.max(settings.drift_per_year))  # the C tracker has one for all
    rate_of_walk = drift**2 / SECONDS_A_YEAR
    about = [
        *identity(sensor),
        "",
        f"tracker at {rate!r} Hz: {net.parameters} parameters, blocks of {settings.block} samples,",
        f"{settings.false_alarms_per_day:g} false alarms a day of motion,",
        f"random walk {drift:g} a year",
        f"corrector: late by {REACH + late} samples, for a band up to {sensor.band_hz[1]:.6g} Hz",
        "",
        "IEEE 754 arithmetic is needed: do not compile with -ffast-math.",
    ]
    k = net.nuisances
    return {
        "ABOUT": write_c_comment(about),
        "GUARD": name.upper(),
        "N": name,
        "RATE": repr(rate),
        "P": str(net.parameters),
        "Q": str(net.terms),
        "AR": str(settings.order),
        "BLOCK": str(settings.block),
        "PARTS": str(settings.segment_lengths),
        "LEVELS": str(settings.levels),
        "TAPS": str(net.taps),
        "REFERENCES": str(net.taps + max(0, -lag)),
        "RESPONSES": str(1 + max(0, lag)),
        "CORRECTOR_TAPS": str(2 * REACH + 1),
        "CORRECTOR_LATENCY": str(REACH + late),
        "NUMBERS": str(sum(view.size for view in tracked.state.views)),
        "NAMES": ", ".join(net.model.parameter_names),
        "INPUT": c_comment(sensor.input_unit),
        "OUTPUT": c_comment(sensor.output_unit),
        "INTERVAL": repr(net.interval_s),
        "DELAY": repr(net.delay_s),
        "FIRST": str(net.first),
        "FIRST_PART": str(tracker.PARTS_OF_FIRST_BLOCK),
        "SCALE": _text(net.scale),
        "START": _text(start),
        "PRIOR": _text(tracked.state.root[k:, k:-1]),
        "POSITIVE": ", ".join(str(int(is_positive)) for is_positive in net.positive),
        "WALKS": ", ".join(str(int(spec.kind != "time")) for spec in net.model.parameters),
        "DRIFT_RATE": repr(rate_of_walk),
        "REFERENCE_U": repr(settings.reference_uncertainty),
        "CHANGE": _text(thresholds.change),
        "NOISE": _text(thresholds.noise),
        "LOUDER": _text(thresholds.louder),
        "FURTHER": _text(thresholds.further),
        "FILTER": _text(net.filters.T),
        "CORRECTOR": _text(corrector(sensor.band_hz[1], rate, delay - late / rate)),
        "EXCITED": repr(learner.MIN_EXCITATION_RATIO),
        "NONE": repr(INITIAL_INFORMATION),
        "LEFT": repr(RETAINED_INFORMATION),
        "WITHIN": repr(MIN_INDEPENDENT_PART),
        "ALONE": repr(tracker.MIN_SEPARATE_INFORMATION),
        "FURTHEST": repr(network.MAX_STEP_FACTOR),
    }


def _text(values: object) -> str:
    """Return numbers of one or two dimensions as an initialiser; exact."""
    array = np.asarray(values, dtype=float)
    if array.ndim == 1:
        return ", ".join(repr(float(value)) for value in array)
    return ",\n    ".join("{" + _text(row) + "}" for row in array)
