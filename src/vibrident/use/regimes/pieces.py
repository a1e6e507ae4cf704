"""Regimes of a record: runs of consecutive pieces whose parameters agree.

A record is cut into pieces of equal length, each fitted by itself. A piece within a regime is
explained by the model; one that holds a change is not. Consecutive explained pieces are of one
regime unless their parameters differ by more than noise, told by χ².
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.base.errors import VibridentError
from vibrident.base.fields import NamedNumbers
from vibrident.base.tails import chi2_tail
from vibrident.data.records import Calibration, FloatArray, Record
from vibrident.fit.estimators import choose
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.optimise import silent
from vibrident.fit.problem import Evidence
from vibrident.fit.response.bands import uncorrelated_records
from vibrident.fit.response.transform import band_sums
from vibrident.physics.models import SensorModel

#: Pieces of a record: regimes of two of them are found.
MAX_PIECES = 12
MIN_PIECES = 4
#: Fewest samples of a piece.
MIN_PIECE_SAMPLES = 512
#: Chance that noise separates two pieces of one regime.
FALSE_CHANGE = 1e-6
#: Bands of a spectrum by which pieces are compared, the least share of the power of one that
#: counts, and how many times less of it a piece may have than the pieces on average.
ALIKE_BANDS = 12
MIN_BAND_SHARE = 0.01
MAX_POWER_RATIO = 30.0
#: A piece that is as correlated with its motion by chance, with a higher one, is not fitted.
MAX_CHANCE = 1e-3
#: With more regimes the sensor changes all the time, and has none.
MAX_REGIMES = 6


@dataclass(frozen=True, eq=False)
class PieceEstimate:
    """Parameters of a part of a record.

    Attributes:
        model: of the sensor.
        span: its samples.
        values: of the parameters, shape (P,).
        covariance: of these, by noise, shape (P, P).
    """

    model: SensorModel
    span: slice
    values: FloatArray
    covariance: FloatArray

    @property
    def parameters(self) -> NamedNumbers:
        """Return the values by name."""
        return dict(zip(self.model.parameter_names, self.values.tolist(), strict=True))

    @classmethod
    def from_fit(cls, span: slice, fitted: Fitted) -> PieceEstimate:
        """Return the parameters of a fit."""
        slopes = fitted.estimate.coordinates.slopes(fitted.estimate.z)
        covariance = fitted.estimate.covariance * np.outer(slopes, slopes)
        values = np.array(list(fitted.values.values()))
        return cls(fitted.evidence.model, span, values, covariance)

    def agrees_with(self, piece: PieceEstimate) -> bool:
        """Return whether noise explains how far the parameters of two pieces are apart."""
        return self.chance_of_equality(piece) > FALSE_CHANGE

    def chance_of_equality(self, piece: PieceEstimate) -> float:
        """Return the chance that noise separates the parameters of two pieces as far."""
        size = np.maximum(np.abs(self.values), np.abs(piece.values))
        scale = np.where(size > 0.0, size, 1.0)
        difference = (self.values - piece.values) / scale
        covariance = (self.covariance + piece.covariance) / np.outer(scale, scale)
        squares = float(difference @ np.linalg.pinv(covariance, hermitian=True) @ difference)
        return chi2_tail(float(difference.size), squares)

    def joined_with(self, piece: PieceEstimate) -> PieceEstimate:
        """Return both as one, by their weighted mean."""
        information = np.linalg.pinv(self.covariance, hermitian=True)
        added = np.linalg.pinv(piece.covariance, hermitian=True)
        covariance = np.linalg.pinv(information + added, hermitian=True)
        values = covariance @ (information @ self.values + added @ piece.values)
        span = slice(self.span.start, piece.span.stop)
        return replace(self, span=span, values=values, covariance=covariance)


def cut(calibration: Calibration, span: slice) -> Calibration:
    """Return a calibration of one record with a part of it."""
    step = f"samples {span.start} to {span.stop - 1} of it"
    return replace(calibration, records=(calibration.records[0].part(span, step),))


def piece_samples(samples: int) -> int:
    """Return the samples of a piece of a record."""
    return samples // max(min(samples // MIN_PIECE_SAMPLES, MAX_PIECES), 1)


def is_alike_throughout(record: Record) -> bool:
    """Return whether the reference has the same spectrum in each piece, but for its size.

    Else a model that lacks something looks like a change: each piece shows another part of it.
    """
    assert record.reference is not None
    length = piece_samples(record.samples)
    moving = np.where(record.reference_mask, record.reference, 0.0)
    pieces = moving[: record.samples // length * length].reshape(-1, length)
    power = np.abs(np.asarray(fft.rfft(pieces * np.hanning(length)))) ** 2
    edges = np.unique(np.geomspace(1, power.shape[1], ALIKE_BANDS + 1).astype(int))
    shares = band_sums(power, edges)
    mean = shares.mean(axis=0)
    moved = mean > MIN_BAND_SHARE * mean.sum()
    return bool(np.all(shares[:, moved] > mean[moved] / MAX_POWER_RATIO))


def find_regimes(
    calibration: Calibration, model: SensorModel, near: NamedNumbers, offset: float
) -> list[PieceEstimate]:
    """Return the regimes of a calibration of one record, by whole pieces.

    Args:
        calibration: of one record.
        model: of the sensor.
        near: parameters of the fit of the whole record, by name; each piece is tried there first.
            Empty where that fit explains too little.
        offset: ε of its clocks.
    """
    samples = calibration.records[0].samples
    count = samples // piece_samples(samples)
    if count < MIN_PIECES:
        return []
    edges = np.linspace(0, samples, count + 1).astype(int).tolist()
    spans = [slice(*pair) for pair in itertools.pairwise(edges)]
    pieces = list(_explained_pieces(calibration, model, spans, near, offset))
    if count - len(pieces) >= MAX_REGIMES:
        return []
    regimes = list(joined(pieces))
    return regimes if len(regimes) <= MAX_REGIMES else []


def _explained_pieces(
    calibration: Calibration,
    model: SensorModel,
    spans: Sequence[slice],
    near: NamedNumbers,
    offset: float,
) -> Iterator[PieceEstimate]:
    """Yield the pieces that the model explains, until more do not than changes may be in."""
    explained_count = 0
    for number, span in enumerate(spans):
        if number - explained_count >= MAX_REGIMES:
            return
        try:
            evidence = Evidence.gather(cut(calibration, span), model, offset)
            if evidence.bands is None or uncorrelated_records(evidence.bands, MAX_CHANCE):
                continue
            estimator, _ = choose(evidence)
            fitted = Fitted.at_first(replace(evidence, start=near or None), estimator, silent)
            if near and not fitted.adequate:
                fitted = Fitted.at_first(evidence, estimator, silent)
        except VibridentError:
            continue
        if fitted.adequate:
            explained_count += 1
            yield PieceEstimate.from_fit(span, fitted)


def joined(pieces: Iterable[PieceEstimate]) -> Iterator[PieceEstimate]:
    """Yield runs of consecutive pieces that agree."""
    run: PieceEstimate | None = None
    for piece in pieces:
        if run is not None and run.agrees_with(piece):
            run = run.joined_with(piece)
            continue
        if run is not None:
            yield run
        run = piece
    if run is not None:
        yield run
