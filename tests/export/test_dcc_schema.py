"""The user's schema: where its imports are found, what it refuses, and PTB's own where VIBRIDENT_DCC_XSD names it.

PTB's schemas are not part of vibrident. For the last test get https://ptb.de/dcc/v3.2.1/dcc.xsd with
https://ptb.de/si/v2.1.0/SI_Format.xsd beside it (or a later version of both) and set VIBRIDENT_DCC_XSD to dcc.xsd.
"""

from __future__ import annotations

import os
import socket
from dataclasses import replace
from pathlib import Path

import pytest
from lxml import etree
from tests.support.certified import CERTIFICATE, certified, written
from tests.support.exported import CASES, case, paper
from tests.support.shell import run
from tests.support.signing import PHRASE, key_file

from vibrident.base.errors import InputError
from vibrident.export.formats.dcc import VERSION, validate
from vibrident.lab.issue.keys import load_key
from vibrident.lab.issue.signing import signed_xml
from vibrident.result import ResultWarning

pytestmark = [
    pytest.mark.filterwarnings("ignore:The dsi string contains the token"),
    pytest.mark.filterwarnings("ignore:SelectableGroups:DeprecationWarning"),
]
#: The imports of PTB's two schemas: by address in the web, as in DCC 3.2.1, or by folder, as in 3.3.0.
WEB = ("https://ptb.de/si/v2.1.0/SI_Format.xsd", "https://www.ptb.de/dcc/d-sig/xmldsig-core-schema.xsd")
FOLDERS = ("si/SI_Format.xsd", "d-sig/xmldsig-core-schema.xsd")
QUDT = "https://www.ptb.de/si/v2.2.0/qudt/quantitykind.xsd"
DCC_XSD = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:si="https://ptb.de/si"
  xmlns:ds="http://www.w3.org/2000/09/xmldsig#" targetNamespace="https://ptb.de/dcc" elementFormDefault="qualified">
  <xs:import namespace="https://ptb.de/si" schemaLocation="{si}"/>
  <xs:import namespace="http://www.w3.org/2000/09/xmldsig#" schemaLocation="{signature}"/>
  <xs:element name="digitalCalibrationCertificate"><xs:complexType><xs:sequence>
  <xs:element name="administrativeData" type="xs:anyType"/><xs:element name="{second}" type="xs:anyType"/>
  <xs:element ref="ds:Signature" minOccurs="0" maxOccurs="unbounded"/>
  </xs:sequence><xs:attribute name="schemaVersion" type="xs:string" use="required"/></xs:complexType></xs:element>
  <xs:element name="use"><xs:complexType><xs:sequence><xs:element ref="si:real"/></xs:sequence>
  </xs:complexType></xs:element>
</xs:schema>"""
SI_XSD = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:q="http://qudt.org/vocab/"
  targetNamespace="https://ptb.de/si" elementFormDefault="qualified">{qudt}
  <xs:element name="real"><xs:complexType><xs:sequence><xs:element name="label"
  type="xs:string" minOccurs="0"/><xs:element name="value" type="xs:double"/><xs:any
  processContents="skip" minOccurs="0" maxOccurs="unbounded"/></xs:sequence></xs:complexType></xs:element>
</xs:schema>"""
IMPORT = """<xs:import namespace="http://qudt.org/vocab/" schemaLocation="{}"/><xs:element name="q" type="q:kind"/>"""
QUDT_XSD = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="http://qudt.org/vocab/">
  <xs:simpleType name="kind"><xs:restriction base="xs:string"/></xs:simpleType></xs:schema>"""
#: As W3C's, with a document type in the web.
SIGNATURE_XSD = """<!DOCTYPE schema PUBLIC "-//W3C//DTD XMLSchema 200102//EN" "http://www.w3.org/2001/XMLSchema.dtd" [
  <!ATTLIST schema xmlns:ds CDATA #FIXED "http://www.w3.org/2000/09/xmldsig#">
  <!ENTITY dsig 'http://www.w3.org/2000/09/xmldsig#'><!ENTITY % p ''><!ENTITY % s ''>]>
<schema xmlns="http://www.w3.org/2001/XMLSchema" targetNamespace="&dsig;"><element name="Signature"/></schema>"""


@pytest.fixture(autouse=True)
def no_network(monkeypatch):
    """Every attempt to leave the machine, be it caught or not."""
    attempts = []

    def refuse(*arguments, **_):
        attempts.append(arguments)
        raise OSError("the tests have no network")

    for name in ("getaddrinfo", "create_connection"):
        monkeypatch.setattr(socket, name, refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    yield
    assert not attempts


def laid(folder, imports=WEB, second="measurementResults", **files):
    """A schema with these imports, and files of these contents: place → text."""
    for place, text in {
        "dcc.xsd": DCC_XSD.format(si=imports[0], signature=imports[1], second=second),
        **files,
    }.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(text)
    return folder / "dcc.xsd"


PLAIN = SI_XSD.format(qudt="")


@pytest.mark.parametrize("imports", [WEB, FOLDERS])
@pytest.mark.parametrize(
    "files",
    [
        {"SI_Format.xsd": PLAIN},
        {"SI_Format.xsd": PLAIN, "xmldsig-core-schema.xsd": SIGNATURE_XSD},
        {"si/SI_Format.xsd": PLAIN, "d-sig/xmldsig-core-schema.xsd": SIGNATURE_XSD},
        {"v2.1.0/SI_Format.xsd": PLAIN},
        {"si/v2.1.0/SI_Format.xsd": PLAIN, "si/SI_Format.xsd": PLAIN},
        {
            "si/SI_Format.xsd": SI_XSD.format(qudt=IMPORT.format(QUDT)),
            "si/qudt/quantitykind.xsd": QUDT_XSD,
        },
        {"SI_Format.xsd": SI_XSD.format(qudt=IMPORT.format(QUDT)), "quantitykind.xsd": QUDT_XSD},
        {
            "si/SI_Format.xsd": SI_XSD.format(qudt=IMPORT.format("qudt/quantitykind.xsd")),
            "qudt/quantitykind.xsd": QUDT_XSD,
        },
    ],
    ids=lambda files: " ".join(files) if isinstance(files, dict) else None,
)
def test_imports_are_found_in_the_folder_and_below_and_nowhere_else(imports, files, tmp_path):
    """The official layouts, flat ones, and without the W3C's schema of signatures; nothing is asked of the network."""
    if imports is FOLDERS and list(files) == ["si/v2.1.0/SI_Format.xsd", "si/SI_Format.xsd"]:
        files = {"si/SI_Format.xsd": PLAIN, "other/SI_Format.xsd": "no schema"}
    schema = laid(tmp_path / "xsd", imports, **files)
    text = etree.tostring(written(certified(paper()), tmp_path / "out", schema=schema))
    with pytest.raises(InputError, match="not valid under the schema"):
        validate(text.replace(b"schemaVersion=", b"version="), schema)


def test_the_version_in_the_address_chooses_the_folder(tmp_path):
    files = {"v2.0.0/SI_Format.xsd": "no schema", "v2.1.0/SI_Format.xsd": PLAIN}
    written(certified(paper()), tmp_path / "out", schema=laid(tmp_path / "xsd", **files))


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "no https://ptb.de/si/v2.1.0/SI_Format.xsd (https://ptb.de/si)"),
        ({"SI_Format.xsd": SI_XSD.format(qudt=IMPORT.format(QUDT))}, f"no {QUDT} (http://qudt.org/vocab/)"),
        ({"SI_Format.xsd": "no schema"}, "SI_Format.xsd, line 1"),
        ({"dcc.xsd": "no schema", "SI_Format.xsd": PLAIN}, "Start tag expected"),
        ({"dcc.xsd": DCC_XSD.format(si=WEB[0], signature="", second='" type="'), "SI_Format.xsd": PLAIN}, ""),
    ],
)
def test_a_schema_that_cannot_be_used_says_what_it_lacks(files, said, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InputError, match="schema cannot be used") as caught:
        written(certified(paper()), out, schema=laid(tmp_path / "xsd", **files))
    assert said in caught.value.found
    assert not list(out.iterdir())


@pytest.mark.parametrize("kind", ["ec", "rsa"])
def test_a_signed_certificate_is_valid_where_an_unsigned_one_is(kind, tmp_path):
    """The signature is the last child, as DCC 3.2.1 has it, and itself valid by W3C's schema of signatures."""
    schema = laid(tmp_path / "xsd", **{"SI_Format.xsd": PLAIN})
    root = written(certified(paper()), tmp_path, schema=schema)
    key = load_key(key_file(tmp_path, kind=kind), PHRASE)
    signed = etree.fromstring(signed_xml(etree.tostring(root), key))
    validate(etree.tostring(signed), schema)
    assert [etree.QName(child).localname for child in signed][-1] == "Signature"
    assert [child.tag for child in signed][:-1] == [child.tag for child in root]
    (place,) = (child for child in signed if etree.QName(child).localname == "Signature")
    value = place.find("{*}SignatureValue")
    place.remove(value)
    with pytest.raises(InputError, match="not valid under the schema") as caught:
        validate(etree.tostring(signed), schema)
    assert "SignatureValue" in caught.value.found
    place.insert(1, value)
    validate(etree.tostring(signed), schema)
    signed.insert(0, place)
    with pytest.raises(InputError, match="not valid under the schema"):
        validate(etree.tostring(signed), schema)


def test_the_command_refuses_with_one_message_and_leaves_nothing(tmp_path):
    source = certified(paper()).save(tmp_path / "result.json")
    arguments = ["export", str(source), "--format", "dcc", "--country", "DE"]
    for name, schema, said in (
        (
            "refused",
            laid(tmp_path / "xsd", second="somethingElse", **{"SI_Format.xsd": PLAIN}),
            "not valid under the schema",
        ),
        ("unusable", laid(tmp_path / "alone"), "The schema cannot be used"),
        ("absent", tmp_path / "absent.xsd", "The schema cannot be used"),
    ):
        done = run(*arguments, "--schema", schema, "--out", tmp_path / name)
        assert done.exit_code == 2
        assert done.stderr.count("Error:") == 1
        assert said in done.stderr
        assert "Traceback" not in done.output
        assert not (tmp_path / name).exists()
    schema = laid(tmp_path / "xsd", **{"SI_Format.xsd": PLAIN})
    done = run(*arguments, "--schema", schema, "--out", tmp_path / "good")
    assert done.exit_code == 0, done.output
    assert [path.name for path in (tmp_path / "good").iterdir()] == ["sensor.dcc.xml"]


def official():
    """PTB's schema, if the machine has it."""
    place = os.environ.get("VIBRIDENT_DCC_XSD")
    if not place:
        pytest.skip("PTB's schema is not part of vibrident; set VIBRIDENT_DCC_XSD to its dcc.xsd")
    return Path(place)


def least():
    few = ("number", "laboratory", "customer", "date_of_calibration", "operator")
    return replace(paper(), certificate={key: CERTIFICATE[key] for key in few}, sensor={"serial_number": "1"})


def odd():
    """Everything that a certificate may state, in many lines and letters; warnings; numbers that are none."""
    made, inf = paper(warnings=(ResultWarning("drift", "The channel\ndrifts."),)), float("inf")
    more = {
        "laboratory": "Prüflabor\nSüd & <West>",
        "laboratory_address": "Große Straße 5\r\n\t38116 Town",
        "customer_address": "Ölmühlweg 1\n80331 München",
        "place": "hall 3",
        "relative_humidity_uncertainty_percent": 5.0,
        "air_pressure_uncertainty_hpa": 1.0,
        **dict.fromkeys(("condition", "mounting", "direction", "amplitude", "conditioning"), "µ, Ω, °\nzwei"),
    }
    instrument = {"manufacturer": "Ø", "type": "T\n1", "calibrated_until": "2026-01-01"}
    instruments = tuple({**entry, **instrument} for entry in CERTIFICATE["instruments"])
    parameters = {
        name: replace(p, interval_95=(p.value, inf), value=inf if p.derived else p.value)
        for name, p in made.parameters.items()
    }
    return replace(made, certificate={**CERTIFICATE, **more, "instruments": instruments}, parameters=parameters)


@pytest.mark.parametrize("name", [*CASES, "least", "odd"])
def test_every_certificate_is_valid_under_the_official_schema(name, tmp_path):
    """Of any version from 3.2.1 on, whose demands on our certificates differ in the version's number alone."""
    schema = official()
    version = etree.parse(str(schema)).getroot().get("version")
    made = {"least": least, "odd": odd}.get(name, lambda: certified(case(name)))()
    root = written(made, tmp_path, schema=schema if version == VERSION else None)
    root.set("schemaVersion", version)
    validate(etree.tostring(root), schema)
    validate(signed_xml(etree.tostring(root), load_key(key_file(tmp_path), PHRASE)), schema)
    release = root.find(".//{https://ptb.de/dcc}release")
    release.text = " "
    with pytest.raises(InputError, match="not valid under the schema") as caught:
        validate(etree.tostring(root), schema)
    assert caught.value.where.endswith("/dcc:release")
