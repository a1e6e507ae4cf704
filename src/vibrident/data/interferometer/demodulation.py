"""Demodulate optical signals: phase, decimated displacement, and samples that are left out."""

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
    Gap,
    PhasePath,
    turns_over_gap,
)
from vibrident.data.interferometer.setting import (
    BoolArray,
    FloatArray,
    Interferometer,
    SampledSignals,
)
from vibrident.data.interferometer.sine import FittedSine, fit_sine, without_slow_motion
from vibrident.data.interferometer.summary import OpticalFinding, OpticalSummary
from vibrident.data.interferometer.survey import Survey

MAX_LEFT_OUT_SHARE = 0.5  # of a record's samples
MAX_GAPS = 400  # gaps that are examined one by one
EXCERPT_SAMPLES = 2000
# rad; where the phase jumps, a larger change elsewhere means that turns are missed there, too
MAX_CHANGE_BESIDE_JUMPS_RAD = 2.3


@dataclass(frozen=True, eq=False)
class Demodulated:
    """Displacement from optical signals."""

    displacement_m: FloatArray  # shape (n,)
    valid: BoolArray  # shape (n,), False where the displacement is left out
    first: int  # position of the first sample, in samples of the optical signals
    factor: int  # distance of the samples, in samples of the optical signals
    summary: OpticalSummary  # quality of the signals
    answer: effects.PhaseErrorResponse  # effect of the ellipse's errors on this record
    # residual carrier beside a sine, rad, over the index of an optical sample; None for others
    carrier: np.polynomial.Legendre | None = None


def demodulate(
    signals: SampledSignals,
    setting: Interferometer,
    survey: Survey,
    choice: EllipseChoice,
    factor: int,
    name: str,
    near_hz: float | None,
    highest_hz: float,
    carrier_hz: float | None = None,
) -> Demodulated:
    """Return the displacement of two signals in quadrature.

    Args:
        signals: the signals.
        setting: of the interferometer.
        survey: of the signals.
        choice: of the ellipse.
        factor: optical samples for each of the displacement.
        name: of the record, for messages.
        near_hz: approximate frequency of a sine, None for other motion.
        highest_hz: of the motion: that of a sine, or the highest that stands above the noise.
        carrier_hz: of the heterodyne signal, if any.

    Raises:
        InputError: the motion is too fast, or too much of the phase is lost.
    """
    path = PhasePath()
    knots = [(at, piece.for_phase) for at, piece in choice.knots]
    blocks = phase.unwrapped(signals, choice.ellipse.for_phase, knots, path, choice.error)
    values = decimated(blocks, signals.samples, factor)
    position = lost_at_an_end(factor) + factor * np.arange(values.shape[0])
    spoilt = spoilt_outputs([(gap.start, gap.stop) for gap in path.gaps], signals.samples, factor)
    values, piece = _bridged(signals, choice, path.gaps, values, position)
    rate = signals.rate_hz / factor
    _require_slow(path, name)
    if near_hz is not None:
        values, piece = _joined(values, piece, ~spoilt, rate, near_hz)
    main = ~spoilt & (piece == _longest_piece(piece, ~spoilt))
    valid = ~spoilt if near_hz is None else main  # an acceleration needs no number of turns
    left_out = 1.0 - float(np.mean(valid)) if valid.size else 1.0
    _require_enough(left_out, name)
    residual_carrier = None
    if carrier_hz is not None:
        values, residual_carrier = _without_carrier(values, main, rate, near_hz, position)
        carrier_hz += (
            float(residual_carrier.deriv()(np.mean(residual_carrier.domain)))
            * signals.rate_hz
            / TURN
        )
    sine = None
    if near_hz is not None:
        values, sine = without_slow_motion(values, valid, rate, near_hz)
    values = values - np.mean(values[valid])
    open_gaps = 0 if near_hz is None else int(np.unique(piece[~spoilt]).size - 1)
    # beside other motion the carrier's slope is not known
    carrier = None if near_hz is None else residual_carrier
    cyclic = None
    if residual_carrier is None or carrier is not None:
        motion_signals = signals if carrier is None else without_residual_carrier(signals, carrier)
        pace = path.length / TURN / signals.samples
        cyclic = cyclic_error(motion_signals, choice.ellipse, choice.knots, pace, highest_hz)
    answer = _phase_error_response(values, main, rate, sine, choice, signals, cyclic)
    summary = OpticalSummary(
        setting,
        signals.rate_hz,
        signals.samples,
        factor,
        choice.ellipse,
        choice.origin,
        choice.changes,
        (path.highest - path.lowest) / TURN,
        path.length / TURN,
        path.fastest,
        len(path.gaps),
        sum(gap.jump for gap in path.gaps),
        open_gaps,
        left_out,
        path.counted,
        path.by_phase,
        choice.ellipse.radial_noise,
        survey.points[:, :: max(survey.points.shape[1] // 4000, 1) | 1],  # enough for pictures
        *_excerpt(position / signals.rate_hz, values * setting.metres_per_radian, valid, near_hz),
        carrier_hz,
        ()
        if cyclic is None
        else tuple((n, *cyclic.amplitude(i)) for i, n in enumerate(effects.ORDERS)),
        findings=(*choice.findings, *_slip_findings(path, open_gaps, left_out, name)),
    )
    return Demodulated(
        values * setting.metres_per_radian,
        valid,
        int(position[0]),
        factor,
        summary,
        answer,
        carrier,
    )


def _bridged(
    signals: SampledSignals,
    choice: EllipseChoice,
    gaps: Sequence[Gap],
    values: FloatArray,
    position: np.ndarray,
) -> tuple[FloatArray, np.ndarray]:
    """Return the values with the turns lost in gaps restored, and the piece of each value.

    Gaps of unknown turns separate pieces.
    """
    shift = np.zeros(values.shape[0])
    piece = np.zeros(values.shape[0], dtype=int)
    for number, gap in enumerate(gaps):
        behind = int(np.searchsorted(position, gap.start))
        missing_turns = turns_over_gap(signals, choice.ellipse, gap) if number < MAX_GAPS else None
        if missing_turns is None:
            piece[behind:] += 1
        else:
            shift[behind:] += TURN * missing_turns
    return values + shift, piece


def _excerpt(
    time_s: FloatArray, values: FloatArray, valid: BoolArray, near_hz: float | None
) -> tuple[FloatArray, FloatArray]:
    """Return the times and values to show, of few samples.

    Some periods of a sine, about samples left out if any; of other motion every n-th sample of the
    record.
    """
    span = slice(0, None, max(valid.size // EXCERPT_SAMPLES, 1))
    if near_hz is not None:
        first = int(np.argmin(valid)) if not valid.all() else 0
        start = int(np.clip(first - EXCERPT_SAMPLES // 2, 0, max(valid.size - EXCERPT_SAMPLES, 0)))
        span = slice(start, start + EXCERPT_SAMPLES)
    return time_s[span], np.where(valid, values, np.nan)[span]


def _longest_piece(piece: np.ndarray, usable: BoolArray) -> int:
    return int(np.argmax(np.bincount(piece, weights=usable.astype(float)))) if piece.size else 0


def _joined(
    values: FloatArray, piece: np.ndarray, usable: BoolArray, rate: float, near_hz: float
) -> tuple[FloatArray, np.ndarray]:
    """Return the values with the pieces of a sine joined, and the piece of each value.

    The sine of the longest piece gives the turns by which the others are off.
    """
    if piece.size == 0 or piece[-1] == 0:
        return values, piece
    values = values.copy()
    piece = piece.copy()
    main = _longest_piece(piece, usable)
    pieces = [p for p in np.unique(piece[usable]).tolist() if p != main]
    for number in sorted(pieces, key=lambda p: abs(p - main)):
        in_main = usable & (piece == main)
        sine = fit_sine(values, in_main, rate, near_hz)
        inside = usable & (piece == number)
        if sine is None or inside.sum() < 3:
            continue
        off = (values[inside] - sine.at(np.flatnonzero(inside) / rate)) / TURN
        turns = float(np.median(off))
        if (
            abs(turns - round(turns)) < MAX_FRACTION_TURNS
            and float(np.std(off)) < MAX_FRACTION_TURNS
        ):
            values[piece == number] -= TURN * round(turns)
            piece[piece == number] = main
    return values, piece


def _without_carrier(
    values: FloatArray, valid: BoolArray, rate: float, near_hz: float | None, position: np.ndarray
) -> tuple[FloatArray, np.polynomial.Legendre]:
    """Return the phase without the carrier's error and drift, and these as a parabola.

    No acceleration sensor responds to a parabola. A sine is fitted in turns with it, to separate
    them. The parabola is a function of ``position``.
    """
    t = np.linspace(-1.0, 1.0, values.shape[0])
    design = np.stack([np.ones_like(t), t, 1.5 * t * t - 0.5], axis=1)
    time = np.arange(values.shape[0]) / rate
    wave = np.zeros(values.shape)
    total = np.zeros(3)
    for _ in range(1 if near_hz is None else 4):
        coefficients, *_ = np.linalg.lstsq(design[valid], (values - wave)[valid], rcond=None)
        values = values - design @ coefficients
        total += coefficients
        sine = None if near_hz is None else fit_sine(values, valid, rate, near_hz)
        if sine is not None:
            wave = sine.at(time) - sine.mean - sine.slope * time
    return values, np.polynomial.Legendre(total, domain=[float(position[0]), float(position[-1])])


def _phase_error_response(
    values: FloatArray,
    valid: BoolArray,
    rate: float,
    sine: FittedSine | None,
    choice: EllipseChoice,
    signals: SampledSignals,
    cyclic: CyclicError | None,
) -> effects.PhaseErrorResponse:
    noise = choice.ellipse.radial_noise
    if sine is not None:
        frequency, harmonics = effects.harmonics_of_sine(
            sine.amplitude, sine.mean, sine.frequency_hz
        )
        relative_noise = np.array(
            [noise * np.sqrt(2.0 / signals.samples) / max(sine.amplitude, 1e-300)]
        )
    else:
        frequency, harmonics = effects.harmonics_of_motion(values, valid, rate)
        size = float(np.std(values[valid]))
        relative_noise = np.full(
            frequency.shape, noise / np.sqrt(signals.samples) / max(size, 1e-300)
        )
    covariance = choice.ellipse.shape_covariance
    return effects.PhaseErrorResponse(
        frequency, harmonics, relative_noise, choice.group, covariance, cyclic
    )


def _slip_findings(
    path: PhasePath, open_gaps: int, left_out: float, name: str
) -> list[OpticalFinding]:
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
        text += (
            f", as for {open_gaps} of the gaps the motion does not determine the number of fringes"
        )
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
