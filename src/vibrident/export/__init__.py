"""A result in other programs' formats, from the result alone, by one function.

    files = export(result, "stationxml", "out")

``vibrident.export.registry.EXPORTS`` lists the formats; docs/exports.md states what each holds.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vibrident.result.loading import GivenResult
    from vibrident.show.issue import GivenCertificate

__all__ = ["export"]


def export(
    result: GivenResult,
    form: str,
    folder: str | os.PathLike[str],
    *,
    rate_hz: float | None = None,
    band_hz: tuple[float, float] | None = None,
    without: Sequence[str] = (),
    name: str = "sensor",
    certificate: GivenCertificate = (),
    schema: str | os.PathLike[str] | None = None,
    country: str | None = None,
    channel: str | None = None,
    online: bool = False,
) -> list[Path]:
    """Write a result in another program's format.

    Args:
        result: from :func:`vibrident.identify`, or the path of a ``result.json``.
        form: name of the format, one of ``EXPORTS``.
        folder: of the files; created if missing.
        rate_hz: sampling rate of discrete forms; None takes that of the result's network, if it has
            one.
        band_hz: band over which errors are stated and the correction filter holds; None takes that
            of the data.
        without: add-ons to leave out, ``delay`` or ``boxcar``; the file states the error.
        name: of the files, and in them.
        certificate: statements of a certificate, given after the fit, as for
            :func:`vibrident.report`.
        schema: XSD to validate a certificate against.
        country: ISO 3166-1 code of the laboratory's country, for a certificate.
        channel: NET.STA.LOC.CHA, for seismological forms.
        online: of C: the tracker (learner, detector, corrector) in place of the fixed filters.

    Returns:
        The files written.

    Raises:
        InputError: the format is unknown, cannot hold this sensor, or lacks a library or an option.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration)
        >>> header, source = vibrident.export(result, "c", "firmware", rate_hz=12800.0)
        >>> header.name, source.name
        ('sensor.h', 'sensor.c')
    """
    from vibrident.export.form import Options
    from vibrident.export.registry import EXPORTS
    from vibrident.export.sensor import check_band, read_sensor
    from vibrident.show.issue import issued

    certified, _ = issued(result, certificate)
    format_ = EXPORTS[form]
    band = None if band_hz is None else check_band(*band_hz)
    xsd = None if schema is None else Path(schema)
    options = Options(rate_hz, band, tuple(without), name, xsd, country, channel, online)
    sensor = read_sensor(certified, band).without(options.without)
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    return format_.write(sensor, target, options)
