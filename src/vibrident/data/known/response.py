"""Known response of a channel, from a table, poles, a filter, corners, or a result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vibrident.base.binding import bound
from vibrident.base.errors import InputError
from vibrident.data.effects import SystematicEffect
from vibrident.data.known.shapes import (
    ComplexArray,
    DigitalFilter,
    FloatArray,
    RationalResponse,
    Shape,
    Tabulated,
)
from vibrident.data.known.unsure import (
    ErrorKind,
    change_by,
    corner_effect,
    effect_of,
    flat_effects,
    tabulated_effects,
)

#: An error of log response between the points of a table counts as uncertainty above this.
MIN_BETWEEN_POINTS = 1e-5


@dataclass(frozen=True, eq=False)
class KnownResponse:
    """Response of a channel: what it holds per unit of what it measures, for e^{+jωt}.

    Of a reference: its channel's unit per m/s², m/s or m; of a response: its channel's unit per
    unit of the sensor's output. Make one by :meth:`from_table`, :meth:`from_poles`,
    :meth:`from_filter`, :meth:`from_corners` or :meth:`from_result`; :meth:`times` joins those of a
    chain.

    Attributes:
        shapes: factors of the response; none if it was taken out of the data already.
        channel_unit: unit of what the channel holds, for messages.
        band_hz: lowest and highest frequency at which it is known.
        effects: systematic effects, with their changes of log response over frequency; each is
            common to all frequencies, different ones are independent.
        source: what states it, in words.
        files: name and SHA-256 of each file that states it.

    Examples:
        >>> import vibrident
        >>> amplifier = vibrident.KnownResponse.from_corners(highpass_hz=[0.5], gain=0.01)
        >>> abs(amplifier.value([0.5, 160.0])).round(5).tolist()
        [0.00707, 0.01]
    """

    shapes: tuple[Shape, ...]
    channel_unit: str = "V"
    band_hz: tuple[float, float] = (0.0, math.inf)
    effects: tuple[SystematicEffect, ...] = ()
    source: str = "known response"
    files: tuple[tuple[str, str], ...] = ()

    def __repr__(self) -> str:
        """Return the source, band and uncertainty."""
        low, high = self.band_hz
        return f"<KnownResponse {self.source}: {low:g} to {high:g} Hz, {len(self.effects)} effects>"

    def value(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the complex response at frequencies, of their shape."""
        at = np.asarray(frequency_hz, dtype=float)
        value = np.ones(at.shape, dtype=complex)
        for shape in self.shapes:
            value = value * shape.at(at)
        return value

    def covariance(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return the covariance of log response, of n frequencies.

        Real parts (relative magnitudes) come first, then imaginary ones (phases, rad); shape
        (2n, 2n).
        """
        at = np.asarray(frequency_hz, dtype=float)
        columns = [change_by(effect, at) for effect in self.effects]
        if not columns:
            return np.zeros((2 * at.size, 2 * at.size))
        stacked = np.stack([np.concatenate([c.real, c.imag]) for c in columns], axis=1)
        return np.asarray(stacked @ stacked.T)

    def times(self, outer: KnownResponse) -> KnownResponse:
        """Return the response of both in a chain; this one is nearer to the recorder."""
        low = max(self.band_hz[0], outer.band_hz[0])
        high = min(self.band_hz[1], outer.band_hz[1])
        if not low < high:
            raise InputError(
                "The known responses of a channel have no band in common.",
                expected="bands that overlap",
                found=f"{self.band_hz[0]:g} to {self.band_hz[1]:g} Hz and "
                f"{outer.band_hz[0]:g} to {outer.band_hz[1]:g} Hz",
                where="known response",
                remedy="correct one of the two",
            )
        return replace(
            self,
            shapes=(*self.shapes, *outer.shapes),
            band_hz=(low, high),
            effects=(*self.effects, *outer.effects),
            source=f"{self.source}, {outer.source}",
            files=(*self.files, *outer.files),
        )

    def taken_out(self) -> KnownResponse:
        """Return the response that remains after correcting the data: one, with its uncertainty."""
        return replace(self, shapes=())

    @classmethod
    def from_table(
        cls,
        frequency_hz: ArrayLike,
        magnitude: ArrayLike,
        phase_rad: ArrayLike,
        *,
        magnitude_uncertainty: ArrayLike | None = None,
        phase_uncertainty_rad: ArrayLike | None = None,
        correlation_octaves: float | None = None,
        channel_unit: str = "V",
        source: str = "known response",
    ) -> KnownResponse:
        """Return the response of a table, such as a certificate's; known between its ends only.

        The interpolation error between its points is an uncertainty of its own.

        Args:
            frequency_hz: rising, shape (n,).
            magnitude: channel unit per unit of what is measured, shape (n,).
            phase_rad: of the channel minus that of what it measures: lag negative.
            magnitude_uncertainty: standard uncertainty (k = 1), in the unit of the magnitude.
            phase_uncertainty_rad: standard uncertainty (k = 1).
            correlation_octaves: distance over which the errors at two frequencies lose their
                correlation, exp(−½ (octaves/distance)²); None: one common error, fully correlated.
            channel_unit: of what the channel holds.
            source: what states it.

        Raises:
            InputError: the frequencies do not rise, or a column cannot be used.
        """
        table = Tabulated(
            *(np.asarray(c, dtype=float) for c in (frequency_hz, magnitude, phase_rad))
        )
        u = (
            None
            if magnitude_uncertainty is None
            else np.asarray(magnitude_uncertainty, dtype=float)
        )
        sizes: dict[ErrorKind, Any] = {
            "gain": None if u is None else u / table.magnitude,
            "phase": phase_uncertainty_rad,
        }
        effects = tabulated_effects(source, table.frequency_hz, sizes, correlation_octaves)
        between = table.between_points()
        if np.max(np.abs(between)) > MIN_BETWEEN_POINTS:
            name = f"{source}, between its points"
            effects += (effect_of(name, "gain", table.frequency_hz, between),)
        band_hz = float(table.frequency_hz[0]), float(table.frequency_hz[-1])
        return cls((table,), channel_unit, band_hz, effects, source)

    @classmethod
    def from_poles(
        cls,
        poles: ArrayLike,
        zeros: ArrayLike = (),
        gain: float = 1.0,
        *,
        standard_uncertainty: float = 0.0,
        phase_uncertainty_rad: float = 0.0,
        channel_unit: str = "V",
        source: str = "poles and zeros",
    ) -> KnownResponse:
        """Return gain · Π(s − zeros)/Π(s − poles), poles and zeros in rad/s.

        Args:
            poles: stable, complex ones in pairs.
            zeros: complex ones in pairs.
            gain: the factor of the products: of StationXML, normalisation factor × sensitivity.
            standard_uncertainty: of the magnitude, relative, common to all frequencies.
            phase_uncertainty_rad: of the phase, common to all frequencies.
            channel_unit: of what the channel holds.
            source: what states it.

        Raises:
            InputError: a pole is unstable, or a number cannot be used.
        """
        shape = RationalResponse(
            np.asarray(poles, complex), np.asarray(zeros, complex), float(gain)
        )
        effects = flat_effects(source, standard_uncertainty, phase_uncertainty_rad)
        return cls((shape,), channel_unit, effects=effects, source=source)

    @classmethod
    def from_result(cls, result: Any, quantity: str | None = None) -> KnownResponse:
        """Return the response of a sensor that vibrident identified.

        The parameters' covariance is its uncertainty; it is known in the band of their data.

        Args:
            result: of an identification, or the path of a ``result.json``.
            quantity: of the motion that it measures as a reference; None: as it was identified.

        Raises:
            InputError: the file cannot be read, or the result states no uncertainty.
        """
        response: KnownResponse = bound("known_response")(result, quantity)
        return response

    @classmethod
    def from_filter(
        cls,
        numerator: ArrayLike,
        denominator: ArrayLike = (1.0,),
        *,
        rate_hz: float,
        channel_unit: str = "V",
        source: str = "digital filter",
    ) -> KnownResponse:
        """Return Σ b_k z^{−k} / Σ a_k z^{−k} at the input's ``rate_hz``; known to half that rate.

        Raises:
            InputError: the filter is unstable, or a number cannot be used.
        """
        shape = DigitalFilter(
            np.asarray(numerator, float), np.asarray(denominator, float), float(rate_hz)
        )
        return cls((shape,), channel_unit, (0.0, shape.top_hz), source=source)

    @classmethod
    def from_corners(
        cls,
        highpass_hz: Sequence[float] = (),
        lowpass_hz: Sequence[float] = (),
        gain: float = 1.0,
        *,
        corner_uncertainty: float = 0.0,
        standard_uncertainty: float = 0.0,
        channel_unit: str = "V",
        source: str = "conditioner",
    ) -> KnownResponse:
        """Return the response of a charge or IEPE conditioner: first-order high- and low-passes.

        Args:
            highpass_hz: corner (−3 dB) frequencies.
            lowpass_hz: the same.
            gain: in the pass-band.
            corner_uncertainty: standard uncertainty of each corner, relative.
            standard_uncertainty: of the gain, relative.
            channel_unit: of what the channel holds.
            source: what states it.

        Raises:
            InputError: a corner is not positive.
        """
        corners = [*highpass_hz, *lowpass_hz]
        if not corners or not all(math.isfinite(hz) and hz > 0.0 for hz in corners):
            raise InputError(
                "The corners of a conditioner cannot be used.",
                expected="frequencies above 0 Hz, at least one",
                found=", ".join(f"{hz:g} Hz" for hz in corners) or "none",
                where="known response",
                remedy="correct highpass_hz and lowpass_hz",
            )
        rates = 2.0 * np.pi * np.array(corners)
        gain = float(gain * np.prod(rates[len(highpass_hz) :]))
        shape = RationalResponse(-rates.astype(complex), np.zeros(len(highpass_hz), complex), gain)
        effects = flat_effects(source, standard_uncertainty, 0.0)
        if corner_uncertainty > 0.0:
            sides = [(hz, True) for hz in highpass_hz] + [(hz, False) for hz in lowpass_hz]
            effects += tuple(
                corner_effect(source, hz, corner_uncertainty, highpass=side) for hz, side in sides
            )
        return cls((shape,), channel_unit, effects=effects, source=source)


def refuse_known(by_channel: Mapping[str, object], what: str, where: str) -> None:
    """Refuse known responses, by channel, as ``what`` does not take them out of the data."""
    channels = [f"[{name}]" for name, chain in by_channel.items() if chain and name != "mounting"]
    statements = [f"known_response in {' and '.join(channels)}"] if channels else []
    if "mounting" in by_channel:
        statements.append("[mounting]")
    if statements:
        raise InputError(
            f"{what} takes no known response out of the channels.",
            expected="records in the units of the sensor and of the motion",
            found=" and ".join(statements),
            where=where,
            remedy="remove known_response, and give records without the channel's response"
            if channels
            else "remove [mounting]",
        )
