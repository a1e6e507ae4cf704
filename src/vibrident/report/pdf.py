"""Certificate and comparison as PDF, set by typst from the templates beside this module."""

from __future__ import annotations

import datetime
import importlib.util
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vibrident import __version__
from vibrident.errors import InputError
from vibrident.escaping import typst_data
from vibrident.report.certificate import certificate
from vibrident.report.drawings import drift_svg, sensitivity_svg
from vibrident.report.history import date_of, drift_table, histories
from vibrident.report.side_by_side import comparison_tables
from vibrident.result import Result

_TEMPLATES = Path(__file__).parent / "templates"
#: Data files listed in a certificate; the result lists them all.
MOST_FILES = 30


def certificate_pdf(result: Result) -> bytes:
    """A calibration certificate as PDF, from the result alone.

    Raises:
        InputError: typst is not installed.
    """
    content = asdict(certificate(result))
    files = content["files"]
    if len(files["rows"]) > MOST_FILES:
        left = len(files["rows"]) - MOST_FILES
        files["rows"] = files["rows"][:MOST_FILES]
        files["notes"] = [f"and {left} more, listed in result.json"]
    day = date_of(result)
    more = {
        "adequate": result.fit.adequate,
        "curve": sensitivity_svg(result),
        "day": None if day is None else (day.year, day.month, day.day),
    }
    return _set("certificate.typ", {**content, **more}, day)


def comparison_pdf(results: Sequence[Result], names: Sequence[str]) -> bytes:
    """Several results side by side as PDF, with the drift of each sensor that was calibrated more than once.

    Raises:
        InputError: typst is not installed.
    """
    found = histories(results, names)
    content = {
        "title": f"Comparison of {len(results)} calibrations",
        "histories": [{"sensor": h.sensor, "chart": drift_svg(h), "table": asdict(drift_table(h))} for h in found],
        "tables": [(title, asdict(table)) for title, table in comparison_tables(results, names)],
        "made_by": f"vibrident {__version__}",
    }
    return _set("comparison.typ", content, None)


def _set(template: str, content: Mapping[str, Any], day: datetime.date | None) -> bytes:
    if importlib.util.find_spec("typst") is None:
        raise InputError(
            "PDF needs typst, which is not installed.",
            expected="the package typst",
            found="none",
            where="--format pdf",
            remedy="pip install 'vibrident[report]'",
        )
    import typst

    document = json.dumps(typst_data(content), ensure_ascii=False)
    # The same result gives the same file: no clock, and no fonts of this machine where ours have all the letters.
    noon = datetime.datetime.combine(day or datetime.date(2000, 1, 1), datetime.time(12), datetime.UTC)
    return typst.compile(
        str(_TEMPLATES / template),
        root=str(_TEMPLATES),
        format="pdf",
        sys_inputs={"document": document},
        ignore_system_fonts=_european(document),
        timestamp=int(noon.timestamp()),
    )


def _european(text: str) -> bool:
    """Whether the font that typst brings has every letter: Latin, Greek, Cyrillic, punctuation and signs."""
    return all(ord(letter) < 0x530 or 0x1E00 <= ord(letter) < 0x2C00 for letter in text)
