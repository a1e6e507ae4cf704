"""Signatures of the laboratory: PAdES in a PDF, XAdES in a DCC, detached CMS of any other file.

References: ETSI EN 319 142-1 (PAdES), ETSI EN 319 132-1 (XAdES), RFC 5652 (CMS).
"""

from __future__ import annotations

import asyncio
import datetime
import io
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from vibrident.lab.issue.keys import SigningKey, library

FIELD = "LaboratorySignature"
_T = TypeVar("_T")


def signed_pdf(pdf: bytes, key: SigningKey, *, reason: str, location: str) -> bytes:
    """Return a PDF with a certifying signature (PAdES-B-B), which allows no change after it.

    The signature is an increment without an appearance: a PDF/A stays one, and its pages stay.
    """
    signers = library("pyhanko.sign.signers")
    fields = library("pyhanko.sign.fields")
    writer = library("pyhanko.pdf_utils.incremental_writer").IncrementalPdfFileWriter
    about = signers.PdfSignatureMetadata(
        field_name=FIELD,
        md_algorithm="sha256",
        subfilter=fields.SigSeedSubFilter.PADES,
        certify=True,
        docmdp_permissions=fields.MDPPerm.NO_CHANGES,
        reason=reason,
        location=location,
        name=key.name,
    )

    def sign() -> bytes:
        out = signers.sign_pdf(writer(io.BytesIO(pdf)), about, signer=_signer(key))
        return out.getvalue()

    return without_loop(sign)


def signed_xml(text: bytes, key: SigningKey) -> bytes:
    """Return an XML document with an enveloped signature (XAdES-B-B) as its last element."""
    etree = library("lxml.etree")
    method = "ecdsa-sha256" if key.is_elliptic else "rsa-sha256"
    # canonical XML 1.0 is what a reference without transforms is read with by every verifier
    signer = library("signxml.xades").XAdESSigner(
        signature_algorithm=method,
        digest_algorithm="sha256",
        c14n_algorithm=library("signxml").CanonicalizationMethod.CANONICAL_XML_1_0,
    )
    root = etree.fromstring(text, etree.XMLParser(resolve_entities=False, no_network=True))
    signed = signer.sign(root, key=key.private, cert=[key.certificate, *key.chain])
    return etree.tostring(signed, xml_declaration=True, encoding="UTF-8")


def detached_signature(content: bytes, key: SigningKey) -> bytes:
    """Return the detached CMS signature of a file's bytes, DER (``.p7s``), with its time."""
    attributes = library("pyhanko.sign.signers.pdf_cms").PdfCMSSignedAttributes
    signed_attributes = attributes(signing_time=datetime.datetime.now(datetime.UTC))

    def sign() -> bytes:
        signature = _signer(key).async_sign_general_data(
            content, "sha256", signed_attr_settings=signed_attributes
        )
        return asyncio.run(signature).dump()

    return without_loop(sign)


def without_loop(call: Callable[[], _T]) -> _T:
    """Call in a thread of its own: pyHanko runs a loop, which a notebook's thread has already."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(call).result()


def _signer(key: SigningKey) -> Any:
    encoding = library("cryptography.hazmat.primitives.serialization")
    asn1 = library("pyhanko.keys.pemder")
    der = encoding.Encoding.DER
    form = encoding.PrivateFormat.PKCS8, encoding.NoEncryption()
    stored = (
        stored_certificate.public_bytes(der) for stored_certificate in (key.certificate, *key.chain)
    )
    certificate, *chain = (
        next(iter(asn1.load_certs_from_pemder_data(encoded))) for encoded in stored
    )
    private = asn1.load_private_key_from_pemder_data(key.private.private_bytes(der, *form), None)
    registry = library("pyhanko_certvalidator.registry").SimpleCertificateStore()
    registry.register_multiple(chain)
    signer = library("pyhanko.sign.signers").SimpleSigner
    return signer(signing_cert=certificate, signing_key=private, cert_registry=registry)
