"""The unrolled network at the bins of its transform, where linear models are trained.

One step of the network is x_{k+1} = Φ x_k + Γ c_k, y_k = C x_k + D c_k. Over an unbroken run of N
steps, at a line z = e^{2πjm/N} of its discrete Fourier transform,

    Y(z) = (C (zI − Φ)⁻¹ Γ + D) U(z) + z C (zI − Φ)⁻¹ (x_0 − x_N),

exactly, for any signal: z^N = 1, and the leakage of a record that is not periodic is the n numbers
x_0 − x_N, unknown as the initial state is. An offset appears in line 0 alone. By Parseval's theorem
the sum of squares, its gradient and its optimum are those of the network unrolled over the same
samples (Pintelon & Schoukens 2012, sec. 6.3.2).
"""

from __future__ import annotations

from vibrident.fit.bins.record import RecordBins
from vibrident.fit.bins.segments import (
    Drive,
    Segment,
    between_gaps,
    driven_by,
    segment_of,
    transformable,
    unbroken,
    usable_steps,
)
from vibrident.fit.bins.transfer import DiscreteTransfer, Trained, transfer_of

__all__ = [
    "DiscreteTransfer",
    "Drive",
    "RecordBins",
    "Segment",
    "Trained",
    "between_gaps",
    "driven_by",
    "segment_of",
    "transfer_of",
    "transformable",
    "unbroken",
    "usable_steps",
]
