"""What departs from the fit, as a line beside the warnings and as a table: view models for every medium."""

from __future__ import annotations

import math

from vibrident.base.settings import Word, python_word
from vibrident.physics.naming import in_words
from vibrident.result import Finding, Result
from vibrident.show.numbers import plain
from vibrident.show.tables import doubts
from vibrident.show.views import Block, Column, Folded, Section, Sentence, Table, count, listed, section

MOST_ROWS = 30  # findings in a table; the result lists them all
_MOST_SAID = 3  # kinds of finding in a line
_LEAST = 1e-99  # probabilities below are not told apart

_NOTES = (
    "A finding is a departure from the fit that noise alone would hardly show. One that matters is a warning as well.",
    "Probability: that noise alone shows it. Largest impact: how far it moves a parameter, as a multiple of the "
    "parameter's stated standard uncertainty u.",
)


def told(result: Result, word: Word = python_word) -> tuple[Block, ...]:
    """Return every warning in plain words, a line on the findings that are no warnings, and the table of all, folded.

    ``word``: the words of a surface for settings.
    """
    known = table(result)
    folded = () if known is None else (Folded(f"Findings ({len(result.findings)})", (known,)),)
    return (*doubts(result, word), *line(result), *folded)


def line(result: Result) -> tuple[Sentence, ...]:
    """The findings that no warning names, in one paragraph: of each kind the one that moves a parameter most."""
    left = [finding for finding in result.findings if finding.code not in result.warning_codes]
    if not left:
        return ()
    kinds: dict[str, list[Finding]] = {}
    for finding in left:
        kinds.setdefault(finding.code, []).append(finding)
    said = [_said(result, alike) for alike in kinds.values()]
    kept = listed(len(said), _MOST_SAID)
    more = [f"And {count(len(said) - kept, 'more kind')}."] if len(said) > kept else []
    small = all(name and size < 1.0 for size, name in (_impact(result, finding) for finding in left))
    verb = "moves" if len(left) == 1 else "move"
    why = f"that {verb} no parameter by its u" if small else "without a warning"
    return (Sentence(" ".join([*said[:kept], *more]), "note", f"{count(len(left), 'finding')} {why}:"),)


def _said(result: Result, alike: list[Finding]) -> str:
    """Findings of one kind in a sentence."""
    most = max(alike, key=lambda finding: _impact(result, finding)[0])
    where = "" if most.record is None else f"{most.record}: "
    more = f", and {len(alike) - 1} more like it" if len(alike) > 1 else ""
    return f"{where}{_what(most).removesuffix('.')} ({_moved(result, most)}){more}."


def findings(result: Result) -> Section:
    """The section of a document; without findings it is empty, and so is left out."""
    return section("findings", "Findings", table(result))


def table(result: Result) -> Table | None:
    """What, where, how probable and how far each moves a parameter; None where nothing departs."""
    if not result.findings:
        return None
    rows = []
    for finding in result.findings[: listed(len(result.findings), MOST_ROWS)]:
        time = "" if finding.time_s is None else plain(finding.time_s, 4)
        chance = f"<{plain(_LEAST)}" if finding.probability < _LEAST else plain(finding.probability, 1)
        rows.append((_what(finding), finding.record or "all", time, chance, _moved(result, finding)))
    heads = (Column("what"), Column("record"), Column("time", "number", "s"), Column("probability", "number"))
    left = len(result.findings) - len(rows)
    more = (f"and {left} more, listed in result.json",) if left else ()
    return Table((*heads, Column("largest impact")), tuple(rows), notes=(*more, *_NOTES)).telling()


def _what(finding: Finding) -> str:
    """The message without the record, and without what the parameters would be: both have columns of their own."""
    text = finding.message.removeprefix(f"{finding.record}: ")
    return text.rpartition(" Without it ")[0] or text


def _moved(result: Result, finding: Finding) -> str:
    size, name = _impact(result, finding)
    return f"{plain(size, 2)} u of the {in_words(name)}" if name else "no u is stated"


def _impact(result: Result, finding: Finding) -> tuple[float, str]:
    """The largest shift in the stated u of its parameter, and the parameter; no name where no u is stated."""
    sizes = []
    for name, shift in finding.impact.items():
        u = result.parameters[name].standard_uncertainty if name in result.parameters else None
        if u and math.isfinite(size := abs(shift) / u):
            sizes.append((size, name))
    return max(sizes, default=(0.0, ""))
