"""Systematic effects that a calibration stated, carried into the estimates of a session.

Tracking averages the noise of the samples out, but not the systematic effects of the measuring
chain. In each parameter the calibration's share w = min(u²/u₀², 1) contains them within its u₀; to
the share of the samples, √(1 − w²) of each effect is added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.fields import Fields, GivenFields
from vibrident.data.records import FloatArray
from vibrident.fit.uncertainty.budget import DATA
from vibrident.result import Result
from vibrident.use.comparison import REFERENCE_SOURCE
from vibrident.use.tracking.known import budget_row
from vibrident.use.tracking.state import TrackedEstimate

SCATTER = "noise, and the calibration that the session began with"


@dataclass(frozen=True, eq=False)
class CarriedEffects:
    """Effects of type B that a calibration stated."""

    rows: tuple[GivenFields, ...]  # of its budget
    contributions: FloatArray  # standard uncertainty of each in each parameter, (rows, parameters)
    start: FloatArray  # covariance of the calibration, (parameters, parameters)
    reference: FloatArray  # relative u of the session's own reference, at the gain, (parameters,)
    # rows of the known responses of the session's own channels, and how far one u of each moves
    # each parameter, (rows, parameters)
    channel_rows: Sequence[GivenFields]
    channel_moves: FloatArray

    @classmethod
    def from_result(
        cls, result: Result, start: FloatArray, reference: FloatArray
    ) -> CarriedEffects:
        """Collect the effects of a result.

        Args:
            result: of the calibration.
            start: covariance of its parameters, in the model's order.
            reference: relative standard uncertainty of the session's own reference, at the gain;
                where it is stated it takes the place of that of the calibration's.
        """
        names = [name for name, parameter in result.parameters.items() if not parameter.derived]
        own_reference = bool(reference.any())
        rows = tuple(
            row
            for row in result.settings.get("uncertainty_budget") or ()
            if row.get("type") == "B"
            and not (own_reference and row.get("source") == REFERENCE_SOURCE)
        )
        table = [
            [(row.get("contributions") or {}).get(name) or 0.0 for name in names] for row in rows
        ]
        contributions = np.array(table).reshape(len(rows), len(names))
        return cls(rows, contributions, start, reference, (), np.zeros((0, len(names))))

    def _variances(self, read: TrackedEstimate) -> FloatArray:
        """Return the variances of an estimate without its reference's, (parameters,)."""
        values = np.array(list(read.values.values()))
        return np.diag(read.covariance) - (self.reference * values) ** 2

    def fresh(self, read: TrackedEstimate) -> FloatArray:
        """Return the part of each effect that the samples bring anew, (parameters,)."""
        calibrated = np.clip(self._variances(read) / np.diag(self.start), 0.0, 1.0)
        return np.sqrt(1.0 - calibrated**2)

    def added(self, read: TrackedEstimate) -> TrackedEstimate:
        """Return an estimate with the effects in its covariance, correlated as calibrated."""
        variance = np.sum(self.contributions**2, axis=0)
        share = np.sqrt(np.minimum(variance / np.diag(self.start), 1.0)) * self.fresh(read)
        moves = self.channel_moves * self.fresh(read)
        covariance = read.covariance + self.start * np.outer(share, share) + moves.T @ moves
        u = np.sqrt(np.diag(covariance)).tolist()
        named = dict(zip(read.values, u, strict=True))
        return replace(read, uncertainty=named, covariance=covariance)

    def budget(self, read: TrackedEstimate, freedom: float) -> list[Fields]:
        """Return the uncertainty budget of an estimate to which no effects are added yet.

        Its rows: the estimate's scatter, the session's reference, and each effect carried.
        """
        fresh = self.fresh(read)
        scatter = {"source": SCATTER, "type": "A", "kind": DATA, "standard_uncertainty": None}
        scatter |= {"unit": "", "degrees_of_freedom": freedom}
        rows: list[Any] = [(scatter, np.sqrt(np.maximum(self._variances(read), 0.0)))]
        if relative := float(self.reference.max()):
            session_row = budget_row(REFERENCE_SOURCE, "gain", relative)
            rows.append((session_row, self.reference * np.abs(list(read.values.values()))))
        rows += zip(self.channel_rows, fresh * np.abs(self.channel_moves), strict=True)
        rows += zip(self.rows, fresh * self.contributions, strict=True)
        return [
            {**row, "contributions": dict(zip(read.values, contribution.tolist(), strict=True))}
            for row, contribution in rows
        ]
