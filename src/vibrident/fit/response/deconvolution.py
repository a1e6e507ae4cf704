"""Records and tables without the known responses of their channels.

A reference that holds r = K_ref x, and a response channel that holds y = K_resp S x, are related by

    W y = S (W K_resp / K_ref r),

exactly, for any motion and any filter W. K_resp goes to the reference's side, so that the response
keeps its noise; W is one in the band where both are known, falls to zero outside, and acts on both
channels: what moves the sensor outside the band is in neither. At the bins of the band, noise and
its weight are multiplied alike, so dividing there amplifies nothing. Samples nearer to an end of
a record than the filters reach are left out. A sine needs one value: the reference is scaled and
delayed by what holds at its frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.base.errors import InputError
from vibrident.base.fft_lengths import fast_length
from vibrident.data.known import KnownResponse
from vibrident.data.known.shapes import ComplexArray
from vibrident.data.records import BoolArray, Calibration, FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.response.tones import tone_frequency
from vibrident.physics.discretisation.inputs import filtered

#: What lies beyond an end of a record may change a sample by this part of the channel's rms.
TOLERANCE = 1e-4
#: Standard deviations of W's edges, as parts of the ends of the band, and their middles.
EDGE_WIDTH = 0.1
LOW_MIDDLE = 0.6
HIGH_MIDDLE = 1.25
#: Part of the lower end below which nothing is left, as a ratio may be infinite at rest.
MIN_BAND_FRACTION = 0.05
#: Highest frequency that a record tells, W's middle above it and the width of that edge, as parts
#: of the sampling rate.
MAX_FREQUENCY_RATIO = 0.44
MAX_MIDDLE_RATIO = 0.47
TOP_WIDTH_RATIO = 0.007
#: Part of a record that the filters may take at its ends, together.
MAX_LOST_FRACTION = 1.0 / 3.0
#: Part of a record from whose motion the size of what lies beyond its end is taken.
END_FRACTION = 0.02
#: Lower end of a band that begins at rest.
LOWEST_HZ = 1e-12
#: Periods that a record holds of the lowest frequency of a ratio that is not settled there.
MIN_PERIODS = 2.0
#: Part of a ratio by which it may differ from that at rest, which is then reached within a record.
MAX_RATIO_CHANGE = 1e-3
#: Smallest and largest factor by which the lower end is raised in a round.
MIN_RAISE_FACTOR = 1.25
MAX_RAISE_FACTOR = 2.0
#: Part of the reference's rms below the band that what is unknown there may leave in it.
MAX_UNKNOWN_RMS = 1e-2
#: Rounds in which the lower end of the band is raised for a short record.
MAX_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Chain:
    """The known responses of both channels.

    Attributes:
        reference, response: of each channel; None where nothing is known of it.
    """

    reference: KnownResponse | None
    response: KnownResponse | None

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return the band in which both are known."""
        bands = [known.band_hz for known in (self.reference, self.response) if known is not None]
        return max(low for low, _ in bands), min(high for _, high in bands)

    @property
    def scale(self) -> float:
        """Return the gain of the response's channel, by which its samples are divided."""
        if self.response is None:
            return 1.0
        low, high = self.response.band_hz
        middle = math.sqrt(max(low, 1e-3 * min(high, 1e3)) * min(high, 1e3 * max(low, 1.0)))
        return float(np.abs(self.response.value([middle])[0])) or 1.0

    def ratio(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return K_resp / K_ref over the scale, of the shape of the frequencies, all above zero."""
        value = np.ones(frequency_hz.shape, dtype=complex)
        if self.reference is not None:
            value = value / self.reference.value(frequency_hz)
        if self.response is not None:
            value = value * self.response.value(frequency_hz) / self.scale
        return np.asarray(value)


def chain_of(calibration: Calibration) -> Chain | None:
    """Return the known responses that are still in a calibration's data; None without any."""
    known_responses = calibration.known_responses
    stated = (known_responses.get("reference"), known_responses.get("response"))
    reference, response = (known if known and known.shapes else None for known in stated)
    return None if reference is None and response is None else Chain(reference, response)


def deconvolved(record: Record, chain: Chain) -> Record:
    """Return a screened record as its sensor's own motion and output.

    Raises:
        InputError: the band of the fit reaches beyond what is known, the record is too short, or
            it is a free decay whose channel has a response.
    """
    if record.reference is None or record.excitation == "decay":
        if chain.response is None:
            return record
        raise InputError(
            "A free decay cannot be freed of what its channel does to it.",
            expected="records with a reference where [response] states a known_response",
            found=f"excitation = {record.excitation!r}",
            where=f"record {record.name!r}",
            remedy="leave the decay out, or the known response",
        )
    band_hz = _band_of(record, chain)
    if record.excitation == "sine":
        return _scale_sine(record, chain, band_hz)
    return _filter_to_band(record, chain, band_hz)


def without_chain(calibration: Calibration, chain: Chain) -> Calibration:
    """Return a tabulated calibration as one of the sensor, in the band that is known."""
    table = calibration.table
    assert table is not None
    inside = table.within(chain.band_hz)
    ratio = chain.ratio(inside.frequency_hz) * chain.scale
    size = np.abs(ratio)
    u = inside.magnitude_uncertainty
    sensors = replace(
        inside,
        magnitude=inside.magnitude / size,
        phase_rad=None if inside.phase_rad is None else inside.phase_rad - np.angle(ratio),
        magnitude_uncertainty=None if u is None else u / size,
        provenance=inside.provenance.then(_describe(chain, chain.band_hz)),
    )
    known = calibration.known_responses.items()
    done = {f"{name}_known_response": response.taken_out() for name, response in known}
    return replace(calibration, table=sensors, mounting=None, **done)


def _band_of(record: Record, chain: Chain) -> tuple[float, float]:
    """Return the band of a record's fit that is known: where none is stated it is cut to it."""
    low, high = chain.band_hz
    top = min(
        high,
        (0.5 if record.excitation == "sine" else MAX_FREQUENCY_RATIO) * record.sampling_rate_hz,
    )
    if record.band_hz is None:
        return low, top
    first, last = record.band_hz
    first = low if first <= LOWEST_HZ else first  # not stated
    last = high if math.isinf(last) else min(last, 0.5 * record.sampling_rate_hz)
    if first < low * (1.0 - 1e-9) or last > high * (1.0 + 1e-9):
        raise InputError(
            "The band of the fit reaches beyond what is known of the channels.",
            expected=f"a band within {low:g} to {high:g} Hz",
            found=f"{first:g} to {last:g} Hz",
            where=f"record {record.name!r}",
            remedy="narrow from_hz and to_hz, or ⟦identify.band_hz⟧",
        )
    return first, min(last, top)


def _describe(chain: Chain, band_hz: tuple[float, float]) -> str:
    """Return what was taken out of the channels, in words, for the provenance."""
    pairs = (("reference", chain.reference), ("response", chain.response))
    parts = [f"{name}: {known.source}" for name, known in pairs if known is not None]
    return f"known response taken out ({'; '.join(parts)}), {band_hz[0]:.5g} to {band_hz[1]:.5g} Hz"


def _scale_sine(record: Record, chain: Chain, band_hz: tuple[float, float]) -> Record:
    """Return a sine with its reference scaled and delayed by the ratio at its frequency."""
    assert record.reference is not None
    low, high = band_hz
    frequency_hz = tone_frequency(record)
    ratio = complex(chain.ratio(np.array([min(max(frequency_hz, low), high)]))[0])
    sign = -1.0 if ratio.real < 0.0 else 1.0  # which keeps the delay within a quarter of a period
    delay_s = -np.angle(sign * ratio) / (2.0 * np.pi * frequency_hz)

    def late(turns: FloatArray) -> ComplexArray:
        return np.asarray(np.exp(-2j * np.pi * turns * delay_s * record.sampling_rate_hz))

    reference, valid = filtered(record.reference, record.reference_mask, late)
    scaled = _Filter(sign * abs(ratio) * reference, valid, 0, 0)
    response = _Filter(record.response, record.mask, 0, 0)
    return _with_channels(record, scaled, response, span_of(valid), chain, band_hz)


def _filter_to_band(record: Record, chain: Chain, band_hz: tuple[float, float]) -> Record:
    """Return a record with both channels filtered to the band, its reference by the ratio too."""
    assert record.reference is not None
    low, high = band_hz
    reference, response, low = _filter_channels(record, chain, low)
    begin = max(reference.begin, response.begin)
    end = max(reference.end, response.end)
    lost = begin + end
    if lost > MAX_LOST_FRACTION * record.samples or not low < 0.5 * high:
        raise InputError(
            "The record is too short for the known response of its channels.",
            expected="a record many times as long as a period at the lower end of its band",
            found=f"{record.samples} samples, of which {lost} would be left out",
            where=f"record {record.name!r}",
            remedy="use a longer record, or a higher from_hz",
        )
    inside = slice(begin, record.samples - end)
    return _with_channels(record, reference, response, inside, chain, (low, high))


def _with_channels(
    record: Record,
    reference: _Filter,
    response: _Filter,
    inside: slice,
    chain: Chain,
    band_hz: tuple[float, float],
) -> Record:
    """Return a part of a record with other channels, and what was done to it."""
    lost = record.samples - (inside.stop - inside.start)
    description = f"{_describe(chain, band_hz)}; {lost} samples at the ends left out"
    filtered_record = replace(
        record,
        reference=reference.samples,
        response=response.samples / chain.scale,
        valid=response.valid,
        reference_valid=reference.valid,
        band_hz=(max(band_hz[0], LOWEST_HZ), band_hz[1]),
        reference_full_scale=None,
        response_full_scale=None,
    )
    return filtered_record.part(inside, description)


def _filter_channels(record: Record, chain: Chain, stated: float) -> tuple[_Filter, _Filter, float]:
    """Return both channels filtered, and the lower end of the band that they leave.

    Where hardly any motion is below the band, the ratio is continued there; else it is cut off, as
    low as the length of the record allows.

    Args:
        record: with a reference.
        chain: the known responses.
        stated: lower end of the fit's band, Hz.
    """
    reference = record.reference
    known_low, high = chain.band_hz
    assert reference is not None
    samples = record.samples
    rate_hz = record.sampling_rate_hz
    longest = MIN_PERIODS / record.duration_s
    low = known_low if _is_settled(chain, longest) else max(known_low, stated, longest)
    for _ in range(MAX_ROUNDS):
        cut = low > 0.0 and _has_motion_below(
            reference, record.reference_mask, low * record.duration_s
        )
        edges = Edges(low if cut else 0.0, min(high, MAX_FREQUENCY_RATIO * rate_hz), low)
        freed = _Filter.of(reference, record.reference_mask, rate_hz, edges, chain)
        response = _Filter.of(record.response, record.mask, rate_hz, edges, None)
        lost = max(freed.begin, response.begin) + max(freed.end, response.end)
        if lost <= MAX_LOST_FRACTION * samples or low == 0.0:
            break
        low *= min(max(MIN_RAISE_FACTOR, lost / (MAX_LOST_FRACTION * samples)), MAX_RAISE_FACTOR)
    return freed, response, max(edges.continued, stated)


def _is_settled(chain: Chain, frequency_hz: float) -> bool:
    """Tell whether the ratio goes to rest from a frequency on as a constant with a delay does."""
    half, at = chain.ratio(frequency_hz * np.array([0.5, 1.0]))
    turn = 0.5 * np.angle((half**2 / at) ** 2)  # zero for a delay, whatever the sign
    return bool(abs(abs(at / half) - 1.0) < MAX_RATIO_CHANGE and abs(turn) < MAX_RATIO_CHANGE)


def _has_motion_below(reference: FloatArray, valid: BoolArray, periods: float) -> bool:
    """Tell whether motion below so many periods a record is more than a small part of all."""
    moving = np.where(valid, reference - reference[valid].mean(), 0.0) * np.hanning(reference.size)
    power = np.abs(fft.rfft(moving)) ** 2
    return bool(np.sum(power[: int(periods) + 1]) > MAX_UNKNOWN_RMS**2 * np.sum(power))


@dataclass(frozen=True)
class Edges:
    """Edges of W, and the frequency below which the ratio is continued, Hz.

    Attributes:
        low: lower end of W's band; 0 where it goes on to rest.
        high: upper end.
        continued: below it the ratio keeps its magnitude, and its phase goes to zero in proportion.
    """

    low: float
    high: float
    continued: float

    def window(self, frequency_hz: FloatArray, rate_hz: float) -> FloatArray:
        """Return W at frequencies: one within the band, with smooth edges outside."""
        from scipy.special import ndtr  # slow to load

        middle = HIGH_MIDDLE * self.high
        width = EDGE_WIDTH * self.high
        if middle > MAX_MIDDLE_RATIO * rate_hz:
            middle = MAX_MIDDLE_RATIO * rate_hz
            width = TOP_WIDTH_RATIO * rate_hz
        value = ndtr((middle - frequency_hz) / width)
        if self.low > 0.0:
            rising = ndtr((frequency_hz - LOW_MIDDLE * self.low) / (EDGE_WIDTH * self.low))
            value = value * np.where(frequency_hz > MIN_BAND_FRACTION * self.low, rising, 0.0)
        return np.asarray(value)

    def ratio(self, frequency_hz: FloatArray, chain: Chain) -> ComplexArray:
        """Return the ratio of a chain, continued where W does not cut it off."""
        if self.low > 0.0 or self.continued == 0.0:
            return chain.ratio(frequency_hz)
        value = chain.ratio(np.maximum(frequency_hz, self.continued))
        below = frequency_hz < self.continued
        edge = complex(chain.ratio(np.array([self.continued]))[0])
        sign = -1.0 if edge.real < 0.0 else 1.0
        part = frequency_hz[below] / self.continued
        value[below] = sign * abs(edge) * np.exp(1j * np.angle(sign * edge) * part)
        return value


@dataclass(frozen=True, eq=False)
class _Filter:
    """A filtered channel, and how far from its ends what lies beyond them is felt.

    Attributes:
        samples: shape (N,).
        valid: where no invalid sample is felt, shape (N,).
        begin, end: samples at either end that what lies beyond may change.
    """

    samples: FloatArray
    valid: BoolArray
    begin: int
    end: int

    @classmethod
    def of(
        cls,
        values: FloatArray,
        valid: BoolArray,
        rate_hz: float,
        edges: Edges,
        chain: Chain | None,
    ) -> _Filter:
        """Filter a channel to a band and, where it is the reference, by the ratio of a chain."""
        count = values.shape[0]
        size = fast_length(2 * count)
        at = np.arange(size // 2 + 1) * rate_hz / size
        at[0] = 1e-6 * at[1]
        ratio = 1.0 + 0j if chain is None else edges.ratio(at, chain)
        spectrum = edges.window(at, rate_hz) * ratio
        places = np.arange(count)
        filled = values if valid.all() else np.interp(places, places[valid], values[valid])
        part = max(int(END_FRACTION * count), 4)
        ends = filled[:part], filled[-part:]
        offset = 0.5 * float(ends[0].mean() + ends[1].mean())
        moving = filled - offset
        behind_filter = np.asarray(fft.irfft(fft.rfft(moving, size) * spectrum, size))[:count]
        kernel = np.asarray(fft.irfft(spectrum, size))
        behind = _tail(kernel[: size // 2])  # of a sample that is so much earlier
        ahead = _tail(kernel[: size // 2 : -1])
        rms = float(np.std(behind_filter)) or 1.0
        begin, end = (
            int(np.searchsorted(-tail, -TOLERANCE * rms / max(float(np.std(beyond)), 1e-300)))
            for tail, beyond in zip((behind, ahead), ends, strict=True)
        )
        felt = valid
        if not valid.all():
            least = TOLERANCE * rms / (float(np.std(moving)) or 1.0)
            late, early = (int(np.searchsorted(-tail, -least)) for tail in (behind, ahead))
            felt = _away_from_invalid(valid, early, late)
        samples = behind_filter + offset * float(spectrum[0].real)
        return cls(samples, felt, min(begin, count), min(end, count))


def _tail(kernel: FloatArray) -> FloatArray:
    """Return the root of the sum of squares of a kernel from each sample on, falling."""
    return np.sqrt(np.cumsum(kernel[::-1] ** 2)[::-1])


def _away_from_invalid(valid: BoolArray, early: int, late: int) -> BoolArray:
    """Return where no invalid sample lies within ``early`` samples ahead or ``late`` behind."""
    edges = np.zeros(valid.size + 1)
    bad = np.flatnonzero(~valid)
    np.add.at(edges, np.maximum(bad - early, 0), 1.0)
    np.add.at(edges, np.minimum(bad + late + 1, valid.size), -1.0)
    return np.cumsum(edges[:-1]) < 0.5
