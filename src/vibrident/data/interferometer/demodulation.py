"""The main path: optical signals → phase → decimated displacement, with omitted parts and reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.interferometer import effects, phase
from vibrident.data.interferometer.carrier import turned_back
from vibrident.data.interferometer.choice import Choice
from vibrident.data.interferometer.decimation import decimated, lost_at_an_end, spoilt_outputs
from vibrident.data.interferometer.effects import Cyclic, cyclic_error
from vibrident.data.interferometer.phase import TURN, WHOLE, Gap, Path, turns
from vibrident.data.interferometer.setting import BoolArray, FloatArray, Interferometer, Signals
from vibrident.data.interferometer.sine import Sine, fit_sine, without_slow_motion
from vibrident.data.interferometer.summary import OpticalFinding, OpticalSummary
from vibrident.data.interferometer.survey import Survey

MOST_LEFT_OUT = 0.5  # largest part of a record that may be left out
MOST_GAPS = 400  # most gaps that are examined one by one
EXCERPT = 2000  # samples of the excerpt
NEARLY_TOO_FAST = (
    2.3  # where the phase jumps, a larger change elsewhere means that turns are missed there too
)


@dataclass(frozen=True, eq=False)
class Demodulated:
    """A displacement from optical signals."""

    displacement_m: FloatArray  # shape (n,)
    valid: BoolArray  # shape (n,), False where it is left out
    first: int  # position of the first sample, in samples of the optical signals
    factor: int  # distance of the samples, in those
    summary: OpticalSummary  # what the signals show of their quality
    answer: effects.Answer  # effect of the ellipse's errors on this record
    # what was left of the carrier beside a sine, rad, over the index of an optical sample; None for
    # others
    carrier: np.polynomial.Legendre | None = None


def demodulate(
    signals: Signals,
    setting: Interferometer,
    seen: Survey,
    choice: Choice,
    factor: int,
    name: str,
    near_hz: float | None,
    highest_hz: float,
    carrier_hz: float | None = None,
) -> Demodulated:
    """Make a displacement of two signals in quadrature.

    ``seen``: the first look; ``factor``: optical samples for each of the displacement; ``near_hz``:
    approximate frequency of a sine, None for other motion; ``highest_hz``: of the motion: that of a
    sine, or the highest that stands above the noise; ``carrier_hz``: of the heterodyne signal, if
    any.
    """
    path = Path()
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
    main = ~spoilt & (piece == _longest(piece, ~spoilt))
    valid = ~spoilt if near_hz is None else main  # an acceleration needs no number of turns
    left_out = 1.0 - float(np.mean(valid)) if valid.size else 1.0
    _require_enough(left_out, name)
    left = None
    if carrier_hz is not None:
        values, left = _without_carrier(values, main, rate, near_hz, position)
        carrier_hz += float(left.deriv()(np.mean(left.domain))) * signals.rate_hz / TURN
    found = None
    if near_hz is not None:
        values, found = without_slow_motion(values, valid, rate, near_hz)
    values = values - np.mean(values[valid])
    open_gaps = 0 if near_hz is None else int(np.unique(piece[~spoilt]).size - 1)
    carrier = None if near_hz is None else left  # beside other motion its slope is not known
    around = None
    if left is None or carrier is not None:
        turned = signals if carrier is None else turned_back(signals, carrier)
        pace = path.length / TURN / signals.samples
        around = cyclic_error(turned, choice.ellipse, choice.knots, pace, highest_hz)
    answer = _answer(values, main, rate, found, choice, signals, around)
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
        seen.points[:, :: max(seen.points.shape[1] // 4000, 1) | 1],  # enough for pictures
        *_excerpt(position / signals.rate_hz, values * setting.metres_per_radian, valid, near_hz),
        carrier_hz,
        ()
        if around is None
        else tuple((n, *around.amplitude(i)) for i, n in enumerate(effects.ORDERS)),
        findings=(*choice.findings, *_slips(path, open_gaps, left_out, name)),
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
    signals: Signals, choice: Choice, gaps: Sequence[Gap], values: FloatArray, position: np.ndarray
) -> tuple[FloatArray, np.ndarray]:
    """Return the values with the turns lost in gaps restored, and the piece of each value: gaps of unknown turns part them."""
    shift = np.zeros(values.shape[0])
    piece = np.zeros(values.shape[0], dtype=int)
    for number, gap in enumerate(gaps):
        behind = int(np.searchsorted(position, gap.start))
        found = turns(signals, choice.ellipse, gap) if number < MOST_GAPS else None
        if found is None:
            piece[behind:] += 1
        else:
            shift[behind:] += TURN * found
    return values + shift, piece


def _excerpt(
    time_s: FloatArray, values: FloatArray, valid: BoolArray, near_hz: float | None
) -> tuple[FloatArray, FloatArray]:
    """Return the times and values to show: of a sine some periods, where samples are left out if any are; of other motion all."""
    part = slice(0, None, max(valid.size // EXCERPT, 1))
    if near_hz is not None:
        first = int(np.argmin(valid)) if not valid.all() else 0
        start = int(np.clip(first - EXCERPT // 2, 0, max(valid.size - EXCERPT, 0)))
        part = slice(start, start + EXCERPT)
    return time_s[part], np.where(valid, values, np.nan)[part]


def _longest(piece: np.ndarray, usable: BoolArray) -> int:
    return int(np.argmax(np.bincount(piece, weights=usable.astype(float)))) if piece.size else 0


def _joined(
    values: FloatArray, piece: np.ndarray, usable: BoolArray, rate: float, near_hz: float
) -> tuple[FloatArray, np.ndarray]:
    """Return the pieces of a sine joined: the sine of the longest one gives the turns by which the others are off."""
    if piece.size == 0 or piece[-1] == 0:
        return values, piece
    values = values.copy()
    piece = piece.copy()
    main = _longest(piece, usable)
    others = [p for p in np.unique(piece[usable]).tolist() if p != main]
    for other in sorted(others, key=lambda p: abs(p - main)):
        known = usable & (piece == main)
        found = fit_sine(values, known, rate, near_hz)
        inside = usable & (piece == other)
        if found is None or inside.sum() < 3:
            continue
        off = (values[inside] - found.at(np.flatnonzero(inside) / rate)) / TURN
        whole = float(np.median(off))
        if abs(whole - round(whole)) < WHOLE and float(np.std(off)) < WHOLE:
            values[piece == other] -= TURN * round(whole)
            piece[piece == other] = main
    return values, piece


def _without_carrier(
    values: FloatArray, valid: BoolArray, rate: float, near_hz: float | None, position: np.ndarray
) -> tuple[FloatArray, np.polynomial.Legendre]:
    """Return the phase without the carrier's error and drift: a parabola, to which no acceleration sensor responds.

    With a sine both are fitted in rounds, to separate them. The second value is the parabola over
    ``position``.
    """
    t = np.linspace(-1.0, 1.0, values.shape[0])
    design = np.stack([np.ones_like(t), t, 1.5 * t * t - 0.5], axis=1)
    time = np.arange(values.shape[0]) / rate
    wave = np.zeros(values.shape)
    total = np.zeros(3)
    for _ in range(1 if near_hz is None else 4):
        found, *_ = np.linalg.lstsq(design[valid], (values - wave)[valid], rcond=None)
        values = values - design @ found
        total += found
        sine = None if near_hz is None else fit_sine(values, valid, rate, near_hz)
        if sine is not None:
            wave = sine.at(time) - sine.mean - sine.slope * time
    return values, np.polynomial.Legendre(total, domain=[float(position[0]), float(position[-1])])


def _answer(
    values: FloatArray,
    valid: BoolArray,
    rate: float,
    found: Sine | None,
    choice: Choice,
    signals: Signals,
    around: Cyclic | None,
) -> effects.Answer:
    noise = choice.ellipse.radial_noise
    if found is not None:
        frequency, harmonics = effects.of_sine(found.amplitude, found.mean, found.frequency_hz)
        relative_noise = np.array(
            [noise * np.sqrt(2.0 / signals.samples) / max(found.amplitude, 1e-300)]
        )
    else:
        frequency, harmonics = effects.of_motion(values, valid, rate)
        size = float(np.std(values[valid]))
        relative_noise = np.full(
            frequency.shape, noise / np.sqrt(signals.samples) / max(size, 1e-300)
        )
    covariance = choice.ellipse.shape_covariance
    return effects.Answer(frequency, harmonics, relative_noise, choice.group, covariance, around)


def _slips(path: Path, open_gaps: int, left_out: float, name: str) -> list[OpticalFinding]:
    if not path.gaps and path.counted == path.by_phase:
        return []
    lost = [gap for gap in path.gaps if not gap.jump]
    jumps = len(path.gaps) - len(lost)
    parts = []
    if lost:
        parts.append(f"the amplitude is lost in {len(lost)} stretch{'es' * (len(lost) > 1)}")
    if jumps:
        parts.append(
            f"the phase jumps by nearly half a turn or more in {jumps} place{'s' * (jumps > 1)}"
        )
    if path.counted != path.by_phase:
        parts.append(
            f"{path.counted} half fringes are counted in the signal, {path.by_phase} in the phase"
        )
    text = f"{name}: {' and '.join(parts)}; {100 * left_out:.2g} % of the displacement is left out"
    if open_gaps:
        text += (
            f", as for {open_gaps} of the gaps the motion does not determine the number of fringes"
        )
    return [OpticalFinding("fringe_slip", text + ".")]


def _require_slow(path: Path, name: str) -> None:
    if any(gap.jump for gap in path.gaps) and path.fastest > NEARLY_TOO_FAST:
        raise InputError(
            "The motion is too fast for the sampling of the optical signals.",
            expected="less than half a turn of phase (an eighth of the wavelength, for one pass) from sample to sample",
            found=f"{path.fastest:.3g} rad, and beyond, from sample to sample",
            where=name,
            remedy="sample the optical signals faster, or move more slowly",
        )


def _require_enough(left_out: float, name: str) -> None:
    if left_out > MOST_LEFT_OUT:
        raise InputError(
            "The interferometer's phase cannot be followed.",
            expected="two signals whose amplitude holds, with less than half a turn of phase from sample to sample",
            found=f"{100 * left_out:.3g} % of the record lost",
            where=name,
            remedy="look at the Lissajous figure (⟦command = inspect⟧); sample faster, or move more slowly",
        )
