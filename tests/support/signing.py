"""A laboratory's key for tests: self-signed, made with ``cryptography``."""

from __future__ import annotations

import datetime
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import pkcs12
from cryptography.x509.oid import NameOID

PHRASE = "a pass phrase"


def key_file(
    folder: Path, name: str = "Laboratory L", *, kind: str = "ec", days: int = 3650, authority: str = ""
) -> Path:
    """Write ``key.p12`` and, with the certificate alone, ``key.pem``; valid from yesterday on.

    ``authority``: who issued the certificate, in ``authority.pem``; itself where that is empty.
    """
    private = ec.generate_private_key(ec.SECP256R1()) if kind == "ec" else rsa.generate_private_key(65537, 2048)
    subject = _name(name)
    if authority:
        root = ec.generate_private_key(ec.SECP256R1())
        issued_by = _certificate(root, root, _name(authority), _name(authority), days, ca=True)
        (folder / "authority.pem").write_bytes(issued_by.public_bytes(serialization.Encoding.PEM))
        certificate = _certificate(private, root, subject, _name(authority), days)
        chain = [issued_by]
    else:
        certificate = _certificate(private, private, subject, subject, days)
        chain = None
    locked = serialization.BestAvailableEncryption(PHRASE.encode())
    path = folder / "key.p12"
    path.write_bytes(pkcs12.serialize_key_and_certificates(b"laboratory", private, certificate, chain, locked))
    path.with_suffix(".pem").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    return path


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _certificate(subject_key, signer, subject, issuer, days: int, *, ca: bool = False) -> x509.Certificate:
    begin = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=1)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(subject_key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(begin + datetime.timedelta(days=days))
        .add_extension(x509.BasicConstraints(ca=ca, path_length=None), critical=True)
        .sign(signer, hashes.SHA256())
    )
