"""The model's prediction of a record as the analysis of its noise sees it, and levels of lines."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.bins import RecordBins
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import MOST_KEPT, SHORTEST, in_blocks, mean_around, power_of

#: Bins that a spectrum is averaged into.
BINS = 160
#: Part of the sampling rate up to which a spectrum is looked at.
HIGHEST = 0.4
#: Lines averaged on either side of each for the weights: this part of the spectrum …
SHARE = 1 / 64
#: … and at least so many …
FEWEST = 24
#: … of which the nearest are left out.
NEAREST = 2
#: A line this many times above its surroundings is no chance: one of 10⁹ white ones is.
OUTSTANDING = 20.0
#: Lines on either side that are the nearest.
CLOSE = 8
#: Lines beyond this many times their surroundings are left out of the mean (one of 400 white ones is: allowed for).
FAR = 6.0


@dataclass(frozen=True, eq=False)
class Motion:
    """The model's prediction of a record, for the analysis of the spectra of its residuals.

    Attributes:
        count: number of samples that are used.
        predicted: makes its real transform, or some lines of it, shape (lines,).
        through: g |H|² at the lines of the real transform, shape (samples // 2 + 1,); None without a reference.
        alone: where the prediction has a line of its own: a remainder there is the model's and no hum.
        own: power of the prediction, smoothed except at outstanding lines, shape (samples // 2 + 1,).
        seen: g |H|² in bins, shape (bins,).
        colour: g, power of the reference's own noise over its mean, one or shape (samples // 2 + 1,).
        last: bins from here on are not looked at.
        reference: transform of the reference; None where the prediction alone says what is motion.
    """

    count: float
    predicted: Callable[[slice], ComplexArray]
    through: FloatArray | None
    alone: BoolArray
    own: FloatArray
    seen: FloatArray
    colour: FloatArray | float = 1.0
    last: int = 0
    reference: ComplexArray | None = None
    heard: BoolArray | None = None

    @classmethod
    def of(
        cls,
        predicted: Callable[[slice], ComplexArray],
        count: float,
        through: FloatArray | None,
        colour: FloatArray | float = 1.0,
        last: int = 0,
        reference: ComplexArray | None = None,
        heard: BoolArray | None = None,
    ) -> Motion:
        """Of what makes lines of the prediction's real transform, g |H|² and g."""
        expected = power_of(predicted(slice(None)))
        around = lines_around(expected)
        moves = expected if through is None else expected / np.maximum(through, 1e-300)  # a resonance is no line
        alone = (expected > OUTSTANDING * mean_around(expected, around, NEAREST)) | _lines_close_by(moves)
        last = last or int(HIGHEST * 2 * (len(expected) - 1)) + 1
        if through is None:
            nothing = np.zeros(0)
            return cls(count, predicted, None, alone, nothing, nothing, colour, last, reference, heard)
        expected /= count
        own = typical(expected, around)
        own = np.where(expected > OUTSTANDING * own, expected, own)
        seen = means(through, bins_of(len(expected), last).edges)
        return cls(count, predicted, through, alone, own, seen, colour, last, reference, heard)

    def windowed(self, part: slice) -> ComplexArray:
        """The prediction's lines under Hann's window, of which line 1 is the first."""
        return windowed(self.predicted(slice(part.start, part.stop + 2)))

    def level(self) -> tuple[FloatArray, BoolArray]:
        """Power of these lines by those around, and which of them are no outstanding ones; up to the last bin."""
        return self._level if len(self.alone) <= MOST_KEPT else self._made_level()

    @functools.cached_property
    def _level(self) -> tuple[FloatArray, BoolArray]:
        return self._made_level()

    def _made_level(self) -> tuple[FloatArray, BoolArray]:
        assert self.through is not None
        power = np.empty(int(bins_of(len(self.through), self.last).edges[-1]) - 1)
        for part in in_blocks(len(power)):
            power[part] = power_of(self.windowed(part)) / self.count
        own = typical(power, lines_around(self.through))
        return own, power < FAR * own


#: Gives what the model says of a record; None if it has too few lines above the noise.
MotionOf = Callable[[], Motion | None]


def motion_of(record: RecordBins) -> MotionOf:
    """What gives the model's prediction of the record; of a long one it is made each time."""
    if record.samples > MOST_KEPT:
        return functools.partial(_motion_of, record)
    found = _motion_of(record)
    return lambda: found


def _motion_of(record: RecordBins) -> Motion | None:
    if record.count < SHORTEST or record.free is None:
        return None
    through = through_of(record)
    return Motion.of(record.predicted, record.count, through, record.colour, record.last)


def through_of(record: RecordBins) -> FloatArray | None:
    """Power of noise of the reference, of unit variance, behind the sensor, shape (lines,)."""
    if record.model is None:
        return None
    squares = record.model.power()
    return squares if isinstance(record.colour, float) else squares * record.colour


def _lines_close_by(power: FloatArray) -> BoolArray:
    """Lines that stand out of the nearest ones alone, as a multisine's do among its others; with one on either side."""
    stands = power > OUTSTANDING * typical(power, CLOSE)
    stands[1:] &= power[1:] >= power[:-1]
    stands[:-1] &= power[:-1] >= power[1:]
    found = stands.copy()
    found[1:] |= stands[:-1]
    found[:-1] |= stands[1:]
    return found


def lines_around(lines: ComplexArray | FloatArray) -> int:
    """Lines on either side that a level is averaged over."""
    return max(int(len(lines) * SHARE), FEWEST)


def typical(values: FloatArray, around: int) -> FloatArray:
    """Level of exponentially distributed values, from the logarithms around: a few strong ones do not count."""
    return np.exp(mean_around(np.log(np.maximum(values, 1e-300)), around, NEAREST) + np.euler_gamma)


def windowed(lines: ComplexArray) -> ComplexArray:
    """Lines under Hann's window, a sum of three, scaled to the same noise; without the first and the last."""
    found = lines[:-2] + lines[2:]
    found *= -0.25 / np.sqrt(0.375)
    found += lines[1:-1] * (0.5 / np.sqrt(0.375))
    return found


class Bins(NamedTuple):
    """Bins of the lines of a real transform.

    Attributes:
        edges: first lines of the bins, and the line behind the last, shape (bins + 1,).
        wide: number of lines of each, shape (bins,).
        order: mean number of its lines.
        geometric: mean of so many exponentially distributed powers over their geometric mean, Γ(1 + 1/n)⁻ⁿ. The latter
            is what is taken: a tone that is not quite fitted, or hum, is not the noise looked for.
    """

    edges: NDArray[np.int_]
    wide: FloatArray
    order: FloatArray
    geometric: FloatArray


@functools.lru_cache(maxsize=8)
def bins_of(lines: int, last: int) -> Bins:
    """Bins of so many lines, evenly spread over the logarithm up to the last that is looked at."""
    last = max(last - 1, 8)
    edges = distinct(np.round(np.geomspace(1, last + 1, BINS)).astype(int))
    wide = np.diff(edges).astype(float)
    order = means(np.arange(lines, dtype=float), edges)
    return Bins(edges, wide, order, np.exp(-wide * [math.lgamma(1.0 + 1.0 / number) for number in wide]))


def means(values: FloatArray, edges: NDArray[np.int_]) -> FloatArray:
    """Geometric means over bins."""
    total = np.add.reduceat(np.log(np.maximum(values[: edges[-1]], 1e-300)), edges[:-1])
    return np.maximum(np.exp(total / np.diff(edges)), 1e-300)
