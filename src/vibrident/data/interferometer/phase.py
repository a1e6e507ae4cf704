"""Unwrap the phase of two signals in quadrature, block by block, with gaps and jumps.

Where the amplitude is lost, or the phase jumps by nearly half a turn, the number of turns is
unknown. Such samples are a gap: the phase is held over it and continues from the nearest turn. The
missing turns follow from the motion on both sides (:func:`turns_over_gap`); otherwise the part
behind the gap is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from vibrident.data.interferometer.ellipse import Ellipse
from vibrident.data.interferometer.setting import BoolArray, FloatArray, Gap, SampledSignals
from vibrident.data.interferometer.survey import is_near_circle

BLOCK_SAMPLES = 1 << 16  # samples in a block: few enough for the processor's cache
MAX_CHANGE_RAD = 2.8  # of the phase from sample to sample; beyond, a turn may be missed
MAX_BEND_RAD = 2.5  # change of that change
GUARD_SAMPLES = 3  # samples left out on either side of a lost one
MAX_COUNTED_CHANGE_RAD = 1.0  # largest change from sample to sample where fringes are counted
MIN_COUNTED_AMPLITUDE = 0.5  # share of its amplitude that a signal must exceed to be counted
MAX_COUNTED_SAMPLES = 1 << 21  # samples in which fringes are counted
SIDE_LENGTHS = (1, 4)  # samples on either side, in lengths of the gap, tried in turn
MIN_SIDE_SAMPLES = 24
MAX_SIDE_SAMPLES = 1 << 14
DEGREES = (3, 5, 7, 9)  # degrees of the polynomial through both sides
MAX_FRACTION_TURNS = 0.12  # largest distance of the step from a whole number of turns
MAX_STEP_UNCERTAINTY_TURNS = 0.08
MAX_RESIDUAL_TO_NOISE = 2.0  # rms of the residual over the noise
TURN = 2.0 * np.pi
ORDERS = (1, 2, 4)  # orders of the cyclic error: harmonics of the phase


def waves(phase: FloatArray) -> FloatArray:
    """Return the waves cos nφ and sin nφ for the orders of a cyclic error, shape (6, …)."""
    return np.stack([wave for n in ORDERS for wave in (np.cos(n * phase), np.sin(n * phase))])


@dataclass
class PhasePath:
    """Findings of unwrapping a record, filled block by block.

    Attributes:
        gaps: samples left out.
        lowest: smallest phase, rad.
        highest: largest phase, rad.
        length: length of the phase's path, rad.
        fastest: largest change from sample to sample, rad.
        counted: half fringes by changes of sign of the first signal.
        by_phase: half fringes by the phase.
        compared: samples in which half fringes were counted.
    """

    gaps: list[Gap] = field(default_factory=list)
    lowest: float = np.inf
    highest: float = -np.inf
    length: float = 0.0
    fastest: float = 0.0
    counted: int = 0
    by_phase: int = 0
    compared: int = 0


def unwrapped(
    signals: SampledSignals,
    ellipse: Ellipse,
    knots: Sequence[tuple[float, Ellipse]],
    path: PhasePath,
    error: FloatArray | None = None,
) -> Iterator[FloatArray]:
    """Yield the unwrapped phase, rad, block by block, and fill ``path``.

    Args:
        signals: two signals in quadrature.
        ellipse: ellipse that the phase is from.
        knots: sample index and ellipse, if the ellipse changes; else empty.
        path: receives the findings.
        error: amplitudes of a cyclic error to be removed, rad, shape (6,).
    """
    last = 0.0
    before = None
    carried: tuple[float, int] | None = None
    for start in range(0, signals.samples, BLOCK_SAMPLES):
        stop = min(start + BLOCK_SAMPLES, signals.samples)
        v = _on_circle(signals.block(start, stop), ellipse, knots, start)
        angle = np.arctan2(v[1], v[0])
        if error is not None:
            angle -= error @ waves(angle)
        good = _usable(v, ellipse)
        phase, last, before = _unwrapped_block(angle, good, last, before, start, path)
        carried = _count_half_fringes(v[0], phase, good, carried, path)
        yield phase


def _on_circle(
    u: FloatArray, ellipse: Ellipse, knots: Sequence[tuple[float, Ellipse]], start: int
) -> FloatArray:
    if not knots:
        return ellipse.to_unit_circle(u)
    at = np.array([at for at, _ in knots])
    index = np.arange(start, start + u.shape[1])

    def along(values: Sequence[float]) -> FloatArray:
        return np.interp(index, at, values)

    pieces = [piece for _, piece in knots]
    first = (u[0] - along([p.centre[0] for p in pieces])) / along([p.matrix[0, 0] for p in pieces])
    second = (u[1] - along([p.centre[1] for p in pieces])) - along(
        [p.matrix[1, 0] for p in pieces]
    ) * first
    return np.stack([first, second / along([p.matrix[1, 1] for p in pieces])])


def _usable(v: FloatArray, ellipse: Ellipse) -> BoolArray:
    good = is_near_circle(ellipse, v)
    bad = np.flatnonzero(~good)
    if bad.size:
        for shift in range(-GUARD_SAMPLES, GUARD_SAMPLES + 1):
            good[np.clip(bad + shift, 0, good.shape[0] - 1)] = False
    return good


def _unwrapped_block(
    angle: FloatArray,
    good: BoolArray,
    last: float,
    before: float | None,
    start: int,
    path: PhasePath,
) -> tuple[FloatArray, float, float | None]:
    """Return the phase of a block, its last value and its last change.

    Args:
        angle: of the block, rad.
        good: which samples are usable.
        last: phase before the block.
        before: last change of the phase, None behind a gap.
        start: index of the block's first sample.
        path: receives the findings.
    """
    complete = bool(good.all())
    usable = angle if complete else angle[good]
    if usable.shape[0] == 0:
        _add_gaps(path, good, start)
        return np.full(angle.shape, last), last, None
    phase, change = _continued(usable, last)
    sizes = np.abs(change)
    if start == 0:
        sizes[0] = 0.0
    top = float(np.max(sizes))
    if 2.0 * top > MAX_BEND_RAD or not complete:
        previous = change[0] if before is None else before
        bend = np.abs(np.diff(change, prepend=previous))
        if start == 0 and bend.shape[0] > 1:
            bend[:2] = 0.0
        usable_index = np.arange(angle.shape[0]) if complete else np.flatnonzero(good)
        adjacent = np.diff(usable_index, prepend=usable_index[0] - 1) == 1
        adjacent[0] &= before is not None
        jump = adjacent & ((sizes > MAX_CHANGE_RAD) | (bend > MAX_BEND_RAD))
        jump[1:] &= adjacent[:-1] | (sizes[1:] > MAX_CHANGE_RAD)
        _add_gaps(path, good, start)
        for jump_index in usable_index[jump].tolist():
            _add_gap(path, Gap(start + max(jump_index - 1, 0), start + jump_index + 1, True))
        top = float(np.max(np.where(jump | ~adjacent, 0.0, sizes)))
    path.fastest = max(path.fastest, top)
    path.length += float(np.sum(sizes))
    path.lowest = min(path.lowest, float(phase.min()))
    path.highest = max(path.highest, float(phase.max()))
    if complete:
        return phase, float(phase[-1]), float(change[-1])
    index = np.cumsum(good) - 1
    filled = np.where(index >= 0, phase[np.maximum(index, 0)], last)
    return filled, float(phase[-1]), float(change[-1]) if good[-1] else None


def _continued(angle: FloatArray, last: float) -> tuple[FloatArray, FloatArray]:
    """Return the phase of angles that continues ``last``, each at the nearest turn; and changes.

    Turns are counted and added to the angles, so that rounding does not accumulate.
    """
    change = np.empty_like(angle)
    turns = np.empty_like(angle)
    np.subtract(angle[1:], angle[:-1], out=change[1:])
    first = float(angle[0]) - last
    change[0] = first - TURN * round(first / TURN)
    np.multiply(change, 1.0 / TURN, out=turns)
    np.rint(turns, out=turns)
    turns[0] = 0.0
    turn_index = np.flatnonzero(turns)
    counted = np.concatenate([[0.0], np.cumsum(turns[turn_index], dtype=float)]) + round(
        first / TURN
    )
    phase = np.repeat(-TURN * counted, np.diff(turn_index, prepend=0, append=angle.size))
    phase += angle
    turns *= TURN
    change -= turns
    return phase, change


def _add_gaps(path: PhasePath, good: BoolArray, start: int) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[True], good, [True]]).astype(np.int8)))
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        _add_gap(path, Gap(start + first, start + end, False))


def _add_gap(path: PhasePath, gap: Gap) -> None:
    """Add a gap, joined to the last one if they touch."""
    if path.gaps and gap.start <= path.gaps[-1].stop:
        last = path.gaps.pop()
        gap = Gap(min(last.start, gap.start), max(last.stop, gap.stop), last.jump and gap.jump)
    path.gaps.append(gap)


def _count_half_fringes(
    signal: FloatArray,
    phase: FloatArray,
    good: BoolArray,
    carried: tuple[float, int] | None,
    path: PhasePath,
) -> tuple[float, int] | None:
    """Count half fringes twice: by changes of sign of the first signal, and by the phase."""
    if (
        path.fastest > MAX_COUNTED_CHANGE_RAD
        or path.compared > MAX_COUNTED_SAMPLES
        or not good.all()
    ):
        return None
    far = np.abs(signal) > MIN_COUNTED_AMPLITUDE
    if not far.any():
        return None
    sign = np.sign(signal[far])
    cell = np.rint(phase[far] / np.pi)
    first = carried or (float(sign[0]), int(cell[0]))
    path.counted += int(np.count_nonzero(np.diff(sign, prepend=first[0])))
    path.by_phase += int(np.sum(np.abs(np.diff(cell, prepend=float(first[1])))))
    path.compared += signal.shape[0]
    return float(sign[-1]), int(cell[-1])


def turns_over_gap(signals: SampledSignals, ellipse: Ellipse, gap: Gap) -> int | None:
    """Return the turns missing behind a gap, where the phase continues from the nearest turn.

    A polynomial of time and a step behind the gap are fitted to the phase on both sides. With the
    right polynomial the step is a whole number of turns, which is the check.

    Returns:
        None if the turns cannot be determined.
    """
    length = gap.stop - gap.start
    for times in SIDE_LENGTHS:
        width = int(np.clip(times * length, MIN_SIDE_SAMPLES, MAX_SIDE_SAMPLES))
        begin = max(gap.start - width, 0)
        end = min(gap.stop + width, signals.samples)
        if gap.start - begin < MIN_SIDE_SAMPLES // 2 or end - gap.stop < MIN_SIDE_SAMPLES // 2:
            return None
        before = _phase(signals, ellipse, begin, gap.start)
        after = _phase(signals, ellipse, gap.stop, end)
        nearest = TURN * np.rint((after[0] - before[-1]) / TURN)
        step = _step_behind(before, after - nearest, begin, gap.stop, ellipse.radial_noise)
        if step is not None:
            return step
    return None


def _phase(signals: SampledSignals, ellipse: Ellipse, start: int, stop: int) -> FloatArray:
    v = ellipse.to_unit_circle(signals.block(start, stop).astype(float))
    return np.unwrap(np.arctan2(v[1], v[0]))


def _step_behind(
    before: FloatArray, after: FloatArray, first_index: int, second_index: int, noise: float
) -> int | None:
    time = np.concatenate(
        [first_index + np.arange(before.size), second_index + np.arange(after.size)]
    ).astype(float)
    time = 2.0 * (time - time[0]) / (time[-1] - time[0]) - 1.0
    behind = np.concatenate([np.zeros(before.size), np.ones(after.size)])
    phase = np.concatenate([before, after])
    for degree in DEGREES:
        if time.size < 3 * degree:
            return None
        design = np.column_stack([np.polynomial.legendre.legvander(time, degree), behind])
        q, r = np.linalg.qr(design)
        coefficients = np.linalg.solve(r, q.T @ phase)
        residual = float(
            np.sqrt(np.sum((phase - design @ coefficients) ** 2) / (time.size - degree - 2))
        )
        u = max(residual, noise, 1e-9) / abs(float(r[-1, -1])) / TURN
        step = float(coefficients[-1]) / TURN
        if (
            residual < MAX_RESIDUAL_TO_NOISE * max(noise, 1e-4)
            and u < MAX_STEP_UNCERTAINTY_TURNS
            and abs(step - round(step)) < MAX_FRACTION_TURNS
        ):
            return -round(step)
    return None
