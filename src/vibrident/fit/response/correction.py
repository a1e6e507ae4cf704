"""Records and tables that a small change of the response was taken out of.

What turns and scales the response by e^c(f) does so to the motion: y = S e^c x. So the reference
takes it, and the response keeps its noise. About the line between its ends, the motion goes on
beyond them as its mirror image that fades, so that neither its value nor its slope jumps there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import FloatArray, Record, ResponseTable
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.tones import tone_frequency

#: Change c(f) of the logarithm of the response, from frequencies in Hz.
LogChange = Callable[[FloatArray], ComplexArray]


def with_reference_changed(
    record: Record, log_change: LogChange, band_hz: tuple[float, float]
) -> Record:
    """Return the record with its reference multiplied by e^c(f).

    A record without a reference stays as it is.

    Args:
        record: the record.
        log_change: c(f).
        band_hz: lowest and highest frequency at which it is known; beyond, it keeps these values,
            and its phase goes to zero with the frequency. A sine is scaled and delayed.
    """
    reference = record.reference
    if reference is None:
        return record
    valid = record.reference_mask
    places = np.arange(record.samples)
    motion = reference if valid.all() else np.interp(places, places[valid], reference[valid])
    line = np.linspace(motion[0], motion[-1], record.samples)
    reach = min((fast_length(2 * record.samples) - record.samples) // 2, record.samples - 1)
    extended = np.pad(motion - line, reach, mode="reflect", reflect_type="odd")
    fade = np.sin(0.5 * np.pi * np.arange(reach) / reach) ** 2
    extended[:reach] *= fade
    extended[-reach:] *= fade[::-1]
    frequency_hz = np.asarray(fft.rfftfreq(extended.size, record.sampling_interval_s), dtype=float)
    factor = np.exp(_continued(log_change, frequency_hz, record, band_hz))
    changed = fft.irfft(fft.rfft(extended) * factor, extended.size)
    return replace(record, reference=changed[reach : reach + record.samples] + line)


def _continued(
    log_change: LogChange, frequency_hz: FloatArray, record: Record, band_hz: tuple[float, float]
) -> ComplexArray:
    """Return c(f) at all frequencies of a transform."""
    if record.excitation == "sine":
        tone_hz = tone_frequency(record)
        change = log_change(np.full(1, tone_hz))
        return change.real + 1j * change.imag * frequency_hz / tone_hz
    change = log_change(np.clip(frequency_hz, *band_hz))
    return change.real + 1j * change.imag * np.minimum(frequency_hz / band_hz[0], 1.0)


def table_without(table: ResponseTable, log_change: LogChange) -> ResponseTable:
    """Return the table with its response divided by e^c(f)."""
    change = log_change(table.frequency_hz)
    factor = np.exp(-change.real)
    u = table.magnitude_uncertainty
    return replace(
        table,
        magnitude=factor * table.magnitude,
        phase_rad=None if table.phase_rad is None else table.phase_rad - change.imag,
        magnitude_uncertainty=None if u is None else factor * u,
    )
