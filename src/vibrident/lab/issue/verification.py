"""Verification of a certificate's signature: PDF, DCC, or any file with its ``.p7s``.

A signature is valid if the file has not changed since, if it covers the whole file, and if the
signer's certificate was valid at the time that the signer states. Whose certificate it is, the
certificate says itself; it is trusted where it is one of those given, or issued by one of them.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import datetime
import io
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError
from vibrident.base.escaping import one_line
from vibrident.lab.issue.keys import holder, library
from vibrident.lab.issue.signing import without_loop

SIGNATURE = ".p7s"  # ending of a detached signature, after the name of the signed file
_DS = "{http://www.w3.org/2000/09/xmldsig#}"
_XADES = "{http://uri.etsi.org/01903/v1.3.2#}"
_MAX_BYTES = 200_000_000
_MAX_ERROR_LENGTH = 200  # characters of what a library says
_AS_SIGNED = "the file as it was signed"


@dataclass(frozen=True)
class Signed:
    """A valid signature: by whom, and when."""

    signer: str
    fingerprint: str  # SHA-256 of the signer's certificate, in hexadecimal
    time: datetime.datetime | None  # by the signer's clock; None where not stated
    trusted: bool | None  # None where no certificate to trust was given


@dataclass(frozen=True)
class _Signature:
    """A signature that holds mathematically."""

    certificate: Any
    chain: Sequence[Any]
    time: datetime.datetime | None


def verify(file: Path, trusted: Path | None = None) -> Signed:
    """Verify the signature of a file.

    Args:
        file: PDF, DCC (XML), or a file with a detached signature beside it, ``FILE.p7s``;
            or that signature, for the file.
        trusted: PEM or DER with the certificates to trust; None for a signature of anybody.

    Raises:
        InputError: the file is unsigned, was changed after signing, or is signed by somebody else;
            or it cannot be read.
    """
    anchors = None if trusted is None else _certificates(trusted)
    file = file.with_suffix("") if file.suffix == SIGNATURE else file
    content = _read(file)
    if content.startswith(b"%PDF-"):
        signature = _verified_pdf(content, file)
    elif content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        signature = _verified_xml(content, file)
    else:
        signature = _verified_detached(content, file)
    _require_valid_then(signature, file)
    fingerprint = signature.certificate.fingerprint(
        library("cryptography.hazmat.primitives.hashes").SHA256()
    )
    name = holder(signature.certificate)
    is_trusted = (
        None if anchors is None else _is_trusted(signature.certificate, signature.chain, anchors)
    )
    if is_trusted is False:
        raise _invalid(
            file,
            f"{name}, certificate SHA-256 {fingerprint.hex()}",
            expected=f"a signature by a certificate of {trusted}, or one that it issued",
        )
    return Signed(name, fingerprint.hex(), signature.time, is_trusted)


def _verified_pdf(content: bytes, file: Path) -> _Signature:
    reader = library("pyhanko.pdf_utils.reader").PdfFileReader
    validation = library("pyhanko.sign.validation")
    status = library("pyhanko.sign.validation.status")
    with _refuse_unreadable(file):
        signatures = list(reader(io.BytesIO(content)).embedded_signatures)
    if not signatures:
        raise _unsigned(file)
    with _refuse_unreadable(file), _silence_library():
        checked = [
            without_loop(
                lambda signature=signature: validation.validate_pdf_signature(
                    signature, _no_trust(signature.signer_cert)
                )
            )
            for signature in signatures
        ]
    for signature_status in checked:
        if not (signature_status.intact and signature_status.valid):
            raise _invalid(file, "a file that was changed after signing")
    newest = checked[-1]
    if newest.coverage != status.SignatureCoverageLevel.ENTIRE_FILE or not newest.docmdp_ok:
        raise _invalid(file, "additions after signing")
    chain = [_x509(certificate.dump()) for certificate in signatures[-1].other_embedded_certs]
    return _Signature(_x509(newest.signing_cert.dump()), chain, newest.signer_reported_dt)


def _verified_xml(content: bytes, file: Path) -> _Signature:
    etree = library("lxml.etree")
    signxml = library("signxml")
    xades = library("signxml.xades")
    with _refuse_unreadable(file):
        root = etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True))
    signatures = root.findall(f"{_DS}Signature")
    if not signatures:
        raise _unsigned(file)
    stored = [node.text or "" for node in signatures[0].iter(f"{_DS}X509Certificate")]
    if len(signatures) > 1 or not stored:
        what = f"{len(signatures)} signatures" if stored else "a signature without a certificate"
        raise _invalid(file, what, expected="one signature with the signer's certificate")
    with _refuse_unreadable(file):
        chain = [_x509_base64(text) for text in stored]
    advanced = signatures[0].find(f".//{_XADES}SignedProperties") is not None
    verifier = xades.XAdESVerifier() if advanced else signxml.XMLVerifier()
    config = xades.XAdESSignatureConfiguration if advanced else signxml.SignatureConfiguration
    expected = config(
        location="./",
        expect_references=len(signatures[0].findall(f"{_DS}SignedInfo/{_DS}Reference")),
        verification_time=chain[0].not_valid_before_utc,  # judged below, at the time of signing
        default_reference_c14n_method=signxml.CanonicalizationMethod.CANONICAL_XML_1_0,
    )
    try:
        results = verifier.verify(content, x509_cert=chain[0], expect_config=expected)
    except Exception as error:  # of the digest, the key, the schema, and what the parser refuses
        raise _invalid(
            file, f"a file that was changed after signing ({one_line(error)[:_MAX_ERROR_LENGTH]})"
        ) from error
    results = results if isinstance(results, list) else [results]
    signatures[0].getparent().remove(signatures[0])
    signed_nodes = [result.signed_xml for result in results if result.signed_xml is not None]
    if etree.tostring(root, method="c14n") not in [
        etree.tostring(signed_node, method="c14n") for signed_node in signed_nodes
    ]:
        raise _invalid(file, "a signature that does not cover the whole document")
    times = [
        signed_node.findtext(f".//{_XADES}SigningTime")
        for signed_node in signed_nodes
        if signed_node.tag != root.tag
    ]
    signing_time = next((text for text in times if text), None)
    with _refuse_unreadable(file):
        time = None if signing_time is None else datetime.datetime.fromisoformat(signing_time)
    return _Signature(chain[0], chain[1:], time)


def _verified_detached(content: bytes, file: Path) -> _Signature:
    signature_file = file.with_name(file.name + SIGNATURE)
    if not signature_file.is_file():
        raise _unsigned(file)
    cms = library("asn1crypto.cms")
    validation = library("pyhanko.sign.validation")
    with _refuse_unreadable(signature_file):
        signed = cms.ContentInfo.load(_read(signature_file))["content"]
        embedded = [_x509(certificate.chosen.dump()) for certificate in signed["certificates"]]
        serial = signed["signer_infos"][0]["sid"].chosen["serial_number"].native
        signer = next(
            certificate for certificate in embedded if certificate.serial_number == serial
        )

    def check() -> Any:
        trust = _no_trust(_asn1(signer))
        return asyncio.run(validation.async_validate_detached_cms(content, signed, trust))

    with _refuse_unreadable(signature_file), _silence_library():
        status = without_loop(check)
    if not (status.intact and status.valid):
        raise _invalid(file, "a file that was changed after signing")
    chain = [certificate for certificate in embedded if certificate is not signer]
    return _Signature(signer, chain, status.signer_reported_dt)


def _require_valid_then(signature: _Signature, file: Path) -> None:
    """Refuse a signature by a certificate that was not valid at the stated time."""
    begin = signature.certificate.not_valid_before_utc
    end = signature.certificate.not_valid_after_utc
    when = signature.time
    if when is not None and not begin <= when.astimezone(datetime.UTC) <= end:
        raise _invalid(
            file,
            f"{when:%Y-%m-%d}",
            expected=(
                f"a signature made while its certificate was valid, {begin:%Y-%m-%d} to "
                f"{end:%Y-%m-%d}"
            ),
        )


def _is_trusted(certificate: Any, chain: Sequence[Any], anchors: Sequence[Any]) -> bool:
    """Return whether a certificate is an anchor's own, or was issued under one of them."""
    issuers = [*chain, *anchors]
    visited: list[Any] = []
    while certificate not in anchors:
        visited.append(certificate)
        issuer = next(
            (
                candidate
                for candidate in issuers
                if candidate not in visited and _issued(candidate, certificate)
            ),
            None,
        )
        if issuer is None:
            return False
        certificate = issuer
    return True


def _issued(issuer: Any, certificate: Any) -> bool:
    constraints = library("cryptography.x509").BasicConstraints
    exceptions = (ValueError, TypeError, library("cryptography.exceptions").InvalidSignature)
    try:
        certificate.verify_directly_issued_by(issuer)
        return bool(issuer.extensions.get_extension_for_class(constraints).value.ca)
    except (*exceptions, library("cryptography.x509").ExtensionNotFound):
        return False


def _certificates(file: Path) -> list[Any]:
    """Return the certificates of a PEM or DER file."""
    x509 = library("cryptography.x509")
    content = _read(file)
    try:
        pem = b"-----BEGIN" in content
        return (
            x509.load_pem_x509_certificates(content)
            if pem
            else [x509.load_der_x509_certificate(content)]
        )
    except ValueError as error:
        raise InputError(
            "The certificates to trust cannot be read.",
            expected="X.509 certificates, PEM or DER",
            found=one_line(error)[:_MAX_ERROR_LENGTH],
            where=str(file),
            remedy="correct ⟦verify.trusted⟧",
        ) from error


def _x509(der: bytes) -> Any:
    return library("cryptography.x509").load_der_x509_certificate(der)


def _x509_base64(text: str) -> Any:
    return _x509(base64.b64decode(text))


def _asn1(certificate: Any) -> Any:
    der = library("cryptography.hazmat.primitives.serialization").Encoding.DER
    return library("asn1crypto.x509").Certificate.load(certificate.public_bytes(der))


def _no_trust(certificate: Any) -> Any:
    """Return a context that looks nothing up; trust is decided here, for all forms alike."""
    context = library("pyhanko_certvalidator").ValidationContext
    return context(trust_roots=[certificate], allow_fetching=False)


@contextlib.contextmanager
def _silence_library() -> Iterator[None]:
    """Keep what the library says of trust out of the terminal."""
    loggers = [logging.getLogger(name) for name in ("pyhanko", "pyhanko_certvalidator")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


@contextlib.contextmanager
def _refuse_unreadable(file: Path) -> Iterator[None]:
    """Refuse what a library stumbles over: files of others fail in ways that none of them lists."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            "The signed file cannot be read.",
            expected="a PDF, a DCC, or a file with its signature FILE.p7s beside it, undamaged",
            found=f"{type(error).__name__}: {one_line(error)[:_MAX_ERROR_LENGTH]}",
            where=str(file),
            remedy="ask the laboratory for the file again",
        ) from error


def _read(file: Path) -> bytes:
    with _refuse_unreadable(file):
        if file.stat().st_size > _MAX_BYTES:
            raise ValueError(f"more than {_MAX_BYTES} bytes")
        return file.read_bytes()


def _unsigned(file: Path) -> InputError:
    return InputError(
        "The file is not signed.",
        expected="a PDF or DCC with a signature, or a signature beside it",
        found=f"no signature, and no {file.name}{SIGNATURE}",
        where=str(file),
        remedy="ask the laboratory for the signed certificate",
    )


def _invalid(file: Path, problem: str, expected: str = _AS_SIGNED) -> InputError:
    return InputError(
        "The signature is not valid.",
        expected=expected,
        found=problem,
        where=str(file),
        remedy="ask the laboratory for the certificate, and do not use this file",
    )
