"""Records at the bins of the band, weighted by their noise, at the estimate."""

from __future__ import annotations

import functools

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.bins import RecordBins
from vibrident.fit.bins.record import BinsAt, ModelLines
from vibrident.fit.descent.bins_in_noise import Weighed
from vibrident.fit.descent.in_noise import GroupAt
from vibrident.fit.descent.settle import Settled
from vibrident.fit.noise.spectrum import NoiseSpectrum
from vibrident.fit.response.response import ComplexArray

#: Numbers of all records together that are carried from the fit to the tests: a limit of memory.
MAX_CARRIED = 1 << 23


def weighed_records(settled: Settled) -> dict[int, Weighed]:
    """Return the records that are one unbroken segment, by number.

    Signals are in units of each record's noise. Of long records none: they are made again.
    """
    size = sum(place.jacobian.size + place.rows.nuisances.columns.size for place in settled.places)
    if size > MAX_CARRIED:
        return {}
    problem = settled.band.problem
    owners = [segment.record for segment in problem.segments]
    records: dict[int, Weighed] = {}
    for place in settled.places:
        if place.group.used is not None:
            continue
        for row, number in enumerate(place.group.segments):
            if owners.count(owners[number]) == 1:
                records[owners[number]] = _weighed(settled, place, row, number)
    return records


def _weighed(settled: Settled, place: GroupAt, row: int, number: int) -> Weighed:
    """Return one segment of a group."""
    problem = settled.band.problem
    grid = place.group.grid
    owner = problem.segments[number].record
    unit = float(settled.deviation[owner])
    spectrum = settled.weighting.spectra[number]
    counts = grid.counts * grid.samples
    nuisances = place.rows.nuisances.columns[row]
    predicted = place.rows.predicted[row] / unit

    def response(z: FloatArray) -> ComplexArray:
        values = settled.coordinates.values(z)
        quantity = problem.frame.quantity
        bins = settled.band.model.frequency_response(values, grid.frequency_hz, quantity)
        return np.asarray(bins, dtype=complex)

    def columns(_: bool) -> BinsAt:
        return lambda part: nuisances[:, part]

    record = RecordBins(
        residual=place.rows.residual[row] / unit,
        predicted=predicted.__getitem__,
        used=np.broadcast_to(True, grid.samples),
        one_sided=counts,
        jacobian=place.rows.jacobian[row] * settled.coordinates.slopes(settled.z)[:, None] / unit,
        free=columns,
        model=ModelLines(response, settled.z, grid.bins),
        z=settled.z,
        floor=float((problem.noise_floor[owner] / unit) ** 2),
        hum=(),
        last=grid.last - 1,
    )
    scaled = NoiseSpectrum(
        spectrum.psd / unit**2,
        spectrum.input_noise / unit**2,
        spectrum.input_noise_at / unit**2,
        functools.partial(_scaled, spectrum, unit),
        spectrum.excited,
        spectrum.tones,
        spectrum.free,
    )
    return Weighed(
        record,
        scaled,
        columns(True),
        record.residual,
        place.jacobian[row] / unit,
        place.of_noise,
        counts * spectrum.excited / (grid.samples * scaled.psd),
    )


def _scaled(spectrum: NoiseSpectrum, unit: float) -> FloatArray:
    return spectrum.doubt() / unit**2
