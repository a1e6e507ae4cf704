"""Demodulate optical signals: unwrap their phase, decimate it, and mask what cannot be followed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.interferometer import effects, phase
from vibrident.data.interferometer.carrier import without_residual_carrier
from vibrident.data.interferometer.choice import EllipseChoice
from vibrident.data.interferometer.decimation import decimated, lost_at_an_end, spoilt_outputs
from vibrident.data.interferometer.effects import CyclicError, cyclic_error
from vibrident.data.interferometer.phase import (
    MAX_FRACTION_TURNS,
    TURN,
    PhasePath,
    turns_over_gap,
)
from vibrident.data.interferometer.setting import (
    BoolArray,
    FloatArray,
    Gap,
    Interferometer,
    SampledSignals,
)
from vibrident.data.interferometer.sine import FittedSine, fit_sine, without_slow_motion
from vibrident.data.interferometer.summary import OpticalFinding, OpticalSummary
from vibrident.data.interferometer.survey import Survey

MAX_LEFT_OUT_SHARE = 0.5  # of a record's samples
MAX_GAPS = 400  # gaps whose missing turns are determined
EXCERPT_SAMPLES = 2000
PICTURE_POINTS = 4000  # samples of both signals that a picture shows
#: Largest change of phase from sample to sample where the phase also jumps: above it, turns are
#: missed elsewhere, too.
MAX_CHANGE_BESIDE_JUMPS_RAD = 2.3


@dataclass(frozen=True, eq=False)
class Demodulated:
    """Displacement from optical signals.

    Attributes:
        displacement_m: shape (n,).
        valid: shape (n,), False where the displacement is left out.
        first: position of the first sample, in samples of the optical signals.
        factor: distance of the samples, in samples of the optical signals.
        summary: quality of the signals.
        answer: effect of phase errors on this record.
        carrier: residual carrier of a heterodyne signal of a sine, rad, as a function of the
            optical sample's index; None for others.
    """

    displacement_m: FloatArray
    valid: BoolArray
    first: int
    factor: int
    summary: OpticalSummary
    answer: effects.PhaseErrorResponse
    carrier: np.polynomial.Legendre | None = None


def demodulate(
    signals: SampledSignals,
    setting: Interferometer,
    survey: Survey,
    choice: EllipseChoice,
    factor: int,
    name: str,
    sine_hz: float | None,
    highest_hz: float,
    carrier_hz: float | None = None,
) -> Demodulated:
    """Return the displacement from two signals in quadrature.

    Args:
        signals: the signals.
        setting: of the interferometer.
        survey: of the signals.
        choice: of the ellipse.
        factor: optical samples for each of the displacement.
        name: of the record, for messages.
        sine_hz: approximate frequency of a sine; None for other motion.
        highest_hz: frequency of the sine, or the highest that stands above the noise.
        carrier_hz: of the heterodyne signal, if any.

    Raises:
        InputError: the motion is too fast, or too much of the phase is lost.
    """
    path = PhasePath()
    knots = [(index, ellipse.for_phase) for index, ellipse in choice.knots]
    blocks = phase.unwrapped(signals, choice.ellipse.for_phase, knots, path, choice.error)
    phase_rad = decimated(blocks, signals.samples, factor)
    rate_hz = signals.rate_hz / factor
    position = lost_at_an_end(factor) + factor * np.arange(phase_rad.shape[0])
    is_intact = ~spoilt_outputs(path.gaps, signals.samples, factor)
    _require_slow(path, name)
    phase_rad, segment = _restore_turns(signals, choice, path.gaps, phase_rad, position)
    if sine_hz is not None:
        phase_rad, segment = _join_segments(phase_rad, segment, is_intact, rate_hz, sine_hz)
    in_main = is_intact & (segment == _longest_segment(segment, is_intact))
    # An acceleration needs no number of turns.
    valid = is_intact if sine_hz is None else in_main
    left_out = 1.0 - float(np.mean(valid)) if valid.size else 1.0
    _require_enough(left_out, name)
    carrier = None
    if carrier_hz is not None:
        phase_rad, parabola = _remove_carrier(phase_rad, in_main, rate_hz, sine_hz, position)
        slope = float(parabola.deriv()(np.mean(parabola.domain)))
        carrier_hz += slope * signals.rate_hz / TURN
        # The slope of another motion than a sine is not known.
        carrier = parabola if sine_hz is not None else None
    sine = None
    if sine_hz is not None:
        phase_rad, sine = without_slow_motion(phase_rad, valid, rate_hz, sine_hz)
    phase_rad = phase_rad - np.mean(phase_rad[valid])
    displacement_m = phase_rad * setting.metres_per_radian
    open_gaps = 0 if sine_hz is None else int(np.unique(segment[is_intact]).size - 1)
    cyclic = None
    if carrier_hz is None or carrier is not None:
        motion_signals = signals if carrier is None else without_residual_carrier(signals, carrier)
        turns_per_sample = path.length / TURN / signals.samples
        cyclic = cyclic_error(
            motion_signals, choice.ellipse, choice.knots, turns_per_sample, highest_hz
        )
    excerpt_s, excerpt_m = _excerpt(position / signals.rate_hz, displacement_m, valid, sine_hz)
    cyclic_amplitudes = []
    if cyclic is not None:
        cyclic_amplitudes = [(n, *cyclic.amplitude(i)) for i, n in enumerate(effects.ORDERS)]
    summary = OpticalSummary(
        setting=setting,
        rate_hz=signals.rate_hz,
        samples=signals.samples,
        factor=factor,
        ellipse=choice.ellipse,
        origin=choice.origin,
        changes=choice.changes,
        fringes=(path.highest - path.lowest) / TURN,
        path_fringes=path.length / TURN,
        fastest_rad=path.fastest,
        gaps=len(path.gaps),
        jumps=sum(gap.jump for gap in path.gaps),
        open_gaps=open_gaps,
        left_out=left_out,
        counted=path.counted,
        by_phase=path.by_phase,
        phase_noise_rad=choice.ellipse.radial_noise,
        points=survey.points[:, :: max(survey.points.shape[1] // PICTURE_POINTS, 1) | 1],
        excerpt_s=excerpt_s,
        excerpt_m=excerpt_m,
        carrier_hz=carrier_hz,
        cyclic=tuple(cyclic_amplitudes),
        findings=(*choice.findings, *_slip_findings(path, open_gaps, left_out, name)),
    )
    answer = _phase_error_response(phase_rad, in_main, rate_hz, sine, choice, signals, cyclic)
    return Demodulated(displacement_m, valid, int(position[0]), factor, summary, answer, carrier)


def _restore_turns(
    signals: SampledSignals,
    choice: EllipseChoice,
    gaps: Sequence[Gap],
    phase_rad: FloatArray,
    position: np.ndarray,
) -> tuple[FloatArray, np.ndarray]:
    """Return the phase with the turns lost in gaps restored, and the segment of each sample.

    Gaps whose turns are unknown separate segments, which are numbered from 0.
    """
    shift = np.zeros(phase_rad.shape[0])
    segment = np.zeros(phase_rad.shape[0], dtype=int)
    for number, gap in enumerate(gaps):
        after_gap = slice(int(np.searchsorted(position, gap.start)), None)
        missing_turns = turns_over_gap(signals, choice.ellipse, gap) if number < MAX_GAPS else None
        if missing_turns is None:
            segment[after_gap] += 1
        else:
            shift[after_gap] += TURN * missing_turns
    return phase_rad + shift, segment


def _excerpt(
    time_s: FloatArray, values: FloatArray, valid: BoolArray, sine_hz: float | None
) -> tuple[FloatArray, FloatArray]:
    """Return times and values to show, EXCERPT_SAMPLES or a few more.

    Of a sine, consecutive samples, around the first one left out if any; of other motion, every
    n-th sample of the record.
    """
    if sine_hz is None:
        span = slice(0, None, max(valid.size // EXCERPT_SAMPLES, 1))
    else:
        centre = 0 if valid.all() else int(np.argmin(valid))
        latest = max(valid.size - EXCERPT_SAMPLES, 0)
        start = int(np.clip(centre - EXCERPT_SAMPLES // 2, 0, latest))
        span = slice(start, start + EXCERPT_SAMPLES)
    return time_s[span], np.where(valid, values, np.nan)[span]


def _longest_segment(segment: np.ndarray, usable: BoolArray) -> int:
    return int(np.argmax(np.bincount(segment, weights=usable))) if segment.size else 0


def _join_segments(
    phase_rad: FloatArray,
    segment: np.ndarray,
    usable: BoolArray,
    rate_hz: float,
    sine_hz: float,
) -> tuple[FloatArray, np.ndarray]:
    """Return the phase with the segments of a sine joined, and the segment of each sample.

    The sine of the longest segment determines the turns by which the others are off.
    """
    if segment.size == 0 or segment[-1] == 0:
        return phase_rad, segment
    phase_rad = phase_rad.copy()
    segment = segment.copy()
    main = _longest_segment(segment, usable)
    candidates = [number for number in np.unique(segment[usable]).tolist() if number != main]
    for number in sorted(candidates, key=lambda number: abs(number - main)):
        sine = fit_sine(phase_rad, usable & (segment == main), rate_hz, sine_hz)
        index = np.flatnonzero(usable & (segment == number))
        if sine is None or index.size < 3:
            continue
        turns = (phase_rad[index] - sine.at(index / rate_hz)) / TURN
        median = float(np.median(turns))
        distance = abs(median - round(median))
        if distance < MAX_FRACTION_TURNS and float(np.std(turns)) < MAX_FRACTION_TURNS:
            phase_rad[segment == number] -= TURN * round(median)
            segment[segment == number] = main
    return phase_rad, segment


def _remove_carrier(
    phase_rad: FloatArray,
    valid: BoolArray,
    rate_hz: float,
    sine_hz: float | None,
    position: np.ndarray,
) -> tuple[FloatArray, np.polynomial.Legendre]:
    """Return the phase without the carrier's error and drift, and these as a parabola.

    No acceleration sensor responds to a parabola. A sine is fitted in turns with it, to separate
    them. The parabola is a function of ``position``.
    """
    t = np.linspace(-1.0, 1.0, phase_rad.shape[0])
    design = np.stack([np.ones_like(t), t, 1.5 * t * t - 0.5], axis=1)
    time_s = np.arange(phase_rad.shape[0]) / rate_hz
    wave = np.zeros(phase_rad.shape)
    total = np.zeros(3)
    for _ in range(1 if sine_hz is None else 4):
        target = (phase_rad - wave)[valid]
        coefficients, *_ = np.linalg.lstsq(design[valid], target, rcond=None)
        phase_rad = phase_rad - design @ coefficients
        total += coefficients
        sine = None if sine_hz is None else fit_sine(phase_rad, valid, rate_hz, sine_hz)
        if sine is not None:
            wave = sine.at(time_s) - sine.mean - sine.slope * time_s
    domain = [float(position[0]), float(position[-1])]
    return phase_rad, np.polynomial.Legendre(total, domain=domain)


def _phase_error_response(
    phase_rad: FloatArray,
    valid: BoolArray,
    rate_hz: float,
    sine: FittedSine | None,
    choice: EllipseChoice,
    signals: SampledSignals,
    cyclic: CyclicError | None,
) -> effects.PhaseErrorResponse:
    """Return the effect of phase errors on the record, at the sine or in bands of frequency."""
    radial_noise = choice.ellipse.radial_noise
    if sine is not None:
        frequency_hz, harmonics = effects.harmonics_of_sine(
            sine.amplitude, sine.mean, sine.frequency_hz
        )
        noise = radial_noise * np.sqrt(2.0 / signals.samples) / max(sine.amplitude, 1e-300)
    else:
        frequency_hz, harmonics = effects.harmonics_of_motion(phase_rad, valid, rate_hz)
        rms = float(np.std(phase_rad[valid]))
        noise = radial_noise / np.sqrt(signals.samples) / max(rms, 1e-300)
    return effects.PhaseErrorResponse(
        frequency_hz,
        harmonics,
        np.full(frequency_hz.shape, noise),
        choice.group,
        choice.ellipse.shape_covariance,
        cyclic,
    )


def _slip_findings(
    path: PhasePath, open_gaps: int, left_out: float, name: str
) -> list[OpticalFinding]:
    """Return the doubts about the number of fringes."""
    if not path.gaps and path.counted == path.by_phase:
        return []
    lost = [gap for gap in path.gaps if not gap.jump]
    jumps = len(path.gaps) - len(lost)
    doubts = []
    if lost:
        doubts.append(f"the amplitude is lost in {len(lost)} stretch{'es' * (len(lost) > 1)}")
    if jumps:
        doubts.append(
            f"the phase jumps by nearly half a turn or more in {jumps} place{'s' * (jumps > 1)}"
        )
    if path.counted != path.by_phase:
        doubts.append(
            f"{path.counted} half fringes are counted in the signal, {path.by_phase} in the phase"
        )
    text = f"{name}: {' and '.join(doubts)}; {100 * left_out:.2g} % of the displacement is left out"
    if open_gaps:
        text += f", as the motion does not determine the fringes lost in {open_gaps} of the gaps"
    return [OpticalFinding("fringe_slip", text + ".")]


def _require_slow(path: PhasePath, name: str) -> None:
    if any(gap.jump for gap in path.gaps) and path.fastest > MAX_CHANGE_BESIDE_JUMPS_RAD:
        raise InputError(
            "The motion is too fast for the sampling of the optical signals.",
            expected="less than half a turn of phase (an eighth of the wavelength, for one pass) "
            "from sample to sample",
            found=f"{path.fastest:.3g} rad, and beyond, from sample to sample",
            where=name,
            remedy="sample the optical signals faster, or move more slowly",
        )


def _require_enough(left_out: float, name: str) -> None:
    if left_out > MAX_LEFT_OUT_SHARE:
        raise InputError(
            "The interferometer's phase cannot be followed.",
            expected="two signals whose amplitude holds, with less than half a turn of phase from "
            "sample to sample",
            found=f"{100 * left_out:.3g} % of the record lost",
            where=name,
            remedy="look at the Lissajous figure (⟦command = inspect⟧); sample faster, or move "
            "more slowly",
        )
