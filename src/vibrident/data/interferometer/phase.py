"""Phase of two signals in quadrature, block by block: unwrapped, with gaps and jumps.

Where the amplitude is lost, or the phase jumps by nearly half a turn, the number of turns is
unknown. Such samples are a gap: the phase is held over it and continues from the nearest turn. The
missing turns follow from the motion on both sides (:func:`turns`); otherwise the part behind the
gap is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from vibrident.data.interferometer.ellipse import Ellipse
from vibrident.data.interferometer.setting import BoolArray, FloatArray, Signals
from vibrident.data.interferometer.survey import TOO_LARGE, lost_radius

BLOCK = 1 << 16  # samples in a block: few enough for the processor's cache
FASTEST = 2.8  # largest change of phase from sample to sample, rad; beyond, a turn may be missed
ROUGHEST = 2.5  # largest change of that change, rad
GUARD = 3  # samples left out on either side of a lost one
CLOSE = 1.0  # largest distance of samples in which fringes are counted, rad
BEYOND = 0.5  # part of its amplitude that a signal must exceed to be counted
MOST_COUNTED = 1 << 21  # most samples in which fringes are counted
BESIDE = (1, 4)  # samples on either side, in lengths of the gap, tried in turn
FEWEST_BESIDE = 24  # fewest samples on either side
MOST_BESIDE = 1 << 14  # most samples on either side
DEGREES = (3, 5, 7, 9)  # degrees of the polynomial through both sides
WHOLE = 0.12  # largest distance of the step from a whole number of turns, turns
SURE = 0.08  # largest uncertainty of the step, turns
ROUGH = 2.0  # largest rms of the residual over the noise
TURN = 2.0 * np.pi
ORDERS = (1, 2, 4)  # orders of the cyclic error: harmonics of the phase


def waves(phase: FloatArray) -> FloatArray:
    """Return the waves cos nφ and sin nφ for the orders of a cyclic error, shape (6, …)."""
    return np.stack([wave for n in ORDERS for wave in (np.cos(n * phase), np.sin(n * phase))])


@dataclass(frozen=True)
class Gap:
    """Samples from ``start`` up to ``stop`` that are left out; ``jump`` for a jump of the phase at sufficient
    amplitude."""

    start: int
    stop: int
    jump: bool


@dataclass
class Path:
    """Findings on the way through a record."""

    gaps: list[Gap] = field(default_factory=list)
    lowest: float = np.inf
    highest: float = -np.inf
    length: float = 0.0
    fastest: float = 0.0
    counted: int = 0
    by_phase: int = 0
    compared: int = 0


def unwrapped(
    signals: Signals,
    ellipse: Ellipse,
    knots: Sequence[tuple[float, Ellipse]],
    path: Path,
    error: FloatArray | None = None,
) -> Iterator[FloatArray]:
    """Yield the unwrapped phase, rad, block by block; fills ``path``.

    ``ellipse``: that the phase is from; ``knots``: sample index and ellipse, where it changes; else
    empty; ``path``: what is found on the way; ``error``: amplitudes of a cyclic error to be taken
    out, rad, shape (6,).
    """
    last = 0.0
    before = None
    carried: tuple[float, int] | None = None
    for start in range(0, signals.samples, BLOCK):
        stop = min(start + BLOCK, signals.samples)
        v = _round(signals.block(start, stop), ellipse, knots, start)
        angle = np.arctan2(v[1], v[0])
        if error is not None:
            angle -= error @ waves(angle)
        good = _good(v, ellipse)
        phase, last, before = _followed(angle, good, last, before, start, path)
        carried = _counted(v[0], phase, good, carried, path)
        yield phase


def _round(
    u: FloatArray, ellipse: Ellipse, knots: Sequence[tuple[float, Ellipse]], start: int
) -> FloatArray:
    if not knots:
        return ellipse.round(u)
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


def _good(v: FloatArray, ellipse: Ellipse) -> BoolArray:
    radius = v[0] * v[0]
    radius += v[1] * v[1]
    least = lost_radius(ellipse) ** 2
    most = TOO_LARGE**2
    if radius.min() > least and radius.max() < most:
        return np.ones(radius.shape, dtype=bool)
    good = (radius > least) & (radius < most)
    bad = np.flatnonzero(~good)
    for shift in range(-GUARD, GUARD + 1):
        good[np.clip(bad + shift, 0, good.shape[0] - 1)] = False
    return good


def _followed(
    angle: FloatArray, good: BoolArray, last: float, before: float | None, start: int, path: Path
) -> tuple[FloatArray, float, float | None]:
    """Return the phase of a block that follows the phase ``last``; ``before`` is the last change, None behind a gap."""
    whole = bool(good.all())
    kept = angle if whole else angle[good]
    if kept.shape[0] == 0:
        _add_gaps(path, good, start)
        return np.full(angle.shape, last), last, None
    phase, change = _continued(kept, last)
    sizes = np.abs(change)
    if start == 0:
        sizes[0] = 0.0
    top = float(np.max(sizes))
    if 2.0 * top > ROUGHEST or not whole:
        previous = change[0] if before is None else before
        bend = np.abs(np.diff(change, prepend=previous))
        if start == 0 and bend.shape[0] > 1:
            bend[:2] = 0.0
        places = np.arange(angle.shape[0]) if whole else np.flatnonzero(good)
        beside = np.diff(places, prepend=places[0] - 1) == 1
        beside[0] &= before is not None
        jump = beside & ((sizes > FASTEST) | (bend > ROUGHEST))
        jump[1:] &= beside[:-1] | (sizes[1:] > FASTEST)
        _add_gaps(path, good, start)
        for place in places[jump].tolist():
            _add(path, Gap(start + max(place - 1, 0), start + place + 1, True))
        top = float(np.max(np.where(jump | ~beside, 0.0, sizes)))
    path.fastest = max(path.fastest, top)
    path.length += float(np.sum(sizes))
    path.lowest, path.highest = (
        min(path.lowest, float(phase.min())),
        max(path.highest, float(phase.max())),
    )
    if whole:
        return phase, float(phase[-1]), float(change[-1])
    index = np.cumsum(good) - 1
    held = np.where(index >= 0, phase[np.maximum(index, 0)], last)
    return held, float(phase[-1]), float(change[-1]) if good[-1] else None


def _continued(angle: FloatArray, last: float) -> tuple[FloatArray, FloatArray]:
    """Return the phase of angles that follows the phase ``last``, each at the nearest turn, and the change to each.

    Turns are counted and added to the angles: rounding does not add up.
    """
    change = np.empty_like(angle)
    turns = np.empty_like(angle)
    np.subtract(angle[1:], angle[:-1], out=change[1:])
    first = float(angle[0]) - last
    change[0] = first - TURN * round(first / TURN)
    np.multiply(change, 1.0 / TURN, out=turns)
    np.rint(turns, out=turns)
    turns[0] = 0.0
    places = np.flatnonzero(turns)
    counted = np.concatenate([[0.0], np.cumsum(turns[places], dtype=float)]) + round(first / TURN)
    phase = np.repeat(-TURN * counted, np.diff(places, prepend=0, append=angle.size))
    phase += angle
    turns *= TURN
    change -= turns
    return phase, change


def _add_gaps(path: Path, good: BoolArray, start: int) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[True], good, [True]]).astype(np.int8)))
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        _add(path, Gap(start + first, start + end, False))


def _add(path: Path, gap: Gap) -> None:
    """Add a gap, joined to the last if they touch."""
    if path.gaps and gap.start <= path.gaps[-1].stop:
        last = path.gaps.pop()
        gap = Gap(min(last.start, gap.start), max(last.stop, gap.stop), last.jump and gap.jump)
    path.gaps.append(gap)


def _counted(
    signal: FloatArray,
    phase: FloatArray,
    good: BoolArray,
    carried: tuple[float, int] | None,
    path: Path,
) -> tuple[float, int] | None:
    """Count half fringes twice: by changes of sign of the first signal, and by the phase."""
    if path.fastest > CLOSE or path.compared > MOST_COUNTED or not good.all():
        return None
    far = np.abs(signal) > BEYOND
    if not far.any():
        return None
    sign = np.sign(signal[far])
    cell = np.rint(phase[far] / np.pi)
    first = carried or (float(sign[0]), int(cell[0]))
    path.counted += int(np.count_nonzero(np.diff(sign, prepend=first[0])))
    path.by_phase += int(np.sum(np.abs(np.diff(cell, prepend=float(first[1])))))
    path.compared += signal.shape[0]
    return float(sign[-1]), int(cell[-1])


def turns(signals: Signals, ellipse: Ellipse, gap: Gap) -> int | None:
    """Return the turns to add behind a gap to the phase that continues from the nearest turn; None if they cannot be determined.

    A polynomial of time and a step behind the gap are fitted to the phase on both sides. The step
    of the right polynomial is a whole number of turns, which is the check.
    """
    length = gap.stop - gap.start
    for times in BESIDE:
        width = int(np.clip(times * length, FEWEST_BESIDE, MOST_BESIDE))
        left = max(gap.start - width, 0)
        right = min(gap.stop + width, signals.samples)
        if gap.start - left < FEWEST_BESIDE // 2 or right - gap.stop < FEWEST_BESIDE // 2:
            return None
        before = _phase(signals, ellipse, left, gap.start)
        after = _phase(signals, ellipse, gap.stop, right)
        nearest = TURN * np.rint((after[0] - before[-1]) / TURN)
        found = _step_behind(before, after - nearest, left, gap.stop, ellipse.radial_noise)
        if found is not None:
            return found
    return None


def _phase(signals: Signals, ellipse: Ellipse, start: int, stop: int) -> FloatArray:
    v = ellipse.round(signals.block(start, stop).astype(float))
    return np.unwrap(np.arctan2(v[1], v[0]))


def _step_behind(
    before: FloatArray, after: FloatArray, left: int, right: int, noise: float
) -> int | None:
    time = np.concatenate([left + np.arange(before.size), right + np.arange(after.size)]).astype(
        float
    )
    time = 2.0 * (time - time[0]) / (time[-1] - time[0]) - 1.0
    behind = np.concatenate([np.zeros(before.size), np.ones(after.size)])
    phase = np.concatenate([before, after])
    for degree in DEGREES:
        if time.size < 3 * degree:
            return None
        design = np.column_stack([np.polynomial.legendre.legvander(time, degree), behind])
        q, r = np.linalg.qr(design)
        found = np.linalg.solve(r, q.T @ phase)
        rest = float(np.sqrt(np.sum((phase - design @ found) ** 2) / (time.size - degree - 2)))
        u = max(rest, noise, 1e-9) / abs(float(r[-1, -1])) / TURN
        step = float(found[-1]) / TURN
        if rest < ROUGH * max(noise, 1e-4) and u < SURE and abs(step - round(step)) < WHOLE:
            return -round(step)
    return None
