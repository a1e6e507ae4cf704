"""Text that parsers do not take as it is: other spellings, remarks, heads between the rows."""

from __future__ import annotations

import re
from collections.abc import Sequence

from vibrident.base.errors import InputError
from vibrident.data.io.columns import Clock
from vibrident.data.io.csv_layout import CsvLayout, split_line
from vibrident.data.io.plain_text import BLANKS, PlainText
from vibrident.data.io.text_head import LABVIEW_END, HeadFacts, HeadLine

#: A segment that begins this close to the end of the one before, in sampling intervals, goes on.
_SAME_PLACE = 0.01


def clean(text: PlainText, layout: CsvLayout, file: str) -> bool:
    """Bring a text into the form that the quick parsers take; False if that changed nothing.

    Every line stays in its place. InputError where a segment of a LabVIEW file does not go on with
    the channels of the one before, or begins at another time than that ends.
    """
    before = text.read()
    text.respell(layout.delimiter)
    content = text.read()
    if layout.has_comments and layout.delimiter != BLANKS:
        gap = re.escape(layout.delimiter)
        remark = rf"^((?:[^{gap}\r\n]*{gap}){{{layout.fields - 1}}}[^{gap}\r\n]*){gap}[^\r\n]*"
        rows = re.sub(remark.encode(), rb"\1", content[layout.offset :], flags=re.MULTILINE)
        content = content[: layout.offset] + rows
    if LABVIEW_END.encode() in content[layout.offset :]:
        content = _without_heads(content, layout, file)
    if content != before:
        text.replace(content)
    return content != before


def _without_heads(content: bytes, layout: CsvLayout, file: str) -> bytes:
    """Return the text with the heads of further segments blanked, which go on with the record."""
    lines = content[layout.offset :].split(b"\n")
    ends = [i for i, line in enumerate(lines) if line.startswith(LABVIEW_END.encode())]
    facts, begin = layout.facts, 0
    for end in ends:
        if end < begin:
            continue
        top = end
        while top > begin and _is_text(lines[top - 1], layout):
            top -= 1
        names = (
            split_line(_decoded(lines[end + 1], layout), layout.delimiter)
            if end + 1 < len(lines)
            else []
        )
        number = layout.first_line + top
        head = [
            HeadLine(number + i, _decoded(line, layout))
            for i, line in enumerate(lines[top : end + 1])
        ]
        rows = sum(bool(line.strip()) for line in lines[begin:top])
        following = layout.read_head(head)
        _require_continuation(layout, facts, following, rows, names, f"{file}, line {number}")
        facts = following
        begin = end + 2
        lines[top:begin] = [b""] * len(lines[top:begin])
    return content[: layout.offset] + b"\n".join(lines)


def _decoded(line: bytes, layout: CsvLayout) -> str:
    return line.decode(layout.encoding, errors="replace")


def _is_text(line: bytes, layout: CsvLayout) -> bool:
    """Tell whether a line belongs to a head: it begins with a word, or holds nothing."""
    first = split_line(_decoded(line, layout), layout.delimiter)[:1]
    return not line.strip() or bool(first and first[0][:1].isalpha())


def _require_continuation(
    layout: CsvLayout,
    before: HeadFacts,
    after: HeadFacts,
    rows: int,
    names: Sequence[str],
    where: str,
) -> None:
    """Refuse a segment of other channels, units or rate, or that begins elsewhere than expected."""
    if tuple(names[: len(layout.names)]) != layout.names or after.units != before.units:
        raise _refusal("other channels or units than those above", where)
    for old, new in zip(before.clocks, after.clocks, strict=True):
        if old is None and new is None:
            continue
        if old is None or new is None or abs(new.rate_hz / old.rate_hz - 1.0) > old.rate_rounding:
            raise _refusal("another sampling rate than above", where)
        gap = _gap(old, new, rows)
        if gap is None or abs(gap) > _SAME_PLACE:
            found = "no start" if gap is None else f"a gap of {gap:.6g} sampling intervals"
            raise _refusal(found, where)


def _gap(before: Clock, after: Clock, rows: int) -> float | None:
    """Return the time between two segments, in sampling intervals; None if it is not known."""
    if before.start is None or after.start is None or before.start.epoch != after.start.epoch:
        return None
    return (after.start.ns - before.start.ns) * 1e-9 * before.rate_hz - rows


def _refusal(found: str, where: str) -> InputError:
    return InputError(
        "A segment of the file does not go on where the one before ends.",
        expected="the same channels, without a gap in time",
        found=found,
        where=where,
        remedy="write each segment into a file of its own, one record each",
    )
