"""Build a calibration certificate from a result and its [certificate], in one or two languages.

The fields are those of ISO/IEC 17025:2017, 7.8, and of practice under ISO 16063 and DKD-R 3-1. An
entry that is not stated is a blank to fill. A certificate without an entry that the standard
requires is a draft.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.data.io.certificate import check_dates
from vibrident.result import Result
from vibrident.show import certificate_decisions, certificate_tables, tables
from vibrident.show.certified import REJECTED, certified, describe_raised
from vibrident.show.coverage import coverage, document_kind, not_certified, parameter_factor
from vibrident.show.findings import findings
from vibrident.show.formulas import Mixed
from vibrident.show.history import date_of
from vibrident.show.issue import GROUPS, NOTHING_MORE, Issue, missing
from vibrident.show.language import ENGLISH, Translator
from vibrident.show.numbers import plain, printed, reference_quantity, reference_unit, sensor_name
from vibrident.show.points import measured_band
from vibrident.show.setting_tables import budget
from vibrident.show.views import (
    Block,
    Document,
    Fact,
    Facts,
    Gallery,
    K,
    Letterhead,
    Section,
    Sentence,
    Signatures,
    capitalised,
    document,
    section,
)

_SENSOR_KEYS = ("manufacturer", "type", "serial_number")
_AMBIENT_CONDITIONS = (
    # key of [certificate] without its unit, the unit in the key, the unit in print
    ("temperature", "c", "°C"),
    ("relative_humidity", "percent", "%"),
    ("air_pressure", "hpa", "hPa"),
)


def certificate(result: Result, issue: Issue = NOTHING_MORE) -> Document:
    """Build the certificate of a result, to be signed.

    Raises:
        InputError: its dates contradict each other, or an instrument was not valid.
    """
    check_dates(result.certificate, "result.json and certificate files")
    translate = Translator.from_result(result)
    head = [*_draft(result, translate)]
    if result.is_tracked:
        head.append(Sentence(translate("text", "tracked")))
    head += [*not_certified(result, translate), *_amendment(result, translate)]
    stated = certified(result)
    head += [Gallery(groups(stated, translate)), Signatures(signatures(stated, translate))]
    view = document(title(result, translate), tuple(head), _sections(stated, issue, translate))
    return replace(
        view,
        letterhead=letterhead(stated, translate, issue.logo),
        draft=translate("title", "draft") if missing(stated) else "",
        language=translate.codes[0],
        second_language="".join(translate.codes[1:]),
    )


def _sections(result: Result, issue: Issue, translate: Translator) -> list[Section]:
    """Return the sections in the order of the certificate; those without content are empty."""
    entries = result.certificate
    is_rejected = bool(result.settings.get(REJECTED))
    no_model = Sentence(translate("text", "rejected" if is_rejected else "no_nominal"))
    blocks: dict[str, Iterable[Block | None]] = {
        "reference": [certificate_tables.reference(result, translate)],
        "measured": [
            certificate_tables.measured(result, translate),
            certificate_tables.from_reference(result, translate),
        ],
        "instruments": [certificate_tables.instruments(result, translate)],
        "traceability": [Sentence(_text(entries, "traceability") or "")],
        "conformity": certificate_decisions.conformity(result, translate),
        "limits": _doubts(result, translate),
        # the sentences of findings exist in English only
        "findings": findings(result).blocks if translate.codes == ("en",) else (),
        "adjustment": [certificate_decisions.adjustment(result, issue.before, translate)],
        "sensitivity": [certificate_tables.sensitivity(result, translate) or no_model],
        "curve": [certificate_tables.curve(result, translate)],
        "parameters": [None if is_rejected else certificate_tables.parameters(result, translate)],
        "temperature": [certificate_tables.temperature(result, translate)],
        "budget": [
            budget(result, translate),
            *certificate_tables.point_budgets(result, translate),
        ],
        "data": [certificate_tables.files(result, translate)],
        "statements": map(Sentence, statements(result, translate)),
        "opinions": map(Sentence, _texts(entries, "opinions")),
        "remarks": map(Sentence, remarks(result)),
    }
    for name, key in (("budget", "budget"), ("data", "data_files")):
        if entries.get(key) == "leave out":
            del blocks[name]
    return [
        section(
            name,
            translate("section", name),
            *(certificate_tables.localised(block, translate) for block in contents),
        )
        for name, contents in blocks.items()
    ]


def title(result: Result, translate: Translator = ENGLISH) -> str:
    """Return the title of the document."""
    return translate("title", document_kind(result))


def letterhead(
    result: Result, translate: Translator = ENGLISH, logo: bytes | None = None
) -> Letterhead:
    """Return the issuer, the number, and the header and footer of each page."""
    entries = result.certificate
    issuer = (_text(entries, key) for key in ("laboratory", "laboratory_address", "accreditation"))
    program = " ".join(filter(None, ["vibrident", result.provenance.get("vibrident")]))
    program = ", ".join(filter(None, [program, result.provenance.get("time")]))
    return Letterhead(
        lines=tuple(filter(None, issuer)),
        number=_text(entries, "number"),
        subject=sensor_name(result.sensor, Translator(translate.codes[0])("label", "no")),
        # ``format`` after the translation: the decimal sign must not change the version
        foot=translate("text", "foot", program="{0}").format(program),
        date=date_of(result),
        words={
            "page": translate("text", "page", page="{page}", pages="{pages}"),
            **{key: translate("label", key) for key in ("no", "laboratory", "place_and_date")},
        },
        logo="" if logo is None else base64.b64encode(logo).decode(),
    )


def signatures(result: Result, translate: Translator = ENGLISH) -> tuple[Fact, ...]:
    """Return the lines to sign on, each with the name that the certificate states."""
    return tuple(_facts(result.certificate, translate, "operator", "approved_by"))


def _texts(entries: Mapping[str, Any], key: str) -> list[str]:
    """Return the texts of an entry that is one text or a list; empty where it is not stated."""
    value = entries.get(key)
    if value is None or value == "":
        return []
    return [str(item) for item in value] if isinstance(value, list | tuple) else [str(value)]


def _text(entries: Mapping[str, Any], key: str) -> str | None:
    """Return the text of an entry, a list in lines; None where it is not stated."""
    return "\n".join(_texts(entries, key)) or None


def _facts(entries: Mapping[str, Any], translate: Translator, *keys: str) -> list[Fact]:
    """Return a row for each key; an entry that is not stated is a blank to fill."""
    return [(translate("label", key), _text(entries, key)) for key in keys]


def _stated_facts(entries: Mapping[str, Any], translate: Translator, *keys: str) -> list[Fact]:
    """Return a row for each key that is stated."""
    return [fact for fact in _facts(entries, translate, *keys) if fact[1] is not None]


def groups(result: Result, translate: Translator = ENGLISH) -> tuple[Facts, ...]:
    """Return the tables of the object, the order, the conditions, the method and other entries."""
    entries = result.certificate
    known_keys = {key for keys in GROUPS.values() for key in keys}
    facts_by_group = {
        "object": _object_facts(result, translate),
        "order": _order_facts(entries, translate),
        "conditions": _condition_facts(entries, translate),
        "method": _method_facts(result, translate),
        "further": [
            (_key_label(key), _nested_text(value))
            for key, value in entries.items()
            if key not in known_keys
        ],
    }
    return tuple(
        Facts(tuple(facts), translate("group", name))
        for name, facts in facts_by_group.items()
        if facts
    )


def _object_facts(result: Result, translate: Translator) -> list[Fact]:
    sensor = result.sensor
    other_facts = [
        (translate("label", key) if key == "axis" else _key_label(key), str(value))
        for key, value in sensor.items()
        if key not in _SENSOR_KEYS and value
    ]
    return [
        *_facts(sensor, translate, *_SENSOR_KEYS),
        *other_facts,
        *_stated_facts(result.certificate, translate, "condition"),
    ]


def _order_facts(entries: Mapping[str, Any], translate: Translator) -> list[Fact]:
    customer = filter(None, (_text(entries, key) for key in ("customer", "customer_address")))
    return [
        (translate("label", "customer"), "\n".join(customer) or None),
        *_stated_facts(entries, translate, "order_number", "date_of_receipt"),
        *_facts(entries, translate, "date_of_calibration", "date_of_issue"),
        *_stated_facts(entries, translate, "place"),
    ]


def _condition_facts(entries: Mapping[str, Any], translate: Translator) -> list[Fact]:
    facts = _facts(entries, translate, "mounting")
    facts += _stated_facts(entries, translate, "direction", "amplitude", "conditioning")
    for name, suffix, unit in _AMBIENT_CONDITIONS:
        value = entries.get(f"{name}_{suffix}")
        expanded = entries.get(f"{name}_uncertainty_{suffix}")
        text = None
        if value is not None:
            text = f"{printed(f'{value:.12g}')} {unit}"
            text += "" if expanded is None else f" (U = {expanded:.12g} {unit}, k = 2)"
            text = translate.number(text)
        if text or name != "air_pressure":
            facts.append((translate("label", f"{name}_{suffix}"), text))
    return facts


def _method_facts(result: Result, translate: Translator) -> list[Fact]:
    entries = result.certificate
    unit = pretty(reference_unit(result))
    quantity = translate.each_language(
        lambda language: language(
            "text", "in_unit", quantity=language.phrase(reference_quantity(result)), unit=unit
        )
    )
    return [
        *_facts(entries, translate, "procedure"),
        *_stated_facts(entries, translate, "deviations", "external_results"),
        (translate("label", "reference_quantity"), Mixed(quantity)),
        (translate("label", "measured_band"), _band_text(result, translate)),
        (
            translate("label", "evaluation"),
            translate.each_language(lambda language: evaluation(result, language)),
        ),
    ]


def evaluation(result: Result, translate: Translator) -> str:
    """Return the names of model and estimator, in words of the field."""
    components = []
    for component in result.model.split("+"):
        name, _, number = component.partition(":")
        words = translate.name("model", name)
        components.append(f"{words} ({number})" if number else words)
    estimator = translate.name("estimator", result.estimator)
    return translate("text", "evaluation", model=" + ".join(components), estimator=estimator)


def _key_label(key: str) -> str:
    return capitalised(key.replace("_", " "))


def _nested_text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_nested_text(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return "; ".join(_nested_text(item) for item in value)
    return tables.leaf(value)


def _band_text(result: Result, translate: Translator) -> str:
    band = measured_band(result)
    total = len(result.measured.frequency_hz)
    if band is None or not total:
        return translate("text", "no_points")
    low, high = (f"{end:.5g}" for end in band)
    return translate("text", "point" if total == 1 else "points", low=low, high=high, count=total)


def statements(result: Result, translate: Translator = ENGLISH) -> tuple[str, ...]:
    """Return the paragraphs on uncertainty, phase, adequacy and reproduction."""
    sources = result.settings.get("uncertainty_covers")
    relative_u = result.settings.get("reference_standard_uncertainty")
    paragraphs: list[str] = [
        translate.each_language(lambda language: _describe_uncertainty(result, language))
    ]
    if sources:
        covered = translate.each_language(lambda language: _describe_sources(sources, language))
        paragraphs.append(Mixed(covered))
    if relative_u:
        paragraphs.append(translate("text", "reference", percent=plain(100.0 * relative_u, 3)))
    paragraphs += describe_raised(result, translate)
    if not result.is_tracked:
        paragraphs.append(
            translate.each_language(lambda language: _describe_adequacy(result, language))
        )
    if translate.codes == ("en",):
        paragraphs.append(tables.small_signals(result))
    u_is_missing = any(p.standard_uncertainty is None for p in result.parameters.values())
    if u_is_missing or np.isnan(result.response.magnitude_uncertainty).any():
        paragraphs.append(translate("text", "unstated"))
    paragraphs.append(translate("text", "no_reproduction"))
    return tuple(filter(None, paragraphs))


def _describe_sources(sources: str, translate: Translator) -> str:
    """Return the covered sources, each with its kind; a laboratory's own words as they are."""
    texts = []
    for text in sources.split("; "):
        source, bracket, kind = text.rpartition(" (")
        if bracket:
            name = translate.name("kind", kind.removesuffix(")"))
            texts.append(f"{translate.phrase(source)} ({name})")
        else:
            texts.append(translate.phrase(text))
    return f"{translate('text', 'covers')} {'; '.join(texts)}."


def _describe_adequacy(result: Result, translate: Translator) -> str:
    verdict = translate("text", "adequate" if result.fit.adequate else "not_adequate")
    return f"{verdict} {tables.worst(result.measured, translate)}".strip()


def _describe_uncertainty(result: Result, translate: Translator) -> str:
    """Return the meaning of U, its coverage factor and its coverage probability."""
    covered = coverage(result)
    k = parameter_factor(result)
    sentences = [translate("text", "uncertainty"), covered.text(translate)]
    if k != K:
        freedom = plain(covered.degrees_of_freedom, 3)
        sentences.append(
            translate("text", "student_parameters", factor=plain(k, 3), freedom=freedom)
        )
    return " ".join(sentences)


def _draft(result: Result, translate: Translator) -> tuple[Sentence, ...]:
    """Return the entries that are missing for an issue; nothing if there are none."""
    missing_keys = missing(result)
    if not missing_keys:
        return ()

    def list_labels(language: Translator) -> str:
        labels = ", ".join(language("label", key) for key in missing_keys)
        return f"{language('text', 'draft')} {labels}."

    return (Sentence(translate.each_language(list_labels), "doubt", translate("title", "draft")),)


def _amendment(result: Result, translate: Translator) -> tuple[Block, ...]:
    """Return the replaced certificate and the changes; nothing for a first issue."""
    if not result.certificate.get("replaces"):
        return ()
    facts = tuple(_facts(result.certificate, translate, "replaces", "changes"))
    return (
        Facts(facts, translate("section", "amendment")),
        Sentence(translate("text", "amended")),
    )


def _doubts(result: Result, translate: Translator) -> Iterator[Sentence]:
    for doubt in tables.doubts(result):
        title = translate.each_language(
            lambda language, doubt=doubt: f"{capitalised(language.phrase(doubt.title))}."
        )
        # the messages of warnings exist in English only, and are for the laboratory
        messages = " ".join(doubt.messages) if translate.codes == ("en",) else ""
        yield Sentence(messages, "doubt", title)
    if not (result.warnings or result.fit.adequate):
        yield Sentence(translate("text", "inadequate"), "doubt")


def remarks(result: Result) -> tuple[str, ...]:
    """Return the remarks of the certificate."""
    return tuple(_texts(result.certificate, "remarks"))
