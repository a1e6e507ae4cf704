"""Show what departs from the fit, as a line beside the warnings and as a table."""

from __future__ import annotations

import math

from vibrident.base.settings import Word, python_word
from vibrident.physics.naming import in_words
from vibrident.result import Finding, Result
from vibrident.show.numbers import plain
from vibrident.show.tables import doubts
from vibrident.show.views import (
    Block,
    Column,
    Folded,
    Section,
    Sentence,
    Table,
    count,
    listed,
    section,
)

MAX_TABLE_ROWS = 30  # findings in a table; the result lists them all
_MAX_KINDS_IN_LINE = 3  # kinds of finding in a line
_MIN_PROBABILITY = 1e-99  # probabilities below are not told apart

_NOTES = (
    "A finding is a departure from the fit that noise alone would hardly show. One that matters is "
    "a warning as well.",
    "Probability: that noise alone shows it. Largest impact: how far it moves a parameter, as a "
    "multiple of the parameter's stated standard uncertainty u.",
)


def describe_findings(result: Result, word: Word = python_word) -> tuple[Block, ...]:
    """Return warnings in plain words, a line on other findings, and the folded table of all.

    ``word``: the words of a surface for settings.
    """
    findings_table = table(result)
    title = f"Findings ({len(result.findings)})"
    folded = () if findings_table is None else (Folded(title, (findings_table,)),)
    return (*doubts(result, word), *line(result), *folded)


def line(result: Result) -> tuple[Sentence, ...]:
    """Return the findings that no warning names: of each kind the one of the largest effect."""
    unnamed = [finding for finding in result.findings if finding.code not in result.warning_codes]
    if not unnamed:
        return ()
    kinds: dict[str, list[Finding]] = {}
    for finding in unnamed:
        kinds.setdefault(finding.code, []).append(finding)
    sentences = [_sentence_of_kind(result, alike) for alike in kinds.values()]
    limit = listed(len(sentences), _MAX_KINDS_IN_LINE)
    more = [f"And {count(len(sentences) - limit, 'more kind')}."] if len(sentences) > limit else []
    small = all(
        name and size < 1.0 for size, name in (_impact(result, finding) for finding in unnamed)
    )
    verb = "moves" if len(unnamed) == 1 else "move"
    why = f"that {verb} no parameter by its u" if small else "without a warning"
    return (
        Sentence(
            " ".join([*sentences[:limit], *more]),
            "note",
            f"{count(len(unnamed), 'finding')} {why}:",
        ),
    )


def _sentence_of_kind(result: Result, alike: list[Finding]) -> str:
    """Return the findings of one kind as a sentence."""
    most = max(alike, key=lambda finding: _impact(result, finding)[0])
    where = "" if most.record is None else f"{most.record}: "
    more = f", and {len(alike) - 1} more like it" if len(alike) > 1 else ""
    return f"{where}{_message_alone(most).removesuffix('.')} ({_impact_text(result, most)}){more}."


def findings(result: Result) -> Section:
    """Return the section of a document; it is empty without findings, and then left out."""
    return section("findings", "Findings", table(result))


def table(result: Result) -> Table | None:
    """Return each finding with place, probability and largest shift; None without any."""
    if not result.findings:
        return None
    rows = []
    for finding in result.findings[: listed(len(result.findings), MAX_TABLE_ROWS)]:
        time = "" if finding.time_s is None else plain(finding.time_s, 4)
        chance = (
            f"<{plain(_MIN_PROBABILITY)}"
            if finding.probability < _MIN_PROBABILITY
            else plain(finding.probability, 1)
        )
        rows.append(
            (
                _message_alone(finding),
                finding.record or "all",
                time,
                chance,
                _impact_text(result, finding),
            )
        )
    heads = (
        Column("what"),
        Column("record"),
        Column("time", "number", "s"),
        Column("probability", "number"),
    )
    left_out = len(result.findings) - len(rows)
    more = (f"and {left_out} more, listed in result.json",) if left_out else ()
    return Table((*heads, Column("largest impact")), tuple(rows), notes=(*more, *_NOTES)).telling()


def _message_alone(finding: Finding) -> str:
    """Return the message without the record and the parameters, which have their own columns."""
    text = finding.message.removeprefix(f"{finding.record}: ")
    return text.rpartition(" Without it ")[0] or text


def _impact_text(result: Result, finding: Finding) -> str:
    size, name = _impact(result, finding)
    return f"{plain(size, 2)} u of the {in_words(name)}" if name else "no u is stated"


def _impact(result: Result, finding: Finding) -> tuple[float, str]:
    """Return the largest shift in units of u, and its parameter; no name where no u is stated."""
    sizes = []
    for name, shift in finding.impact.items():
        u = result.parameters[name].standard_uncertainty if name in result.parameters else None
        if u and math.isfinite(size := abs(shift) / u):
            sizes.append((size, name))
    return max(sizes, default=(0.0, ""))
