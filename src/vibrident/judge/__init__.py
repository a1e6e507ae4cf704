"""What a fit says of its data, what is doubted of it, and the document that states it.

``attempts`` fits and judges, once more from elsewhere where nothing is explained; ``adequacy`` is the verdict, with the
stated systematic ``effects``; ``doubts`` gives the warnings that need a fitted model; ``document`` makes the result.
"""

from __future__ import annotations

from vibrident.judge.adequacy import Judgement
from vibrident.judge.attempts import Fitted, fitted_and_judged, with_phase_scatter, without_dead_records
from vibrident.judge.document import Uncertainty, document, own_rows
from vibrident.judge.doubts import linearised
from vibrident.judge.remedy import with_remedy

__all__ = [
    "Fitted",
    "Judgement",
    "Uncertainty",
    "document",
    "fitted_and_judged",
    "linearised",
    "own_rows",
    "with_phase_scatter",
    "with_remedy",
    "without_dead_records",
]
