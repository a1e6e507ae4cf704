"""The certificate's structure (DCC 3.2.1, D-SI 2.1.0), its numbers against the result, its units against dsiUnits.

Order, choices and patterns are those of the two schemas, which tests/export/test_dcc_schema.py asks themselves.
"""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from lxml import etree
from tests.support.certified import CERTIFICATE, certified, written
from tests.support.exported import CASES, PAPER, case, paper, result

from vibrident.base.errors import InputError
from vibrident.export import export
from vibrident.export.dcc_results import d_si
from vibrident.result import Result, ResultWarning

pytestmark = [
    # dsiUnits takes the beginning of \percent, and what it writes itself, for its deprecated \per.
    pytest.mark.filterwarnings("ignore:The dsi string contains the token"),
    pytest.mark.filterwarnings("ignore:SelectableGroups:DeprecationWarning"),
]
SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
#: Children of each element in their order, from the schema's sequences; ? optional, * any number, + at least one,
#: | one of these.
#: administrativeData is an xs:all and locations are choices: their order is free.
ORDER = {
    "dcc:digitalCalibrationCertificate": "dcc:administrativeData dcc:measurementResults",
    "dcc:administrativeData": "dcc:dccSoftware dcc:coreData dcc:items dcc:calibrationLaboratory dcc:respPersons "
    "dcc:customer dcc:statements?",
    "dcc:dccSoftware": "dcc:software+",
    "dcc:usedSoftware": "dcc:software+",
    "dcc:software": "dcc:name dcc:release dcc:type? dcc:description?",
    "dcc:coreData": "dcc:countryCodeISO3166_1 dcc:usedLangCodeISO639_1+ dcc:mandatoryLangCodeISO639_1+ "
    "dcc:uniqueIdentifier dcc:identifications? dcc:receiptDate? dcc:beginPerformanceDate dcc:endPerformanceDate "
    "dcc:performanceLocation dcc:issueDate?",
    "dcc:items": "dcc:name? dcc:item+",
    "dcc:item": "dcc:name dcc:description? dcc:manufacturer? dcc:model? dcc:identifications",
    "dcc:identifications": "dcc:identification+",
    "dcc:identification": "dcc:issuer dcc:value dcc:name?",
    "dcc:manufacturer": "dcc:name dcc:location?",
    "dcc:person": "dcc:name dcc:location?",
    "dcc:calibrationLaboratory": "dcc:calibrationLaboratoryCode? dcc:contact",
    "dcc:contact": "dcc:name dcc:location",
    "dcc:customer": "dcc:name dcc:location",
    "dcc:location": "dcc:countryCode? dcc:further",
    "dcc:respPersons": "dcc:respPerson+",
    "dcc:respPerson": "dcc:person dcc:description? dcc:role? dcc:mainSigner?",
    "dcc:statements": "dcc:statement+",
    "dcc:statement": "dcc:name? dcc:description? dcc:declaration? dcc:conformity?",
    "dcc:measurementResults": "dcc:measurementResult+",
    "dcc:measurementResult": "dcc:name dcc:description? dcc:usedMethods? dcc:usedSoftware? dcc:measuringEquipments? "
    "dcc:influenceConditions? dcc:results",
    "dcc:usedMethods": "dcc:usedMethod+",
    "dcc:usedMethod": "dcc:name dcc:description? dcc:norm*",
    "dcc:measuringEquipments": "dcc:measuringEquipment+",
    "dcc:measuringEquipment": "dcc:name dcc:description? dcc:manufacturer? dcc:model? dcc:identifications?",
    "dcc:influenceConditions": "dcc:influenceCondition+",
    "dcc:influenceCondition": "dcc:name dcc:description? dcc:status? dcc:data",
    "dcc:results": "dcc:result+",
    "dcc:result": "dcc:name dcc:description? dcc:data",
    "dcc:data": "dcc:quantity* dcc:list*",
    "dcc:list": "dcc:name? dcc:description? dcc:quantity+",
    "dcc:quantity": "dcc:name? dcc:description? dcc:noQuantity|si:real|si:realListXMLList",
    "si:real": "si:label? si:value si:unit si:expandedUnc|si:coverageInterval?",
    "si:expandedUnc": "si:uncertainty si:coverageFactor si:coverageProbability",
    "si:coverageInterval": "si:standardUnc si:intervalMin si:intervalMax si:coverageProbability",
    "si:realListXMLList": "si:valueXMLList si:unitXMLList si:expandedUncXMLList?",
    "si:expandedUncXMLList": "si:uncertaintyXMLList si:coverageFactorXMLList si:coverageProbabilityXMLList",
    "dcc:name": "dcc:content",
    **dict.fromkeys(("dcc:description", "dcc:declaration", "dcc:further", "dcc:noQuantity"), "dcc:content+"),
}
#: By the types of both schemas; every attribute and every text of a certificate is one of these.
NUMBER = r"((\d*\.\d+)|(\d+\.\d*)|(\d+\.?))([Ee][-+]?\d+)?"
DECIMAL, UNCERTAINTY = rf"[-+]?{NUMBER}", rf"\+?{NUMBER}"
NOT_EMPTY = r"[^\s]+(\s+[^\s]+)*"
FACTOR, PROBABILITY = r"\+?(([1-9]\d*\.\d*)|([1-9]\d*))", r"\+?((0(\.\d*)?)|(1(\.0*)?))"
DATE = r"\d{4}-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])"
PATTERNS = {
    **dict.fromkeys(("dcc:countryCodeISO3166_1", "dcc:countryCode"), r"[A-Z]{2}"),
    **dict.fromkeys(("dcc:usedLangCodeISO639_1", "dcc:mandatoryLangCodeISO639_1"), r"[a-z]{2}"),
    "dcc:performanceLocation": "laboratory|customer|laboratoryBranch|customerBranch|other",
    "dcc:issuer": "manufacturer|calibrationLaboratory|customer|owner|other",
    **dict.fromkeys((f"dcc:{key}" for key in ("receiptDate", "issueDate")), DATE),
    **dict.fromkeys((f"dcc:{key}PerformanceDate" for key in ("begin", "end")), DATE),
    **dict.fromkeys(
        (
            f"dcc:{key}"
            for key in ("uniqueIdentifier", "release", "model", "role", "value", "calibrationLaboratoryCode")
        ),
        NOT_EMPTY,
    ),
    "dcc:mainSigner": "true|false|0|1",
    "dcc:conformity": "pass|fail|conditionalPass|conditionalFail|noPass|noFail",
    "dcc:content": NOT_EMPTY,  # the schema takes any string; ours says something
    "si:label": ".*",
    **dict.fromkeys(("si:unit", "si:unitXMLList"), r"[^\s]+"),
    **dict.fromkeys(("si:value", "si:intervalMin", "si:intervalMax"), DECIMAL),
    **dict.fromkeys(("si:standardUnc", "si:uncertainty"), UNCERTAINTY),
    "si:valueXMLList": f"{DECIMAL}( {DECIMAL})*",
    "si:uncertaintyXMLList": f"{UNCERTAINTY}( {UNCERTAINTY})*",
    **dict.fromkeys(("si:coverageFactor", "si:coverageFactorXMLList"), FACTOR),
    **dict.fromkeys(("si:coverageProbability", "si:coverageProbabilityXMLList"), PROBABILITY),
}
ATTRIBUTES = {
    "dcc:digitalCalibrationCertificate": {"schemaVersion": r"3\.2\.1"},
    "dcc:content": {"lang": r"[a-z]{2}"},
    "dcc:result": {"id": r"[a-z]+"},  # xs:ID
}
LOCATION = "{http://www.w3.org/2001/XMLSchema-instance}schemaLocation"


def short(element):
    name = etree.QName(element)
    return {v: k for k, v in SPACES.items()}[name.namespace] + ":" + name.localname


def check_structure(root):
    for element in root.iter(etree.Element):
        name, children = short(element), " ".join(short(child) for child in element)
        if len(element):
            parts = [(part.rstrip("?*+"), part[-1] if part[-1] in "?*+" else "") for part in ORDER[name].split()]
            pattern = "".join(f"({'|'.join(f'{child} ' for child in one.split('|'))}){mark}" for one, mark in parts)
            assert re.fullmatch(pattern, children + " "), (name, children)
            assert not (element.text or "").strip()
        else:
            assert re.fullmatch(PATTERNS[name], element.text), (name, element.text)
        for key, text in element.attrib.items():
            assert key == LOCATION or re.fullmatch(ATTRIBUTES[name][key], text), (name, key, text)
    names = root.xpath("//@id")
    assert len(names) == len(set(names))


def contents(root, path):
    """(text, language) of each content below an element."""
    return [(e.text, e.get("lang")) for e in root.xpath(f"//{path}/dcc:content", namespaces=SPACES)]


def real(root, label):
    return root.xpath(f"//si:real[si:label='{label}']", namespaces=SPACES)[0]


@pytest.mark.parametrize("name", CASES)
def test_structure_units_and_numbers(name, tmp_path):
    from dsi_unit import DsiUnit

    made = certified(case(name))
    root = written(made, tmp_path)
    check_structure(root)
    for unit in root.xpath("//si:unit | //si:unitXMLList", namespaces=SPACES):
        assert DsiUnit(unit.text).valid
    for key, p in made.parameters.items():
        found = real(root, key)
        assert float(found.findtext("si:value", namespaces=SPACES)) == p.value
        if p.interval_95[0] is not None:
            numbers = [float(e.text) for e in found.find("si:coverageInterval", SPACES)]
            assert numbers == [p.standard_uncertainty, *p.interval_95, 0.95]
        else:
            numbers = [float(e.text) for e in found.find("si:expandedUnc", SPACES)]
            assert numbers[:2] == [2 * p.standard_uncertainty, 2.0]
    for key, curve in (("response", made.response), ("measured", made.measured)):
        lists = root.xpath(f"//dcc:result[@id='{key}']//si:valueXMLList", namespaces=SPACES)
        spreads = root.xpath(f"//dcc:result[@id='{key}']//si:uncertaintyXMLList", namespaces=SPACES)
        for found, wanted in zip(lists, (curve.frequency_hz, curve.magnitude, curve.phase_deg), strict=True):
            assert list(map(float, found.text.split())) == wanted.tolist()
        for found, wanted in zip(spreads, (curve.magnitude_uncertainty, curve.phase_deg_uncertainty), strict=True):
            assert list(map(float, found.text.split())) == [2 * u for u in wanted]
    rows = root.xpath("//dcc:result[@id='correlation']//si:valueXMLList", namespaces=SPACES)
    assert tuple(tuple(map(float, row.text.split())) for row in rows) == made.correlation.matrix


def test_what_the_laboratory_states_is_there(tmp_path):
    made = replace(certified(paper()), warnings=(ResultWarning("drift", "The channel drifts."),))
    root = written(made, tmp_path)
    text = " ".join(root.itertext())
    for part in (
        *("Laboratory for <Vibration>", "12345 Town", "Customer & Co.", "D-K-00000-01-00", "2025-11-14", "B. Head"),
        *(
            "ISO 16063-11, method 3",
            "interferometer",
            "PTB 1",
            "to the SI",
            "The channel drifts.",
            "4711 */",
            "Brüel & Søn",
        ),
    ):
        assert part in text
    temperature = root.xpath("//dcc:influenceCondition[1]//si:real", namespaces=SPACES)[0]
    check_structure(root)
    assert [e.text for e in temperature.iter() if not len(e)] == ["23.1", r"\degreecelsius", "0.5", "2.0", "0.95"]
    assert root.get("schemaVersion") == "3.2.1"


def test_what_is_not_stated_is_left_out_not_invented(tmp_path):
    few = {key: CERTIFICATE[key] for key in ("number", "laboratory", "customer", "date_of_calibration", "operator")}
    made = replace(paper(), certificate=few)
    blank = {
        name: replace(p, standard_uncertainty=None, interval_95=(None, None)) for name, p in made.parameters.items()
    }
    nothing = replace(
        made.measured,
        phase_deg=(None,) * 25,
        phase_deg_uncertainty=(None,) * 25,
        magnitude_uncertainty=(None,) * 25,
    )
    root = written(replace(made, parameters=blank, measured=nothing), tmp_path)
    check_structure(root)
    assert not root.xpath("//dcc:influenceConditions | //dcc:measuringEquipments", namespaces=SPACES)
    assert not root.xpath("//si:coverageInterval | //si:expandedUnc", namespaces=SPACES)
    assert len(root.xpath("//dcc:result[@id='measured']//si:valueXMLList", namespaces=SPACES)) == 2
    assert "uncertainty not stated" in " ".join(root.itertext())


def test_what_the_laboratory_wrote_keeps_its_lines_and_claims_no_language(tmp_path):
    """Only our own texts are known to be in English. A name is one line, other texts as many as were written."""
    more = {
        "laboratory": "Prüflabor\nSüd",
        "laboratory_address": "\nGroße Straße 5\r\n\n\t38116 Town \n",
        "customer_address": " ",
        "procedure": "ISO 16063-11\nMethode 3",
        "condition": "unbeschädigt",
        "remarks": ("one\ntwo", "„drei“"),
        "place": "Customer",
    }
    root = written(replace(paper(), certificate={**CERTIFICATE, **more}), tmp_path)
    check_structure(root)
    assert contents(root, "dcc:contact/dcc:name") == [("Prüflabor Süd", None)]
    assert contents(root, "dcc:contact//dcc:further") == [("Große Straße 5", None), ("38116 Town", None)]
    assert contents(root, "dcc:customer//dcc:further") == [("address not stated", "en")]
    assert contents(root, "dcc:usedMethod[1]/dcc:description") == [("ISO 16063-11", None), ("Methode 3", None)]
    assert contents(root, "dcc:statement[dcc:name/dcc:content='condition']/dcc:declaration") == [("unbeschädigt", None)]
    remarks = contents(root, "dcc:statement[dcc:name/dcc:content='remark']/dcc:declaration")
    assert remarks == [("one", None), ("two", None), ("„drei“", None)]
    assert {language for _, language in contents(root, "dcc:statement/dcc:name")} == {"en"}
    for path in ("dcc:person/dcc:name", "dcc:measuringEquipment/dcc:name", "dcc:manufacturer/dcc:name"):
        assert contents(root, path)
        assert {language for _, language in contents(root, path)} == {None}
    assert root.findtext(".//dcc:performanceLocation", namespaces=SPACES) == "customer"


@pytest.mark.parametrize("place", [None, "laboratory", "customerBranch", "hall 3, Ölmühle"])
def test_places_by_the_words_of_the_schema(place, tmp_path):
    root = written(replace(paper(), certificate={**CERTIFICATE, "place": place}), tmp_path)
    check_structure(root)
    word = root.findtext(".//dcc:performanceLocation", namespaces=SPACES)
    assert word == {None: "laboratory", "hall 3, Ölmühle": "other"}.get(place, place)
    assert (place or "place") in " ".join(root.itertext()) or place is None


def test_numbers_that_are_not_finite_are_said_in_words(tmp_path):
    """D-SI 2.1.0 has neither NaN nor infinity, and its lists no blanks: in memory and from a file the same."""
    made = certified(paper())
    inf, nan, names = float("inf"), float("nan"), list(made.parameters)
    parameters = dict(made.parameters)
    low, high = parameters[names[0]].interval_95
    parameters[names[0]] = replace(parameters[names[0]], interval_95=(low, inf))
    parameters[names[1]] = replace(parameters[names[1]], interval_95=(-inf, high), standard_uncertainty=nan)
    derived = next(name for name in names if parameters[name].derived)
    parameters[derived] = replace(parameters[derived], value=inf, standard_uncertainty=None)
    matrix = ((1.0, nan, 0.0), (nan, 1.0, 0.0), (0.0, 0.0, 1.0))
    curve = replace(made.response, magnitude=(nan, *made.response.magnitude[1:]))
    empty = replace(made.measured, magnitude=(nan,) * 25)
    correlation = replace(made.correlation, matrix=matrix)
    made = replace(made, parameters=parameters, correlation=correlation, response=curve, measured=empty)
    root = written(made, tmp_path)
    check_structure(root)
    text = " ".join(root.itertext())
    assert f"95 % coverage interval from {low!r}, without an upper limit" in text
    assert f"95 % coverage interval up to {high!r}, without a lower limit" in text
    assert contents(root, f"dcc:quantity[dcc:name/dcc:content='{derived}']/dcc:noQuantity") == [
        ("no finite value", "en")
    ]
    assert root.xpath("//dcc:result/@id", namespaces=SPACES) == ["parameters", "response"]
    lists = root.xpath("//si:valueXMLList", namespaces=SPACES)
    assert [float(v) for v in lists[1].text.split()] == list(curve.magnitude[1:])
    again = Result.load(made.save(tmp_path / "result.json"))
    assert etree.tostring(written(again, tmp_path)) == etree.tostring(root)


def test_a_nonlinear_sensor_is_certified_all_the_same(tmp_path):
    made = certified(result("accelerometer+cubic", {**PAPER, "cubic_stiffness": 0.02}))
    root = written(made, tmp_path)
    unit = real(root, "cubic_stiffness").findtext("si:unit", namespaces=SPACES)
    assert unit == r"\volt\tothe{-2}"
    for form in ("c", "stationxml", "sacpz", "fmu"):
        with pytest.raises(InputError, match="linear sensors only"):
            export(made, form, tmp_path, rate_hz=51200.0)
    (path,) = export(made, "sacpz", tmp_path, without=["cubic"])
    assert "small signals only" in path.read_text()


@pytest.mark.parametrize(
    ("unit", "wanted", "size"),
    [
        ("V/(m/s^2)", r"\volt\metre\tothe{-1}\second\tothe{2}", 1.0),
        ("V/(m/s)", r"\volt\metre\tothe{-1}\second", 1.0),
        ("mV/(m/s²)", r"\milli\volt\metre\tothe{-1}\second\tothe{2}", 1e-3),
        ("pC/((A) s^2)", r"\pico\coulomb\ampere\tothe{-1}\second\tothe{-2}", 1e-12),
        ("1/V^2", r"\volt\tothe{-2}", None),
        ("rad/s", r"\radian\second\tothe{-1}", None),
        ("(count)/(m/s^2)", r"\metre\tothe{-1}\second\tothe{2}", None),
        ("1", r"\one", None),
        ("V*s/m", r"\volt\second\metre\tothe{-1}", None),
    ],
)
def test_units_in_d_si(unit, wanted, size):
    from dsi_unit import DsiUnit

    assert d_si(unit) == wanted
    if size is not None and "pico" not in wanted:
        base = DsiUnit(wanted.replace(r"\milli", ""))
        assert base.get_scale_factor(DsiUnit(wanted)) == pytest.approx(size)


@pytest.mark.parametrize("unit", ["V/(m/s^2", "widget", "V^x", "m/s)", "g"])
def test_units_without_a_form_in_d_si_are_refused(unit):
    with pytest.raises(InputError, match="no form in D-SI"):
        d_si(unit)


@pytest.mark.parametrize("key", ["date_of_receipt", "date_of_calibration", "date_of_issue"])
@pytest.mark.parametrize("date", ["31.3.2025", "2025-02-30", "20250331"])
def test_dates_that_are_none_are_refused(key, date, tmp_path):
    with pytest.raises(InputError, match="date of the certificate cannot be read") as caught:
        written(replace(paper(), certificate={**CERTIFICATE, key: date}), tmp_path)
    assert key in caught.value.where
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("key", ["number", "laboratory", "customer"])
def test_blanks_state_nothing(key, tmp_path):
    with pytest.raises(InputError, match="must state"):
        written(replace(paper(), certificate={**CERTIFICATE, key: " \n\t"}), tmp_path)
    with pytest.raises(InputError, match="must state"):
        written(replace(certified(paper()), sensor={"serial_number": "\u00a0 "}), tmp_path)


def test_a_blank_name_signs_nothing(tmp_path):
    root = written(replace(paper(), certificate={**CERTIFICATE, "approved_by": " "}), tmp_path)
    check_structure(root)
    assert contents(root, "dcc:respPerson//dcc:name") == [("A. Operator", None)]
    assert not root.xpath("//dcc:mainSigner", namespaces=SPACES)


def test_a_certificate_without_its_statements_is_refused(tmp_path):
    with pytest.raises(InputError) as caught:
        export(paper(), "dcc", tmp_path, country="DE")
    for key in ("number", "laboratory", "customer", "date_of_calibration", "approved_by"):
        assert key in caught.value.expected
    with pytest.raises(InputError, match="country"):
        export(certified(paper()), "dcc", tmp_path)
    with pytest.raises(InputError, match="country"):
        export(certified(paper()), "dcc", tmp_path, country="Germany")
    assert not list(tmp_path.iterdir())
