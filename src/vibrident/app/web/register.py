"""List the sensors of a laboratory and its open work. Each function runs in a separate process."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vibrident.app.web.language import Language, language
from vibrident.app.web.translated import fragment
from vibrident.base.fields import Fields
from vibrident.data.io.certificate import CertificateData
from vibrident.result import Result
from vibrident.show.issue import lacking, with_statements
from vibrident.show.views import Column, Table, columns

MAX_SENSORS = 500  # rows of the table


@dataclass(frozen=True)
class CertifiableResult:
    """A result whose certificate can be written."""

    serial_number: str
    missing: int  # entries that a certificate must state and this one does not


def sensors(store: str, serial_part: str, code: str) -> Fields:
    """Return the sensors of a store with last calibration and next due date, the soonest first.

    ``serial_part``: of the serial number; ``code``: of the language. ``table`` is HTML, ``count``
    the number of sensors, None where there is no store yet.
    """
    from vibrident.lab.history.document import Question, all_due
    from vibrident.lab.history.store import Store

    with Store(store) as opened:
        if opened.revision() is None:
            return {"count": None, "table": ""}
        rows = all_due(opened, Question())
    folded = serial_part.strip().casefold()
    named = [row for row in rows if folded in str(row["serial_number"]).casefold()]
    return {
        "count": len(named),
        "table": fragment(language(code), _table(named, language(code))) if named else "",
    }


def _table(rows: Sequence[Fields], speak: Language) -> Table:
    today = datetime.date.today().isoformat()
    cells = []
    overdue = []
    for number, row in enumerate(rows[:MAX_SENSORS]):
        due = "" if row["recalled"] else row["by_interval"] or ""
        if due and due < today:
            overdue.append(number)
        sensor = " ".join(filter(None, (row.get("manufacturer"), row.get("type"))))
        remark = row["recalled"] or (speak("overdue") if due and due < today else "")
        cells.append(
            (
                str(row["serial_number"]),
                sensor,
                row["last"] or "–",
                str(row["calibrations"]),
                due or "–",
                remark,
            )
        )
    heads = (
        *columns(speak("serial number"), speak("sensor"), speak("last calibration")),
        Column(speak("calibrations"), "number"),
        *columns(speak("next due"), speak("remark")),
    )
    return Table(heads, tuple(cells), doubtful=tuple(overdue))


def drafts(paths: Sequence[Path], statements: Sequence[CertificateData]) -> list[CertifiableResult]:
    """Return serial number and missing entries of each result with what is stated beside it."""
    open_drafts = []
    for path, data in zip(paths, statements, strict=True):
        result = with_statements(Result.load(path), data)
        missing = lacking(result.certificate, result.sensor)
        open_drafts.append(
            CertifiableResult(str(result.sensor.get("serial_number") or ""), len(missing))
        )
    return open_drafts
