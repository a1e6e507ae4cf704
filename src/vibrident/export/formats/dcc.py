"""Digital calibration certificate (PTB's DCC, schema 3.2.1) with D-SI numbers (schema 2.1.0).

Required statements that the result lacks come from the calibration file's [certificate] section;
the country code is an option. Numbers are those of the result, with all digits. A certificate is
validated against the user's schema, with the schemas in its folder for imports: PTB's import web
addresses, and nothing is fetched. Without a local file, W3C's schema of XML signatures is
xmlschema's.
"""

from __future__ import annotations

import functools
import io
import math
import re
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from vibrident.base.errors import InputError
from vibrident.base.version import __version__
from vibrident.base.warning_kinds import explain
from vibrident.data.io.certificate import check_dates
from vibrident.export.dcc_results import measurement
from vibrident.export.dcc_tree import DCC as NAMESPACE
from vibrident.export.dcc_tree import LANGUAGE, SI, Tree, cleaned, numeral
from vibrident.export.form import Format, Options, library
from vibrident.export.sensor import ExportedSensor
from vibrident.physics.naming import parameter_name
from vibrident.result import Result
from vibrident.show.certified import certified, describe_raised, stated_parameters
from vibrident.show.coverage import coverage, interval_text, not_certified, unstated
from vibrident.show.language import Translator
from vibrident.show.points import reference_value
from vibrident.show.tables import small_signals
from vibrident.show.views import Sentence
from vibrident.use.conformity import DEVIATION, judge_requirements

VERSION = "3.2.1"
_LOCATION = f"https://ptb.de/dcc https://ptb.de/dcc/v{VERSION}/dcc.xsd"
_SIGNER = (
    "approved by"  # roles of the persons; an operator is responsible, but signs only if stated
)
_NEEDED = (
    "number",
    "laboratory",
    "customer",
    "date_of_calibration",
)  # required keys of [certificate]
#: DCC's terms for the place of calibration; any other place is "other" with a statement.
_LOCATIONS = {
    word.lower(): word
    for word in ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
}


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.dcc.xml``."""
    result = Result.from_dict(sensor.result.to_dict())  # as in its file: no NaN, dates as text
    _check(result, options)
    reasons = not_certified(result)
    result = stated_parameters(certified(result))
    tree = Tree()
    names = {"dcc": NAMESPACE, "si": SI, "xsi": "http://www.w3.org/2001/XMLSchema-instance"}
    root = tree.etree.Element(
        f"{{{NAMESPACE}}}digitalCalibrationCertificate", nsmap=names, schemaVersion=VERSION
    )
    root.set("{http://www.w3.org/2001/XMLSchema-instance}schemaLocation", _LOCATION)
    root.append(_administration(tree, result, options, reasons))
    root.append(tree.make("measurementResults", measurement(tree, result)))
    text = tree.etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    if options.schema is not None:
        validate(text, options.schema)
    path = folder / f"{options.name}.dcc.xml"
    path.write_bytes(text)
    return [path]


def _check(result: Result, options: Options) -> None:
    if result.is_tracked:
        raise InputError(
            "A tracked result is no calibration, so it has no calibration certificate.",
            expected="the result of a calibration",
            found="a result of ⟦command = track⟧",
            where="result.json, estimator",
            remedy="export the result that the tracking began with",
        )
    certificate = result.certificate
    missing = [f"[certificate] {key}" for key in _NEEDED if _blank(certificate.get(key))]
    if all(_blank(certificate.get(key)) for key in ("approved_by", "operator")):
        missing.append("[certificate] approved_by or operator")
    missing += ["[sensor] serial_number"] if _blank(result.sensor.get("serial_number")) else []
    if missing:
        raise InputError(
            "The result lacks what a calibration certificate must state.",
            expected=", ".join(missing),
            found="nothing",
            where="result.json, certificate and sensor",
            remedy=(
                "write it into a file and give that with ⟦export.certificate⟧, or into the "
                "calibration file and identify again"
            ),
        )
    check_dates(certificate, "result.json")
    country = _country(result, options)
    if not re.fullmatch("[A-Z]{2}", country or ""):
        raise InputError(
            "The certificate needs the country of the laboratory.",
            expected="two capitals (ISO 3166-1), such as DE",
            found=repr(country),
            where="⟦export.country⟧",
            remedy="give ⟦export.country⟧, or [certificate] country",
        )


def _country(result: Result, options: Options) -> str | None:
    return options.country or result.certificate.get("country")


def _blank(value: object) -> bool:
    return value is None or not str(value).strip()


def _administration(
    tree: Tree, result: Result, options: Options, unstated_sources: Iterable[Sentence]
) -> Any:
    certificate = result.certificate
    named = result.sensor
    make = tree.make
    text = tree.text
    date = str(certificate["date_of_calibration"])
    location = str(certificate.get("place") or "laboratory").strip().lower()
    order = certificate.get("order_number")
    core = make(
        "coreData",
        make("countryCodeISO3166_1", text=_country(result, options)),
        make("usedLangCodeISO639_1", text=LANGUAGE),
        make("mandatoryLangCodeISO639_1", text=LANGUAGE),
        make(
            "uniqueIdentifier", text=cleaned(f"{certificate['laboratory']} {certificate['number']}")
        ),
        make(
            "identifications",
            tree.identification(
                "calibrationLaboratory", certificate["number"], "certificate number"
            ),
            tree.identification("customer", order, "order number") if order else None,
        ),
        tree.optional("receiptDate", certificate.get("date_of_receipt")),
        make("beginPerformanceDate", text=date),
        make("endPerformanceDate", text=date),
        make("performanceLocation", text=_LOCATIONS.get(location, "other")),
        tree.optional("issueDate", certificate.get("date_of_issue")),
    )
    maker = named.get("manufacturer")
    kind = named.get("type")
    item = make(
        "item",
        tree.named(kind) if kind else text("name", "vibration sensor"),
        make("manufacturer", tree.named(maker)) if maker else None,
        tree.optional("model", kind),
        make(
            "identifications",
            tree.identification("manufacturer", named["serial_number"], "serial number"),
        ),
    )
    persons = [(certificate.get("approved_by"), _SIGNER), (certificate.get("operator"), "operator")]
    responsible = (
        make(
            "respPerson",
            make("person", tree.named(name)),
            make("role", text=role),
            make("mainSigner", text="true") if role == _SIGNER else None,
        )
        for name, role in persons
        if not _blank(name)
    )
    statements = _statements(tree, result, unstated_sources)
    declared = (make("statement", text("name", title), *nodes) for title, *nodes in statements)
    country = _country(result, options)
    address = certificate.get("laboratory_address")
    return make(
        "administrativeData",
        make(
            "dccSoftware",
            make("software", text("name", "vibrident"), make("release", text=f"v{__version__}")),
        ),
        core,
        make("items", item),
        make(
            "calibrationLaboratory",
            tree.optional("calibrationLaboratoryCode", certificate.get("accreditation")),
            _contact(tree, "contact", certificate["laboratory"], address, country),
        ),
        make("respPersons", *responsible),
        _contact(
            tree, "customer", certificate["customer"], certificate.get("customer_address"), None
        ),
        make("statements", *declared),
    )


def _contact(tree: Tree, tag: str, name: str, address: str | None, country: str | None) -> Any:
    code = tree.make("countryCode", text=country) if country else None
    further = (
        tree.text("further", "address not stated")
        if _blank(address)
        else tree.multiline("further", address)
    )
    return tree.make(tag, tree.named(name), tree.make("location", code, further))


def _statements(
    tree: Tree, result: Result, unstated_sources: Iterable[Sentence]
) -> Iterable[tuple[str, *tuple[Any, ...]]]:
    """Yield conventions of the numbers, and the laboratory's statements: title, declaration."""
    ours = functools.partial(tree.text, "declaration")
    yield (
        "sign convention",
        ours(
            "Sensitivity for e^(+j w t): the phase is that of the response minus that of the "
            "reference, so lag is negative. A positive delay means that the response comes later, "
            "a factor e^(-j w delay). Gains are signed."
        ),
    )
    covered = result.settings.get("uncertainty_covers")
    sentences = [
        coverage(result).text(),
        f"Uncertainties cover: {covered}." if covered else "",
        interval_text(result),
    ]
    sentences += [f"{sentence.lead} {sentence.text}".strip() for sentence in unstated_sources]
    yield "uncertainty", ours(*(line for line in sentences if line))
    if remark := small_signals(result):
        yield "small signals", ours(remark)
    verdict = "describes" if result.fit.adequate else "does not describe"
    yield "adequacy", ours(f"The model {verdict} the data within their uncertainties.")
    for warning in result.warnings:
        yield f"limitation: {explain(warning.code).title}", ours(warning.message)
    yield "reproduction", ours(Translator(LANGUAGE)("text", "no_reproduction"))
    for raised in describe_raised(result, Translator(LANGUAGE)):
        yield "least uncertainty", ours(raised)
    yield from _conformity(tree, result)
    if result.certificate.get("replaces"):
        yield "replaces certificate", tree.multiline("declaration", result.certificate["replaces"])
    for key in _DECLARED_KEYS:
        statement = result.certificate.get(key) or ()
        for line in statement if isinstance(statement, list | tuple) else [statement]:
            yield "remark" if key == "remarks" else key, tree.multiline("declaration", line)


#: Statements of the laboratory without an element of their own.
_DECLARED_KEYS = (
    *(
        "traceability",
        "condition",
        "mounting",
        "direction",
        "amplitude",
        "conditioning",
        "place",
        "deviations",
    ),
    *("external_results", "changes", "opinions", "remarks"),
)


def _conformity(tree: Tree, result: Result) -> Iterable[tuple[str, *tuple[Any, ...]]]:
    """Yield each requirement with limits, value and u, decision rule, and verdict."""
    if not result.certificate.get("requirements") or "gain" in unstated(result):
        return
    point = reference_value(result)
    reference_point = None if point is None else (point.magnitude, point.magnitude_uncertainty)
    rule = Translator(LANGUAGE)("text", result.certificate.get("decision_rule") or "simple")
    for row in judge_requirements(
        result, None if point is None else point.frequency_hz, reference_point
    ):
        numbers = {
            "low": row.low,
            "high": row.high,
            "value": row.value,
            "standard uncertainty": row.u,
        }
        chance = None if row.probability is None else round(row.probability, 2)
        numbers |= {"frequency in Hz": row.frequency_hz, "probability of conformance": chance}
        name = parameter_name(row.quantity).words
        if row.quantity == DEVIATION:
            name = "deviation of the sensitivity from that at the reference frequency"
        details = [f"{name}, unit {row.unit}"]
        details += [
            f"{name} {numeral(n)}"
            for name, n in numbers.items()
            if n is not None and math.isfinite(n)
        ]
        details += [f"stated in {row.source}"] if row.source else []
        declaration = tree.text("declaration", rule, ", ".join(details))
        met = (
            None if row.met is None else tree.make("conformity", text="pass" if row.met else "fail")
        )
        yield f"conformity: {name}", declaration, met


DCC = Format(
    name="dcc",
    title="digital calibration certificate",
    write=write,
    contents=(
        "parameters with u and 95 % interval, correlation, curve and measured points with U (k = "
        "2), budget, what `[certificate]` states, warnings"
    ),
    cannot_hold="training, excerpts",
    options=("country", "schema"),
    extra="dcc",
)


_XSD = "{http://www.w3.org/2001/XMLSchema}"
_INCLUDED_NAMESPACES = "http://www.w3.org/"  # W3C namespaces that xmlschema contains


def validate(text: bytes, schema: Path) -> None:
    """Validate XML against an XSD; imports are files of the same name near it.

    Raises:
        InputError: the schema cannot be read, the text is invalid, or a library is missing.
    """
    xmlschema = library("xmlschema", "dcc")
    etree = library("lxml.etree", "dcc")
    missing: list[str] = []
    try:
        locations, missing = _imports(schema, etree)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a missing import that is used is an error below
            rules = xmlschema.XMLSchema(str(schema), locations=locations, allow="local")
    except (OSError, xmlschema.XMLSchemaException, etree.XMLSyntaxError, SyntaxError) as error:
        absent = " and ".join(missing)
        raise InputError(
            "The schema cannot be used.",
            expected=(
                "an XSD, such as PTB's dcc.xsd, with the schemas it imports in the same folder or "
                "below"
            ),
            found=f"no {absent}" if absent else " ".join(str(error).split())[:300],
            where=str(schema),
            remedy="put that file beside it, or into a folder there, as in its address"
            if absent
            else "give another ⟦export.schema⟧",
        ) from error
    faults = list(rules.iter_errors(io.BytesIO(text), use_location_hints=False))
    if faults:
        first = faults[0]
        more = f" (the first of {len(faults)} faults)" if len(faults) > 1 else ""
        raise InputError(
            "The certificate is not valid under the schema.",
            expected=f"a document valid under {schema.name}",
            found=" ".join((first.reason or str(first)).split()) + more,
            where=str(first.path),
            remedy=(
                "correct what the calibration file states there, or give the schema of this DCC's "
                "version"
            ),
        )


def _imports(schema: Path, etree: Any) -> tuple[dict[str, str], list[str]]:
    """Return namespace → file of all direct and indirect imports, and imports without a file."""
    files: dict[str, str] = {}
    missing: dict[str, None] = {}
    visited = {schema}
    todo = [schema]
    while todo:
        file = todo.pop()
        for node in etree.parse(str(file)).iter(f"{_XSD}import", f"{_XSD}include"):
            schema_location = node.get("schemaLocation", "")
            name = node.get("namespace", "")
            if not schema_location or name in files:
                continue
            local = next(
                (
                    path
                    for path in _candidate_files(schema_location, file.parent, schema.parent)
                    if path.is_file()
                ),
                None,
            )
            if local is None:
                missing.update(
                    {}
                    if name.startswith(_INCLUDED_NAMESPACES)
                    else {f"{schema_location} ({name or 'included'})": None}
                )
                continue
            if name:
                files[name] = str(local)
            if local not in visited:
                visited.add(local)
                todo.append(local)
    return files, list(missing)


def _candidate_files(schema_location: str, *folders: Path) -> Iterator[Path]:
    """Yield candidate paths for an address: its ever shorter ends, then one folder below."""
    steps = [
        step for step in urlsplit(schema_location).path.split("/") if step not in ("", ".", "..")
    ]
    for folder in folders:
        if "://" not in schema_location:
            yield folder / schema_location
        yield from (folder.joinpath(*steps[k:]) for k in range(len(steps)))
    for folder in folders:
        yield from sorted(
            below / steps[-1] for below in folder.iterdir() if steps and below.is_dir()
        )
