"""What a fit says of its data, what is doubted of it, and the document that states it.

``attempts`` fits and judges, once more from elsewhere where nothing is explained; ``refits`` do so with other data;
``adequacy`` is the verdict, with the stated systematic ``effects``; ``remedy`` names the model that explains what this
one does not; ``doubts`` gives the warnings that need a fitted model; ``document`` makes the result.
"""

from __future__ import annotations

from vibrident.fit.judge.attempts import Fitted, Told
from vibrident.fit.judge.document import Uncertainty, covered, document, own_rows
from vibrident.fit.judge.refits import beside_departures, with_phase_scatter, without_dead_records
from vibrident.fit.judge.remedy import with_remedy

__all__ = [
    "Fitted",
    "Told",
    "Uncertainty",
    "beside_departures",
    "covered",
    "document",
    "own_rows",
    "with_phase_scatter",
    "with_remedy",
    "without_dead_records",
]
