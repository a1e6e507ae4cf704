"""The documents of a certificate, before and after it is issued: PDF/A, DCC and result.json."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from vibrident.base.files import atomic_write
from vibrident.lab.issue.keys import SigningKey
from vibrident.lab.issue.signing import detached_signature, signed_pdf, signed_xml
from vibrident.result import Result
from vibrident.show.issue import Issue
from vibrident.show.report import content as rendered
from vibrident.show.report import name_of_sensor


@dataclass(frozen=True)
class DraftContent:
    """Content of a draft."""

    result: Result
    issue: Issue  # without the template
    template: bytes | None  # the laboratory's own typst file


@dataclass(frozen=True)
class Documents:
    """The files of an issued certificate, as bytes."""

    pdf: bytes
    dcc: bytes
    result: bytes
    result_signature: bytes

    @property
    def certified(self) -> Result:
        """Return the result as it was certified."""
        return Result.from_dict(json.loads(self.result))

    def write(self, folder: Path, stem: str) -> list[Path]:
        """Write each file whole into a folder that is there; return their paths.

        Args:
            folder: where to write.
            stem: of the names, such as ``certificate-2026-0001-4711-2026-03-01``.
        """
        contents = {
            f"{stem}.pdf": self.pdf,
            f"{stem}.dcc.xml": self.dcc,
            f"{stem}.json": self.result,
            f"{stem}.json.p7s": self.result_signature,
        }
        for name, content in contents.items():
            with atomic_write(folder / name) as partial:
                partial.write_bytes(content)
        return [folder / name for name in contents]


def stem(result: Result) -> str:
    """Return how the files of a certificate are named, without their endings.

    The number is in it: an amendment has sensor and date of what it replaces.
    """
    certificate = result.certificate
    named = name_of_sensor(f"certificate-{certificate['number']}.pdf", result.sensor, certificate)
    return named.removesuffix(".pdf")


def draft_pdf(draft: DraftContent) -> bytes:
    """Return a draft as PDF, marked as one on each page."""
    with tempfile.TemporaryDirectory() as folder:
        return rendered(draft.result, "pdf", issue=_issue(draft, Path(folder)))


def unsigned_documents(draft: DraftContent, result: Result) -> tuple[bytes, bytes]:
    """Return PDF and DCC of a certificate, not signed yet.

    Args:
        draft: what was handed in.
        result: the same with number, date of issue and approver.

    Raises:
        InputError: a library is missing, or a document cannot be made of this result.
    """
    from vibrident.export import export

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pdf = rendered(result, "pdf", issue=_issue(draft, folder))
        (dcc,) = export(result, "dcc", folder)
        return pdf, dcc.read_bytes()


def signed_documents(draft: DraftContent, result: Result, key: SigningKey) -> Documents:
    """Return the documents of a certificate, each signed with the laboratory's key.

    Raises:
        InputError: as :func:`unsigned_documents`.
    """
    pdf, dcc = unsigned_documents(draft, result)
    certificate = result.certificate
    reason = f"Calibration certificate {certificate['number']}"
    content = result.to_json().encode()
    return Documents(
        pdf=signed_pdf(pdf, key, reason=reason, location=str(certificate.get("place") or "")),
        dcc=signed_xml(dcc, key),
        result=content,
        result_signature=detached_signature(content, key),
    )


def _issue(draft: DraftContent, folder: Path) -> Issue:
    """Return what belongs to the certificate, its template as a file of this folder."""
    if draft.template is None:
        return draft.issue
    template = folder / "template.typ"
    template.write_bytes(draft.template)
    return replace(draft.issue, template=template)
