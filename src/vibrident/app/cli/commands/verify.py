"""``vibrident verify``: whether a certificate is as its laboratory signed it."""

from __future__ import annotations

from pathlib import Path

from vibrident.app.cli.console import note, print_line
from vibrident.app.cli.options import argument, option


def verify(
    file: Path = argument("FILE", "PDF, DCC, or a file with its signature FILE.p7s beside it."),
    trusted: Path | None = option(
        "--trust", "CERT.pem", "The laboratory's certificate, or its issuer's.", default=False
    ),
) -> None:
    """Say who signed a certificate and when; exit 2 if it was changed since, or is unsigned."""
    from vibrident.lab.signatures import verify as verified

    signed = verified(file, trusted=trusted)
    when = (
        "at a time that is not stated"
        if signed.time is None
        else f"at {signed.time:%Y-%m-%d %H:%M:%S %Z}"
    )
    print_line(f"{file.name} is valid: signed by {signed.signer} {when}, by the signer's clock.")
    print_line(f"Certificate of the signer, SHA-256: {signed.fingerprint}")
    if signed.trusted is None:
        note(
            "Whether that is the laboratory's was not asked: compare the SHA-256 with the one that "
            "it publishes, or give its certificate with --trust."
        )
