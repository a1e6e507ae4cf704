"""Write a calibration certificate as text, in one or two languages.

It comes from the result and from what [certificate] states.

The fields are those of ISO/IEC 17025:2017, 7.8, and of practice under ISO 16063 and DKD-R 3-1. What
is not stated is a blank to fill, never a value, and a certificate that lacks what the standard asks
for is a draft.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.data.io.certificate import check_dates
from vibrident.result import Result
from vibrident.show import certificate_decisions, tables
from vibrident.show import certificate_tables as parts
from vibrident.show.certified import REJECTED, certified, describe_raised
from vibrident.show.coverage import coverage, document_kind, not_certified, parameter_factor
from vibrident.show.findings import findings
from vibrident.show.formulas import Mixed
from vibrident.show.history import date_of
from vibrident.show.issue import GROUPS, NOTHING_MORE, Issue, missing
from vibrident.show.language import ENGLISH, Say
from vibrident.show.numbers import plain, printed, reference_quantity, reference_unit, sensor_name
from vibrident.show.points import measured_band
from vibrident.show.setting_tables import budget
from vibrident.show.views import (
    Beside,
    Block,
    Document,
    Fact,
    Facts,
    K,
    Letterhead,
    Section,
    Sentence,
    Signatures,
    document,
    section,
)

_SENSOR = ("manufacturer", "type", "serial_number")


def certificate(result: Result, issue: Issue = NOTHING_MORE) -> Document:
    """Return everything that a certificate states of a result, to be signed.

    Raises:
        InputError: its dates contradict each other, or an instrument was not valid.
    """
    check_dates(result.certificate, "result.json and certificate files")
    say = Say.of(result)
    kind = title(result, say)
    unstated_sources = not_certified(result, say)
    result = certified(result)
    rejected = bool(result.settings.get(REJECTED))
    no_model = Sentence(say("text", "rejected" if rejected else "no_nominal"))
    nominal = parts.sensitivity(result, say) or no_model
    entries = result.certificate

    def section_of(name: str, *blocks: Block | None) -> Section:
        return section(
            name, say("section", name), *(parts.localised(block, say) for block in blocks)
        )

    sections = [
        section_of("reference", parts.reference(result, say)),
        section_of("measured", parts.measured(result, say), parts.from_reference(result, say)),
        section_of("instruments", parts.instruments(result, say)),
        section_of("traceability", Sentence(_text(entries, "traceability") or "")),
        section_of("conformity", *certificate_decisions.conformity(result, say)),
        section_of("limits", *_doubts(result, say)),
        replace(findings(result), title=say("section", "findings"))
        if say.codes == ("en",)
        else section_of("findings"),
        section_of("adjustment", certificate_decisions.adjustment(result, issue.before, say)),
        section_of("sensitivity", nominal),
        section_of("curve", parts.curve(result, say)),
        section_of("parameters", None if rejected else parts.parameters(result, say)),
        section_of("temperature", parts.temperature(result, say)),
        section_of(
            "budget",
            *_unless_left_out(
                result, "budget", budget(result, say), *parts.point_budgets(result, say)
            ),
        ),
        section_of("data", *_unless_left_out(result, "data_files", parts.files(result, say))),
        section_of("statements", *map(Sentence, statements(result, say))),
        section_of("opinions", *map(Sentence, _listed(entries, "opinions"))),
        section_of("remarks", *map(Sentence, remarks(result))),
    ]
    head = (
        *_draft(result, say),
        *((Sentence(say("text", "tracked")),) if result.is_tracked else ()),
        *unstated_sources,
        *_amendment(result, say),
        Beside(groups(result, say)),
        Signatures(signatures(result, say)),
    )
    return replace(
        document(kind, head, sections),
        letterhead=letterhead(result, say, issue.logo),
        draft=say("title", "draft") if missing(result) else "",
        language=say.codes[0],
        second_language="".join(say.codes[1:]),
    )


def _unless_left_out(result: Result, key: str, *blocks: Block | None) -> tuple[Block | None, ...]:
    """Return the blocks of a part that a certificate may be issued without."""
    return () if result.certificate.get(key) == "leave out" else blocks


def title(result: Result, say: Say = ENGLISH) -> str:
    """Return what the document is."""
    return say("title", document_kind(result))


def letterhead(result: Result, say: Say = ENGLISH, logo: bytes | None = None) -> Letterhead:
    """Return the issuer, the number, and what stands on each page of the certificate."""
    data = result.certificate
    lines = (data.get(key) for key in ("laboratory", "laboratory_address", "accreditation"))
    version = result.provenance.get("vibrident")
    time = result.provenance.get("time")
    made_by = f"vibrident{f' {version}' if version else ''}" + (f", {time}" if time else "")
    return Letterhead(
        lines=tuple(str(line) for line in lines if line),
        number=_text(data, "number"),
        subject=sensor_name(result.sensor, Say(say.codes[0])("label", "no")),
        foot=str(say.each(lambda words: words("text", "foot", program="{0}").format(made_by))),
        date=date_of(result),
        words={
            "page": say("text", "page", page="{page}", pages="{pages}"),
            **{key: say("label", key) for key in ("no", "laboratory", "place_and_date")},
        },
        logo="" if logo is None else base64.b64encode(logo).decode(),
    )


def signatures(result: Result, say: Say = ENGLISH) -> tuple[Fact, ...]:
    """Return the signatures of the certificate."""
    return tuple(
        (say("label", key), _text(result.certificate, key)) for key in ("operator", "approved_by")
    )


def _text(certificate_data: Mapping[str, Any], key: str) -> str | None:
    value = certificate_data.get(key)
    return None if value is None or value == "" else str(value)


def groups(result: Result, say: Say = ENGLISH) -> tuple[Facts, ...]:
    """Return what was calibrated, for whom, under which conditions and how."""
    data = result.certificate
    sensor = result.sensor
    other_entries = {key: value for key, value in sensor.items() if key not in _SENSOR and value}

    def facts_of(*keys: str) -> list[Fact]:
        """Return the rows of those keys that the certificate states."""
        return [(say("label", key), "\n".join(_listed(data, key))) for key in keys if data.get(key)]

    def always(*keys: str) -> list[Fact]:
        return [(say("label", key), _text(data, key)) for key in keys]

    device: list[Fact] = [(say("label", key), _text(sensor, key)) for key in _SENSOR]
    device += [
        (say("label", key) if key == "axis" else _words(key), str(value))
        for key, value in other_entries.items()
    ]
    device += facts_of("condition")
    customer = "\n".join(
        str(data[key]) for key in ("customer", "customer_address") if data.get(key)
    )
    order: list[Fact] = [(say("label", "customer"), customer or None)]
    order += facts_of("order_number", "date_of_receipt")
    order += [*always("date_of_calibration", "date_of_issue"), *facts_of("place")]
    conditions = [*always("mounting"), *facts_of("direction", "amplitude", "conditioning")]
    ambient = (
        ("temperature", "c", "°C"),
        ("relative_humidity", "percent", "%"),
        ("air_pressure", "hpa", "hPa"),
    )
    for name, suffix, unit in ambient:
        if name != "air_pressure" or data.get("air_pressure_hpa") is not None:
            conditions.append(
                (say("label", f"{name}_{suffix}"), _ambient(data, name, suffix, unit, say))
            )
    unit = pretty(reference_unit(result))
    quantity = say.each(
        lambda words: words(
            "text", "in_unit", quantity=words.translate(reference_quantity(result)), unit=unit
        )
    )
    method = [
        *always("procedure"),
        *facts_of("deviations", "external_results"),
        (say("label", "reference_quantity"), Mixed(quantity)),
        (say("label", "measured_band"), _band(result, say)),
        (say("label", "evaluation"), say.each(lambda words: evaluation(result, words))),
    ]
    placed = {key for keys in GROUPS.values() for key in keys}
    further = [(_words(key), _plain(value)) for key, value in data.items() if key not in placed]
    titled = {
        "object": device,
        "order": order,
        "conditions": conditions,
        "method": method,
        "further": further,
    }
    return tuple(Facts(tuple(rows), say("group", name)) for name, rows in titled.items() if rows)


def evaluation(result: Result, say: Say) -> str:
    """Return what the model and the estimator are called, without the program's names."""
    model = " + ".join(_part_of_model(component, say) for component in result.model.split("+"))
    return say("text", "evaluation", model=model, estimator=say.word("estimator", result.estimator))


def _part_of_model(component: str, say: Say) -> str:
    """Return what a core or an add-on is called, with the number behind its name."""
    name, _, number = component.partition(":")
    word = say.word("model", name)
    return f"{word} ({number})" if number else word


def _words(key: str) -> str:
    text = key.replace("_", " ")
    return text[:1].upper() + text[1:]


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_plain(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return "; ".join(_plain(item) for item in value)
    return tables.leaf(value)


def _ambient(data: Mapping[str, Any], name: str, suffix: str, unit: str, say: Say) -> str | None:
    """Return a condition with its expanded uncertainty, both as they were stated."""
    value = data.get(f"{name}_{suffix}")
    expanded = data.get(f"{name}_uncertainty_{suffix}")
    if value is None:
        return None
    bar = "" if expanded is None else f" (U = {expanded:.12g} {unit}, k = 2)"
    return say.number(f"{printed(f'{value:.12g}')} {unit}{bar}")


def _band(result: Result, say: Say) -> str:
    band = measured_band(result)
    total = len(result.measured.frequency_hz)
    if band is None or not total:
        return say("text", "no_points")
    low, high = (f"{end:.5g}" for end in band)
    return say("text", "point" if total == 1 else "points", low=low, high=high, count=total)


def statements(result: Result, say: Say = ENGLISH) -> tuple[str, ...]:
    """Return the paragraphs on uncertainty, phase, adequacy and reproduction."""
    covers = result.settings.get("uncertainty_covers")
    relative = result.settings.get("reference_standard_uncertainty")
    verdict = "adequate" if result.fit.adequate else "not_adequate"
    unknown = any(p.standard_uncertainty is None for p in result.parameters.values())

    def sources(words: Say) -> str:
        """Return the sources of the uncertainty, our own words translated."""
        return "; ".join(_source(source, words) for source in str(covers).split("; "))

    sentences = [
        say.each(lambda words: _uncertainty(result, words)),
        Mixed(say.each(lambda words: f"{words('text', 'covers')} {sources(words)}."))
        if covers
        else "",
        say("text", "reference", percent=plain(100.0 * relative, 3)) if relative else "",
        *describe_raised(result, say),
        ""
        if result.is_tracked
        else say.each(
            lambda words: f"{words('text', verdict)} {tables.worst(result.measured, words)}".strip()
        ),
        tables.small_signals(result) if say.codes == ("en",) else "",
        say("text", "unstated")
        if unknown or np.isnan(result.response.magnitude_uncertainty).any()
        else "",
        say("text", "no_reproduction"),
    ]
    return tuple(sentence for sentence in sentences if sentence)


def _source(covered: str, say: Say) -> str:
    """Return a source and, in brackets, its kind; own words of a laboratory as they are."""
    source, bracket, kind = covered.rpartition(" (")
    if not bracket:
        return say.translate(covered)
    return f"{say.translate(source)} ({say.word('kind', kind.removesuffix(')'))})"


def _uncertainty(result: Result, say: Say) -> str:
    """Return what U is and what it covers with which probability."""
    covered = coverage(result)
    k = parameter_factor(result)
    lines = [say("text", "uncertainty"), covered.text(say)]
    if k != K:
        freedom = plain(covered.degrees_of_freedom, 3)
        lines.append(say("text", "student_parameters", factor=plain(k, 3), freedom=freedom))
    return " ".join(lines)


def _draft(result: Result, say: Say) -> tuple[Sentence, ...]:
    """Return what is missing for the document to be issued."""
    lacking = missing(result)
    names = say.each(
        lambda words: (
            f"{words('text', 'draft')} " + ", ".join(words("label", key) for key in lacking) + "."
        )
    )
    return (Sentence(names, "doubt", say("title", "draft")),) if lacking else ()


def _amendment(result: Result, say: Say) -> tuple[Block, ...]:
    """Return what the document replaces, and what changed; nothing for a first issue."""
    data = result.certificate
    if not data.get("replaces"):
        return ()
    changes = "\n".join(_listed(data, "changes")) or None
    rows = ((say("label", "replaces"), str(data["replaces"])), (say("label", "changes"), changes))
    return (Facts(rows, say("section", "amendment")), Sentence(say("text", "amended")))


def _doubts(result: Result, say: Say) -> Iterator[Sentence]:
    for doubt in tables.doubts(result):
        title = say.each(lambda words, doubt=doubt: _sentence(words.translate(doubt.title)))
        # what a warning says in detail is in English, and speaks to the laboratory
        yield Sentence(" ".join(doubt.messages) if say.codes == ("en",) else "", "doubt", title)
    if not (result.warnings or result.fit.adequate):
        yield Sentence(say("text", "inadequate"), "doubt")


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."


def remarks(result: Result) -> tuple[str, ...]:
    """Return the remarks of the certificate."""
    return tuple(_listed(result.certificate, "remarks"))


def _listed(certificate_data: Mapping[str, Any], key: str) -> list[str]:
    entries = certificate_data.get(key) or ()
    return (
        [str(entries)]
        if isinstance(entries, str | int | float)
        else [str(entry) for entry in entries]
    )
