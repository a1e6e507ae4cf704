"""A laboratory's profile: what is the same on each of its calibrations, as a file of their keys.

[[uncertainty]] and [[cmc]] are those of a calibration file, [certificate] that of a certificate.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vibrident.data.io.certificate import CertificateSection
from vibrident.data.io.keys import key
from vibrident.data.io.schema_errors import validated
from vibrident.data.io.sections import (
    CapabilityEntry,
    FileSection,
    UncertaintyEntry,
    check_uncertainties,
)
from vibrident.data.io.toml_text import read_toml, toml_document

#: Keys of [certificate] that are the same on each certificate of a laboratory.
LABORATORY_KEYS = (
    *("laboratory", "laboratory_address", "accreditation", "country", "operator", "approved_by"),
    *("place", "procedure", "traceability", "instruments", "language", "second_language"),
    "decision_rule",
)


class LaboratoryFile(FileSection):
    """The file of a laboratory's profile."""

    certificate: CertificateSection = CertificateSection()
    uncertainty: list[UncertaintyEntry] = key("Sources of uncertainty", default=[])
    cmc: list[CapabilityEntry] = key("Capability (CMC)", default=[])


def read_laboratory(path: Path) -> dict[str, Any]:
    """Return the document of a profile, plain values by section.

    InputError where it is not TOML, or a key or value is not allowed.
    """
    return checked_laboratory(read_toml(path, "laboratory"), path.name)


def checked_laboratory(document: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the document of a profile, checked; ``where`` names it. Errors as read_laboratory."""
    profile = validated(LaboratoryFile, document, where, "laboratory")
    check_uncertainties(profile.uncertainty, where)
    entries = {"uncertainty": profile.uncertainty, "cmc": profile.cmc}
    plain = {
        name: [entry.model_dump(exclude_none=True, exclude_unset=True) for entry in listed]
        for name, listed in entries.items()
    }
    return {"certificate": dict(profile.certificate.stated()), **plain}


def laboratory_text(document: Mapping[str, Any]) -> str:
    """Return the text of the file of a profile."""
    return toml_document({section: entries for section, entries in document.items() if entries})
