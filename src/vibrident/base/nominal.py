"""Nominal one-third-octave frequencies (ISO 266), and those at which a certificate has values."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass

NOMINAL = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)  # of one decade, ISO 266:1997
#: Relative distance within which two frequencies are the same: far above a tone's uncertainty, far
#: below the distance of nominal and exact values.
SAME = 1e-4
#: Usual reference frequency of accelerometers (ISO 16063-21).
ACCELEROMETER_REFERENCE_HZ = 160.0
#: Usual reference frequency of seismometers and geophones.
SEISMOMETER_REFERENCE_HZ = 1.0


@dataclass(frozen=True)
class Nominal:
    """Frequency at which a value is stated: nominal, and as computed with, both in Hz."""

    nominal_hz: float
    frequency_hz: float

    @property
    def name(self) -> str:
        """Return the nominal value as text, in Hz: "31.5"."""
        return f"{self.nominal_hz:.6g}"


@functools.cache
def nominal_value(n: int) -> float:
    """Return the nominal value of the exact frequency 10^(n/10) Hz."""
    decade, step = divmod(n, 10)
    return float(f"{NOMINAL[step]}e{decade}")  # as a decimal, so that 0.63 is the float 0.63


def nominal_name(frequency_hz: float, within: float = SAME) -> str | None:
    """Return the nominal name (Hz) of an exact one-third-octave frequency (158.49 → "160").

    None for any other frequency.
    """
    if not (math.isfinite(frequency_hz) and frequency_hz > 0):
        return None
    n = round(10 * math.log10(frequency_hz))
    return f"{nominal_value(n):.6g}" if abs(frequency_hz / 10 ** (n / 10) - 1) <= within else None


def is_same_frequency(one_hz: float, other_hz: float) -> bool:
    """Return whether two frequencies are the same within a tone's uncertainty."""
    return abs(one_hz / other_hz - 1.0) <= SAME


def nominal_frequencies(
    low_hz: float, high_hz: float, measured_hz: Iterable[float] = ()
) -> tuple[Nominal, ...]:
    """Return the nominal frequencies from ``low_hz`` to ``high_hz``, both included, rising.

    Each means the exact base-10 frequency 10^(n/10) Hz (nominal 160: 158.49 Hz), unless more of the
    data were taken at nominal values (160.00 Hz) than at exact ones. ``measured_hz``: frequencies
    at which there are data.
    """
    if not (0 < low_hz <= high_hz and math.isfinite(high_hz)):
        return ()
    first = math.floor(10 * math.log10(low_hz)) - 1
    last = math.ceil(10 * math.log10(high_hz)) + 1
    at_nominal = _taken_at_nominal(f for f in measured_hz if f and f > 0)
    frequencies = []
    for n in range(first, last + 1):
        frequency = nominal_value(n) if at_nominal else 10 ** (n / 10)
        if low_hz * (1 - SAME) <= frequency <= high_hz * (1 + SAME):
            frequencies.append(Nominal(nominal_value(n), frequency))
    return tuple(frequencies)


def _taken_at_nominal(measured_hz: Iterable[float]) -> bool:
    """Return whether more of the frequencies are nominal values than exact ones.

    Only frequencies count of which nominal and exact value differ.
    """
    nominal = exact = 0
    for frequency in measured_hz:
        pair = _distinct_pair(round(10 * math.log10(frequency)))
        if pair is not None:
            nominal += is_same_frequency(frequency, pair.nominal_hz)
            exact += is_same_frequency(frequency, pair.frequency_hz)
    return nominal > exact


@functools.cache
def _distinct_pair(n: int) -> Nominal | None:
    """Return the nominal and exact value of 10^(n/10) Hz; None where they are the same."""
    pair = Nominal(nominal_value(n), 10 ** (n / 10))
    return None if is_same_frequency(pair.nominal_hz, pair.frequency_hz) else pair


def choose_reference(
    low_hz: float, high_hz: float, measured_hz: Iterable[float] = (), stated_hz: float | None = None
) -> tuple[Nominal | None, str]:
    """Return the reference frequency of a measured band, and how it was chosen.

    Args:
        low_hz: lower end of the band.
        high_hz: upper end of the band.
        measured_hz: frequencies at which there are data.
        stated_hz: frequency that the calibration file states.

    Returns:
        the frequency and the reason; None if the stated one lies outside the band, or if the band
        holds no nominal one.
    """
    available = nominal_frequencies(low_hz, high_hz, measured_hz)
    by_name = {item.nominal_hz: item for item in available}
    if stated_hz is not None:
        for item in available:
            if is_same_frequency(item.nominal_hz, stated_hz):
                return item, "as stated"
        if low_hz * (1 - SAME) <= stated_hz <= high_hz * (1 + SAME):
            return Nominal(stated_hz, stated_hz), "as stated"
        reason = f"the stated reference frequency {stated_hz:.6g} Hz lies outside the measured band"
        return None, reason
    default = f"{ACCELEROMETER_REFERENCE_HZ:g} Hz"
    if ACCELEROMETER_REFERENCE_HZ in by_name:
        return by_name[ACCELEROMETER_REFERENCE_HZ], "the default"
    if SEISMOMETER_REFERENCE_HZ in by_name:
        reason = f"{default} lies outside the measured band; chosen as usual for seismometers"
        return by_name[SEISMOMETER_REFERENCE_HZ], reason
    if not available and is_same_frequency(low_hz, high_hz):
        return Nominal(low_hz, low_hz), "the only frequency that was measured"
    if not available:
        return None, "the measured band holds no nominal frequency"
    centre = math.sqrt(low_hz * high_hz)
    nearest = min(available, key=lambda item: abs(math.log(item.frequency_hz / centre)))
    usual = f"{default} and {SEISMOMETER_REFERENCE_HZ:g} Hz"
    return nearest, f"{usual} lie outside the measured band; chosen nearest to its middle"
