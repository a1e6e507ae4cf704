"""Accuracy: parameters from records without channel noise, by discretisation and sampling rate."""

from __future__ import annotations

import numpy as np

from bench.figures import Figure, Options, Section, steps
from bench.truth import COLUMNS, SAMPLES, SENSOR, model, paper_truth, relative_errors
from vibrident.base.errors import VibridentError
from vibrident.fit.estimators import Ipnn
from vibrident.fit.problem import Evidence
from vibrident.physics.discretisation import method
from vibrident.physics.models.state_space import realise

DISCRETISATIONS = ("bandlimited", "foh", "tustin", "zoh", "euler")
LONG_SAMPLES = 100_000
#: (samples per second, samples a record)
RECORDINGS = (
    (2560.0, SAMPLES),
    (16000.0, SAMPLES),
    (51200.0, SAMPLES),
    (1e6, SAMPLES),
    (1e6, LONG_SAMPLES),
)
MAX_ERROR = 1e-6


def measure(options: Options) -> Section:
    """Return the relative errors of the three parameters.

    The target is for the band-limited network; the others show the cost.
    """
    figures = []
    recordings = RECORDINGS[:3] if options.quick else RECORDINGS
    for rate_hz, samples in steps("accuracy", recordings):
        evidence = Evidence.gather(paper_truth(rate_hz, samples)[0], model())
        figures += [_figure(evidence, name, rate_hz, samples) for name in DISCRETISATIONS]
    remarks = (
        "16 000 samples at 1 MHz last 16 ms: 0.16 period of 10 Hz and less than one period of "
        "eight of the 21 tones. "
        f"{LONG_SAMPLES:,} samples hold one period of the lowest.".replace(",", " "),
        "Start values come from the records themselves; all records start from rest; no noise on "
        "the channels.",
    )
    return Section("accuracy", f"Accuracy, relative error: {COLUMNS}", tuple(figures), {}, remarks)


def _figure(evidence: Evidence, name: str, rate_hz: float, samples: int) -> Figure:
    what = f"{name}, {_rate(rate_hz)}, {samples // 1000} 000 samples"
    high = MAX_ERROR if name == "bandlimited" else None
    radius = spectral_radius(name, rate_hz)
    notes = (
        [] if radius < 1.0 else [f"unstable at the true parameters: spectral radius {radius:.2f}"]
    )
    short = sum(finding.code == "short_record" for finding in evidence.findings)
    notes += [f"{short} records shorter than 2 periods"] if short else []
    try:
        estimate = Ipnn(discretisation=name).fit(evidence)
    except (VibridentError, np.linalg.LinAlgError) as error:
        return Figure(
            what,
            {},
            "error",
            high=high,
            absolute=True,
            note="; ".join([*notes, _message_of(error)]),
        )
    errors = relative_errors(estimate.coordinates.values(estimate.z))
    notes += [] if estimate.trace.converged else [estimate.trace.status]
    return Figure(what, errors, "error", high=high, absolute=True, note="; ".join(notes))


def spectral_radius(name: str, rate_hz: float) -> float:
    """Return the largest |eigenvalue| of the discretised sensor at its true parameters.

    From 1 on the network is unstable.
    """
    chosen = method(name)
    system = realise(model().rational(SENSOR.parameters, "acceleration"))
    weights = chosen.weights(system, 1.0 / rate_hz, 0.0, chosen.fixed_terms or 4)
    return float(np.max(np.abs(np.linalg.eigvals(np.asarray(weights.transition)))))


def _rate(rate_hz: float) -> str:
    return f"{rate_hz / 1e6:g} MHz" if rate_hz >= 1e6 else f"{rate_hz / 1e3:g} kHz"


def _message_of(error: Exception) -> str:
    first_clause = str(error).splitlines()[0].split(":")[0]
    return f"no result: {type(error).__name__}: {first_clause}"
