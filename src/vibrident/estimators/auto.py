"""Which estimator suits the data, and why."""

from __future__ import annotations

from vibrident.problem import Evidence


def choose(evidence: Evidence) -> tuple[str, str]:
    """Name of the estimator for these data, and the reason in words."""
    if evidence.calibration.table is not None:
        return "ml", "auto: a table of responses with their uncertainties: weighted fit in magnitude and phase"
    if not evidence.model.is_linear:
        return "ipnn", "auto: a model without transfer function: the network runs its equation in time"
    if evidence.only_sines:
        return (
            "ml",
            "auto: sine records: each tone is estimated in both channels, so noise on the reference does no harm",
        )
    kinds = sorted({record.excitation for record in evidence.records})
    return "ipnn", f"auto: excitation {', '.join(kinds)}: the network uses every sample of the motion"
