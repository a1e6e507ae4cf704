"""Text that parsers do not take as it is: other spellings, remarks, heads between the rows."""

from __future__ import annotations

import re
from collections.abc import Sequence

from vibrident.base.errors import InputError
from vibrident.data.io.columns import Channel
from vibrident.data.io.csv_layout import CsvLayout
from vibrident.data.io.plain_text import BLANKS, PlainText
from vibrident.data.io.text_head import LABVIEW_END, HeadLine

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
    text = content[layout.offset :].decode(layout.encoding, errors="surrogateescape")
    lines = text.split("\n")
    facts = layout.facts
    begin = 0
    for end in [i for i, line in enumerate(lines[:-1]) if line.startswith(LABVIEW_END)]:
        top = end
        while top > begin and (not lines[top - 1].strip() or lines[top - 1].strip()[0].isalpha()):
            top -= 1
        number = layout.first_line + top
        head = [HeadLine(number + i, line) for i, line in enumerate(lines[top:end])]
        following = layout.read_head([*head, HeadLine(0, LABVIEW_END)])
        names = layout.split(lines[end + 1])
        is_same = [channel.unit for channel in following] == [channel.unit for channel in facts]
        if names[: len(layout.names)] != [*layout.names] or not is_same:
            difference = "other channels or units than those above"
        else:
            difference = _gap(
                facts, following, sum(bool(line.strip()) for line in lines[begin:top])
            )
        if difference:
            raise InputError(
                "A segment of the file does not go on where the one before ends.",
                expected="the same channels, without a gap in time",
                found=difference,
                where=f"{file}, line {number}",
                remedy="write each segment into a file of its own, one record each",
            )
        facts = following
        begin = end + 2
        lines[top:begin] = [""] * (begin - top)
    text = "\n".join(lines)
    return content[: layout.offset] + text.encode(layout.encoding, errors="surrogateescape")


def _gap(before: Sequence[Channel], after: Sequence[Channel], rows: int) -> str:
    """Return what parts a segment in time from the one before, of as many rows; "" for nothing."""
    for channel, following in zip(before, after, strict=True):
        old = channel.clock
        new = following.clock
        if old is None and new is None:
            continue
        if old is None or new is None or abs(new.rate_hz / old.rate_hz - 1.0) > old.rate_rounding:
            return "another sampling rate than above"
        if old.start is None or new.start is None or old.start.epoch != new.start.epoch:
            return "no start"
        gap = (new.start.ns - old.start.ns) * 1e-9 * old.rate_hz - rows
        if abs(gap) > _SAME_PLACE:
            return f"a gap of {gap:.6g} sampling intervals"
    return ""
