"""Residuals of records of one length and rate, from which their noise is estimated."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.response import ComplexArray


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of R records of one length and rate, with what is known about them.

    Attributes:
        residual: measured less predicted response, shape (R, K); bin 0 does not count.
        predicted: the model's response, shape (R, K).
        count: samples used, shape (R,).
        floor: lower limits of the levels, shape (R,).
        through: g |H|², shape (1, K) where it is one of all, or (R, K); None without a reference.
        reference: shape (R, K); None where the prediction alone represents the motion.
        passed: H times the reference, bin by bin, shape (R, K); None takes the prediction. With
            initial states in it, leakage into both would cancel, and leave the noise.
        heard: bins at which motion shows in the response without any model, shape (R, K): there
            alone what is coherent with the motion is no noise. None: where the response is loud.
        lines: further bins whose remainder is the motion's, and no hum, shape (R, K); None: no
            others.
        fitted: count of numbers that were fitted to each record, shape (R,); None: none.
        unfitted: share of the noise of each bin that numbers fitted to few bins leave, shape (R,
            K); None: all of it.
        free_motion: columns that are fitted beside what is coherent with the motion, as a misfit
            rings on, shape (R, n, K); None: none.
        tones: places of the tones that were fitted to each record, in bins; None: none.
    """

    residual: ComplexArray
    predicted: ComplexArray
    count: FloatArray
    floor: FloatArray
    through: FloatArray | None = None
    reference: ComplexArray | None = None
    passed: ComplexArray | None = None
    heard: BoolArray | None = None
    lines: BoolArray | None = None
    fitted: FloatArray | None = None
    unfitted: FloatArray | None = None
    free_motion: ComplexArray | None = None
    tones: tuple[tuple[float, ...], ...] | None = None

    def records(self, rows: slice) -> Residuals:
        """Return the residuals of some of the records."""
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        shared = {"through"} if self.through is not None and len(self.through) == 1 else set()
        return replace(
            self,
            **{
                name: array[rows]
                for name, array in arrays.items()
                if array is not None and name not in shared
            },
        )
