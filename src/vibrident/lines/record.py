"""A run's residual, and all that could change it, at the lines of its transform: what the end of training works on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from vibrident.measure.response import ComplexArray
from vibrident.records import FloatArray

T = TypeVar("T")
#: Step of the central differences of the response.
STEP = 1e-5


@dataclass(frozen=True, eq=False)
class RunLines:
    """One run of N samples, in units of the noise that it was weighted by.

    Attributes:
        record: number of the record.
        samples: N.
        residual: measured less network, shape (lines,).
        predicted: power of the network's response, shape (lines,).
        twice: how often a line counts in a sum over all; zero beyond the band that counts, shape (lines,).
        slopes: of the response with z, shape (p, lines).
        shifted: w = z − 1 at the lines.
        over: 1/a at the lines.
        order: number of states.
        response: the model's, H, at the lines for given z; None without a reference.
        z: where the network was evaluated, shape (p,).
        floor: variance that no residual is believed to be below.
    """

    record: int
    samples: int
    residual: ComplexArray
    predicted: FloatArray
    twice: FloatArray
    slopes: ComplexArray
    shifted: ComplexArray
    over: ComplexArray
    order: int
    response: Callable[[FloatArray], ComplexArray] | None
    z: FloatArray
    floor: float

    @property
    def through(self) -> ComplexArray | None:
        """H at z, shape (lines,)."""
        return None if self.response is None else self.response(self.z)

    def slope_of(self, of_response: Callable[[ComplexArray], T]) -> list[T]:
        """Slopes with each coordinate of what is linear in H, by central differences."""
        assert self.response is not None
        ends = np.eye(len(self.z)) * STEP
        return [of_response((self.response(self.z + e) - self.response(self.z - e)) / (2.0 * STEP)) for e in ends]

    def freed_slopes(self) -> ComplexArray:
        """The slopes less what initial states could imitate, all lines weighed alike; shape (p, lines)."""
        free = self.unknowns(edges=False, tones=())[:, : self.order]
        weighed = free * self.twice[:, None]
        gram = np.real(np.conj(free).T @ weighed)
        share = np.linalg.pinv(gram, rcond=1e-12, hermitian=True) @ np.real(np.conj(weighed).T @ self.slopes.T)
        return self.slopes - (free @ share).T

    def unknowns(self, *, edges: bool, tones: tuple[float, ...]) -> ComplexArray:
        """Lines of what is unknown beside the parameters, shape (lines, m).

        Free responses z w^k / a and a drift z / w; with ``edges``, their slopes too: z w^k / a² and z / w². Tones by
        their sums over the run, each with its slope with frequency.
        """
        w, z = self.shifted, 1.0 + self.shifted
        safe = np.where(self.twice > 0, w, 1.0)
        free = z * self.over * (self.over if edges else 1.0)
        columns = [free * w**k for k in range(self.order * (2 if edges else 1))]
        columns += [z / safe, z / safe**2] if edges else [z / safe]
        for place in tones:
            columns += _tone(place, self.samples, z)
        found = np.stack(columns, axis=1) * (self.twice > 0)[:, None]
        return found / np.sqrt(np.maximum(np.sum(np.abs(found) ** 2, axis=0), np.finfo(float).tiny))


def _tone(place: float, samples: int, z: ComplexArray) -> list[ComplexArray]:
    """Transforms of a tone ``place`` lines high, its cosine and sine, and of both times k/N."""
    found = []
    for sign in (1.0, -1.0):
        step = np.exp(sign * 2j * np.pi * place / samples) / z
        step = np.where(np.abs(1.0 - step) < 1e-12, step * (1.0 + 1e-9j), step)
        end = np.exp(sign * 2j * np.pi * place)
        whole = (1.0 - end) / (1.0 - step)
        found.append((whole, -end / (1.0 - step) + step * (1.0 - end) / (samples * (1.0 - step) ** 2)))
    (plus, plus_slope), (minus, minus_slope) = found
    return [plus + minus, -1j * (plus - minus), plus_slope + minus_slope, -1j * (plus_slope - minus_slope)]
