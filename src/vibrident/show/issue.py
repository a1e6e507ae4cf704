"""Complete a certificate to be issued: statements after the fit, missing entries, the form."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError
from vibrident.data.io.certificate import CertificateData, certificate_data, certificate_section
from vibrident.result import Result
from vibrident.result.loading import GivenResult, as_result
from vibrident.show.language import Translator

#: Keys that ISO/IEC 17025:2017, 7.8.2.1 and 7.8.4.1, asks of every certificate.
REQUIRED = (
    *(
        "number",
        "laboratory",
        "laboratory_address",
        "place",
        "customer",
        "customer_address",
        "date_of_calibration",
    ),
    *("date_of_issue", "procedure", "traceability", "temperature_c", "approved_by"),
)
#: Heading of the form → keys of [certificate]; all that have a place of their own.
GROUPS: Mapping[str, tuple[str, ...]] = {
    "document": ("number", "date_of_issue", "language", "second_language", "replaces", "changes"),
    "laboratory": (
        "laboratory",
        "laboratory_address",
        "accreditation",
        "country",
        "operator",
        "approved_by",
    ),
    "order": (
        "customer",
        "customer_address",
        "order_number",
        "date_of_receipt",
        "date_of_calibration",
        "place",
    ),
    "conditions": (
        *("condition", "mounting", "direction", "amplitude", "conditioning"),
        *("temperature_c", "temperature_uncertainty_c"),
        *("relative_humidity_percent", "relative_humidity_uncertainty_percent"),
        *("air_pressure_hpa", "air_pressure_uncertainty_hpa"),
    ),
    "method": (
        *("procedure", "deviations", "traceability", "instruments", "external_results"),
        *("reference_frequency_hz", "quantities"),
    ),
    "conformity": ("requirements", "decision_rule"),
    "further": ("opinions", "remarks", "budget", "data_files"),
}


@dataclass(frozen=True)
class FormField:
    """An entry of the form."""

    key: str  # of [certificate]
    label: str  # in words
    group: str  # heading above it, in words
    required: bool  # whether a certificate without it is a draft


def form(language: str = "en") -> tuple[FormField, ...]:
    """Return the entries of a certificate in the order of the form."""
    translate = Translator(language)
    grouped_keys = [(key, group) for group, keys in GROUPS.items() for key in keys]
    return tuple(
        FormField(key, translate("label", key), translate("group", group), key in REQUIRED)
        for key, group in grouped_keys
    )


def missing(result: Result) -> tuple[str, ...]:
    """Return the keys that a certificate must state and this result does not.

    Those of [sensor] are among them; none: it can be issued. A tracking report is no certificate.
    """
    return () if result.is_tracked else lacking(result.certificate, result.sensor)


def lacking(certificate: Mapping[str, Any], sensor: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the entries that [certificate] and [sensor] must state and do not."""
    required = [*REQUIRED, *(["changes"] if certificate.get("replaces") else [])]
    missing = [key for key in required if certificate.get(key) in (None, "", [])]
    return (*missing, *(["serial_number"] if not sensor.get("serial_number") else []))


def check_numbers(results: Sequence[Result], names: Sequence[str]) -> None:
    """Refuse one certificate number for several results, each of which is to have a certificate.

    Args:
        results: with what their certificates state.
        names: what to call each.

    Raises:
        InputError: two results of one laboratory have the same number.
    """
    first: dict[tuple[str, str], str] = {}
    for result, name in zip(results, names, strict=True):
        entries = result.certificate
        number = str(entries.get("number") or "")
        first_name = first.setdefault((str(entries.get("laboratory") or ""), number), name)
        if number and first_name != name:
            raise InputError(
                "Two certificates would have the same number.",
                expected="a number of its own for each certificate",
                found=f"{number} for {first_name} and for {name}",
                where="[certificate] number",
                remedy="write the certificates one after another, each with its own number",
            )


@dataclass(frozen=True)
class Issue:
    """Parts of a certificate that do not belong to a result."""

    before: Result | None = None  # the result before an adjustment
    logo: bytes | None = None  # of the laboratory, as SVG, PNG or JPEG
    template: Path | None = None  # the laboratory's own typst file in place of ours
    fonts: tuple[Path, ...] = ()  # folders with further fonts


NOTHING_MORE = Issue()


#: What a certificate states besides the result: a certificate file (TOML) or several, of which a
#: later one replaces what an earlier one states; or the entries of [certificate] themselves, by
#: key; or a form that was filled in.
GivenCertificate = (
    str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, Any] | CertificateData
)


def issued(source: GivenResult, certificate: GivenCertificate) -> tuple[Result, Issue]:
    """Return a result with what its certificate states, and what belongs to the certificate alone.

    Args:
        source: a result, or the path of its file.
        certificate: the statements; an empty sequence adds nothing.

    Raises:
        InputError: a file, or one that it names, cannot be read or holds what is not allowed.
    """
    result = as_result(source)
    data = _statements(certificate)
    logo = None if data.logo is None else data.logo.read_bytes()
    before = None if data.before is None else Result.load(data.before)
    return with_statements(result, data), Issue(
        before, logo, data.template, () if data.fonts is None else (data.fonts,)
    )


def check_certificate(result: GivenResult, certificate: GivenCertificate = ()) -> tuple[str, ...]:
    """Return the entries of ISO/IEC 17025 that a certificate lacks; none: it can be issued.

    Args:
        result: of an identification, or the path of its ``result.json``.
        certificate: what the certificate states, given after the fit, as for
            :func:`vibrident.report`.

    Returns:
        Keys of [certificate], and of [sensor].

    Raises:
        InputError: a file cannot be read or holds what is not allowed.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration)
        >>> entries = {"number": "2026-0042", "laboratory": "Laboratory of an example"}
        >>> vibrident.check_certificate(result, entries)[:2]
        ('laboratory_address', 'place')
    """
    certified, _ = issued(result, certificate)
    return missing(certified)


def _statements(certificate: GivenCertificate) -> CertificateData:
    if isinstance(certificate, CertificateData):
        return certificate
    if isinstance(certificate, Mapping):
        return CertificateData(certificate_section(certificate, "certificate"))
    return certificate_data(
        [certificate] if isinstance(certificate, str | os.PathLike) else certificate
    )


def with_statements(result: Result, data: CertificateData) -> Result:
    """Return the result with further statements for certificate and sensor; None removes one."""
    return replace(
        result,
        certificate=_override(result.certificate, data.certificate),
        sensor=_override(result.sensor, data.sensor),
    )


def _override(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in {**first, **second}.items() if value is not None}
