"""Hum of the mains in records whose estimator does not look for it in its own noise.

The residual of a prediction shows hum, but does not measure it: initial states and parameters have
taken a part of it, and near a resonance or a line of the motion it cannot be separated from these.
So a fit gets the frequencies alone (:attr:`vibrident.data.records.Record.hum_hz`), and amplitude,
phase and their slow change are its unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.fit.departures.signals import BAND_OVER_HIGHEST, MIN_BINS
from vibrident.fit.descent.weighted_bins import PredictedRecord, Transfer, weighted_records
from vibrident.fit.noise.tones import RecordTones, with_shared_tones
from vibrident.fit.response.sine_fit import response_sine, tone_frequency


def with_hum(
    records: tuple[Record, ...], predicted: Sequence[FloatArray], transfer: Transfer
) -> tuple[Record, ...]:
    """Return the records with the tones of their residuals, or these records where none is new.

    Which tones of a record are in all, :func:`with_shared_tones` says.

    Args:
        records: the records.
        predicted: response of a model to each, shape (samples,), NaN where it is not defined.
        transfer: of the model, by frequency in Hz.
    """
    with_new = list(records)
    predicted_records = [
        _with_prediction(number, record, series, transfer)
        for number, (record, series) in enumerate(zip(records, predicted, strict=True))
        if record.reference is not None
    ]
    shown: list[tuple[int, RecordTones]] = []
    for bins in weighted_records(predicted_records):
        record = records[bins.record]
        line_hz = record.sampling_rate_hz / bins.samples
        # Less than a turn is the nuisance of a drift, and no hum.
        known = tuple(hz / line_hz for hz in record.hum_hz if hz >= line_hz)
        shown.append((bins.record, bins.spectrum.record_tones(line_hz, known)))
    tones = with_shared_tones([of_record for _, of_record in shown])
    for (number, of_record), places in zip(shown, tones, strict=True):
        if len(places) > len(of_record.known):
            slow_hz = [hz for hz in records[number].hum_hz if hz < of_record.bin_hz]
            hum_hz = slow_hz + sorted(of_record.bin_hz * place for place in places)
            with_new[number] = replace(records[number], hum_hz=tuple(hum_hz))
    return tuple(with_new)


def _with_prediction(
    number: int, record: Record, predicted: FloatArray, transfer: Transfer
) -> PredictedRecord:
    """Return a record beside its prediction, or a sine beside the best one, in its band."""
    if record.excitation != "sine":
        return PredictedRecord(number, record, predicted, transfer=transfer)
    turns = tone_frequency(record) / record.sampling_rate_hz
    if not np.any(np.isfinite(predicted)):
        predicted = response_sine(record)
    most_bins = max(2 * MIN_BINS, int(BAND_OVER_HIGHEST * turns * record.samples) + 1)
    return PredictedRecord(number, record, predicted, turns, transfer, most_bins)
