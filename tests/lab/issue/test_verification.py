"""A signed file is valid as it was signed, and not after any change, by nobody else, with no part left out."""

from __future__ import annotations

import base64
import datetime
import io

import numpy as np
import pypdf
import pytest
import time_machine
from cryptography.hazmat.primitives.serialization import Encoding
from lxml import etree
from tests.support import shell
from tests.support.lives import certifiable
from tests.support.signing import PHRASE, key_file

from vibrident.base.errors import InputError
from vibrident.lab.issue.documents import DraftContent, signed_documents
from vibrident.lab.issue.keys import load_key
from vibrident.lab.issue.verification import verify
from vibrident.show.issue import NOTHING_MORE

STATED = {"number": "2026-0001", "date_of_issue": "2020-01-02", "approved_by": "B. Head"}
FORMS = ("pdf", "dcc.xml", "json")


@pytest.fixture(scope="module", params=["ec", "rsa"])
def signed(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("signed")
    key = load_key(key_file(folder, kind=request.param), PHRASE)
    result = certifiable(**STATED)
    draft = DraftContent(result, NOTHING_MORE, None)
    signed_documents(draft, result, key).write(folder, "c")
    return folder


def copied(signed, folder, form: str):
    for name in (f"c.{form}", f"c.{form}.p7s"):
        if (signed / name).exists():
            (folder / name).write_bytes((signed / name).read_bytes())
    return folder / f"c.{form}"


@pytest.mark.parametrize("form", FORMS)
def test_a_signed_file_says_by_whom_and_when(signed, form):
    found = verify(signed / f"c.{form}")
    now = datetime.datetime.now(datetime.UTC)
    assert found.signer == "Laboratory L"
    assert abs((now - found.time).total_seconds()) < 600
    assert found.trusted is None
    assert verify(signed / f"c.{form}", signed / "key.pem").trusted
    assert verify(signed / "c.json.p7s").signer == found.signer


@pytest.mark.parametrize("form", FORMS)
def test_any_changed_byte_is_found(signed, form, tmp_path):
    file = copied(signed, tmp_path, form)
    content = file.read_bytes()
    rng = np.random.default_rng(1)
    own = content.find(b"<ds:Signature") if form == "dcc.xml" else len(content)
    for place in rng.integers(0, own, 12):
        changed = bytearray(content)
        changed[place] ^= 1
        file.write_bytes(changed)
        try:
            verify(file)
        except InputError:
            continue
        # only what canonical XML does not keep, such as blanks in a tag, may differ
        assert form == "dcc.xml"
        assert canonical(bytes(changed)) == canonical(content)


def canonical(text: bytes) -> bytes:
    return etree.tostring(etree.fromstring(text), method="c14n")


def test_a_number_that_was_changed_is_found(signed, tmp_path):
    file = copied(signed, tmp_path, "dcc.xml")
    text = file.read_text()
    for old, new in (("2026-0001", "2026-0002"), ("<ds:SignatureValue>", "<ds:SignatureValue>AA")):
        assert old in text
        file.write_text(text.replace(old, new, 1))
        with pytest.raises(InputError, match="not valid"):
            verify(file)


def test_a_signature_around_another_document_is_found(signed, tmp_path):
    """Wrapping: the signed document lies whole within another one."""
    file = copied(signed, tmp_path, "dcc.xml")
    root = etree.fromstring(file.read_bytes())
    signature = root[-1]
    outer = etree.Element(root.tag, nsmap=root.nsmap)
    outer.append(root)
    outer.append(signature)
    file.write_bytes(etree.tostring(outer))
    with pytest.raises(InputError, match="not valid"):
        verify(file)


def test_additions_to_a_signed_pdf_are_found(signed, tmp_path):
    file = copied(signed, tmp_path, "pdf")
    writer = pypdf.PdfWriter(io.BytesIO(file.read_bytes()), incremental=True)
    writer.add_blank_page()
    made = io.BytesIO()
    writer.write(made)
    file.write_bytes(made.getvalue())
    with pytest.raises(InputError, match=r"not valid|cannot be read"):
        verify(file)


def test_what_is_unsigned_or_damaged_is_said(signed, tmp_path):
    plain = {"a.json": b"{}", "a.xml": b"<a/>", "a.pdf": unsigned_pdf()}
    for name, content in plain.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match="not signed"):
            verify(tmp_path / name)
    damaged = {"b.pdf": b"%PDF-1.7\nnothing", "b.xml": b"<a", "b.json": b"{}"}
    (tmp_path / "b.json.p7s").write_bytes(b"no CMS")
    for name, content in damaged.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match="cannot be read"):
            verify(tmp_path / name)
    with pytest.raises(InputError, match="cannot be read"):
        verify(tmp_path / "none.pdf")
    (tmp_path / "bad.pem").write_text("-----BEGIN CERTIFICATE-----\nx\n")
    with pytest.raises(InputError, match="to trust"):
        verify(signed / "c.pdf", tmp_path / "bad.pem")


def unsigned_pdf() -> bytes:
    writer = pypdf.PdfWriter()
    writer.add_blank_page(100, 100)
    made = io.BytesIO()
    writer.write(made)
    return made.getvalue()


@pytest.mark.parametrize("form", FORMS)
def test_the_key_of_somebody_else_is_not_trusted(signed, form, tmp_path):
    other = key_file(tmp_path, "Laboratory L").with_suffix(".pem")
    with pytest.raises(InputError, match="not valid"):
        verify(signed / f"c.{form}", other)


def test_a_certificate_that_a_trusted_authority_issued_is_trusted(tmp_path):
    key = load_key(key_file(tmp_path, authority="Authority"), PHRASE)
    result = certifiable(**STATED)
    signed_documents(DraftContent(result, NOTHING_MORE, None), result, key).write(tmp_path, "c")
    (tmp_path / "other").mkdir()
    key_file(tmp_path / "other", authority="Authority")
    for form in FORMS:
        assert verify(tmp_path / f"c.{form}", tmp_path / "authority.pem").trusted
        with pytest.raises(InputError, match="not valid"):
            verify(tmp_path / f"c.{form}", tmp_path / "other" / "authority.pem")


def test_a_signature_after_the_certificate_ended_is_found(tmp_path):
    key = load_key(key_file(tmp_path, days=0), PHRASE)
    assert key.certificate.not_valid_after_utc < datetime.datetime.now(datetime.UTC)
    result = certifiable(**STATED)
    signed_documents(DraftContent(result, NOTHING_MORE, None), result, key).write(tmp_path, "c")
    for form in FORMS:
        with pytest.raises(InputError, match="while its certificate was valid"):
            verify(tmp_path / f"c.{form}")


def test_a_signature_made_while_its_certificate_was_valid_stays_valid(tmp_path):
    with time_machine.travel(datetime.datetime(2020, 1, 2, tzinfo=datetime.UTC)):
        key = load_key(key_file(tmp_path, days=30), PHRASE)
        result = certifiable(**STATED)
        signed_documents(DraftContent(result, NOTHING_MORE, None), result, key).write(tmp_path, "c")
    for form in FORMS:
        assert verify(tmp_path / f"c.{form}", tmp_path / "key.pem").time.year == 2020


def test_the_signed_pdf_stays_pdf_a(signed):
    read = pypdf.PdfReader(signed / "c.pdf")
    assert b"pdfaid:part" in read.xmp_metadata.stream.get_data()
    (field,) = read.get_fields().values()
    assert field["/V"]["/SubFilter"] == "/ETSI.CAdES.detached"


def test_the_certificate_of_the_dcc_is_the_keys(signed):
    root = etree.parse(str(signed / "c.dcc.xml")).getroot()
    assert etree.QName(root[-1]).localname == "Signature"
    (text,) = [node.text for node in root.iter("{http://www.w3.org/2000/09/xmldsig#}X509Certificate")]
    key = load_key(signed / "key.p12", PHRASE)
    assert base64.b64decode(text) == key.certificate.public_bytes(Encoding.DER)


def test_the_command(signed, tmp_path):
    done = shell.run("verify", signed / "c.pdf", "--trust", signed / "key.pem")
    assert done.exit_code == 0
    assert "signed by Laboratory L at 20" in done.output
    file = copied(signed, tmp_path, "json")
    file.write_bytes(file.read_bytes().replace(b"L", b"M", 1))
    done = shell.run("verify", file)
    assert done.exit_code == 2
    assert "changed after signing" in " ".join(done.output.split())
