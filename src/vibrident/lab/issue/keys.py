"""The laboratory's key: a PKCS#12 file and its pass phrase, which no command line holds."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vibrident.base import extras
from vibrident.base.errors import InputError
from vibrident.base.escaping import one_line

#: Variable of the environment with the pass phrase.
PASSPHRASE = "VIBRIDENT_KEY_PASSPHRASE"
_CURVES = ("secp256r1", "secp384r1", "secp521r1")
_MIN_RSA_BITS = 2048
_MAX_BYTES = 1_000_000


@dataclass(frozen=True)
class SigningKey:
    """A private key with its certificate; its text shows neither key nor pass phrase."""

    name: str  # of whom the certificate is
    private: Any = field(repr=False)
    certificate: Any = field(repr=False)
    chain: tuple[Any, ...] = field(repr=False)  # certificates of the issuers

    @property
    def is_elliptic(self) -> bool:
        """Return whether it is a key of an elliptic curve; else one of RSA."""
        return hasattr(self.private, "curve")


def library(name: str) -> Any:
    """Import a library of the extra ``sign``.

    Raises:
        InputError: it is not installed.
    """
    problem = "Signing and verifying need a library that is not installed."
    return extras.library(name, "sign", problem, "⟦command = issue⟧, ⟦command = verify⟧")


def passphrase(file: Path | None) -> str:
    """Return the pass phrase: the first line of a file, else that of the environment.

    Raises:
        InputError: there is none, or the file cannot be read.
    """
    if file is not None:
        try:
            return file.read_text(encoding="utf-8").partition("\n")[0].rstrip("\r")
        except (OSError, UnicodeDecodeError) as error:
            raise _unusable("The pass phrase cannot be read.", file, error) from error
    if (text := os.environ.get(PASSPHRASE)) is not None:
        return text
    raise InputError(
        "The pass phrase of the laboratory's key is not given.",
        expected=f"{PASSPHRASE} in the environment, or a file",
        found="neither",
        where="⟦issue.passphrase_file⟧",
        remedy=f"set {PASSPHRASE}, or name a file that its owner alone may read",
    )


def load_key(file: Path, phrase: str) -> SigningKey:
    """Read the laboratory's key.

    Args:
        file: PKCS#12 (``.p12``, ``.pfx``) with private key and certificate.
        phrase: its pass phrase.

    Raises:
        InputError: the file cannot be read, the pass phrase is wrong, or the key is too weak.
    """
    pkcs12 = library("cryptography.hazmat.primitives.serialization.pkcs12")
    try:
        if file.stat().st_size > _MAX_BYTES:
            raise ValueError("a file that is too large")
        content = file.read_bytes()
        private, certificate, chain = pkcs12.load_key_and_certificates(content, phrase.encode())
    except (OSError, ValueError) as error:
        raise _unusable("The laboratory's key cannot be read.", file, error) from error
    if private is None or certificate is None:
        raise _unusable("The laboratory's key cannot be read.", file, "no key with a certificate")
    curve = getattr(getattr(private, "curve", None), "name", None)
    strong = getattr(private, "key_size", 0) >= _MIN_RSA_BITS if curve is None else curve in _CURVES
    if not strong or not hasattr(private, "sign"):
        raise _unusable("The laboratory's key is of a kind that is not used.", file, curve or "RSA")
    return SigningKey(holder(certificate), private, certificate, tuple(chain))


def holder(certificate: Any) -> str:
    """Return whom an X.509 certificate names: common name and organisation."""
    oid = library("cryptography.x509.oid").NameOID
    kinds = (oid.COMMON_NAME, oid.ORGANIZATION_NAME)
    names = [
        attribute.value
        for kind in kinds
        for attribute in certificate.subject.get_attributes_for_oid(kind)
    ]
    return ", ".join(dict.fromkeys(map(str, names))) or certificate.subject.rfc4514_string()


def _unusable(problem: str, file: Path, value: object) -> InputError:
    return InputError(
        problem,
        expected=(
            f"PKCS#12 with an RSA key of {_MIN_RSA_BITS} bits or more, or one of {_CURVES[0]}, its "
            "certificate, and the right pass phrase"
        ),
        found=one_line(value)[:200],
        where=str(file),
        remedy="correct ⟦issue.key⟧ or the pass phrase",
    )
