"""Figures as matplotlib draws them: print and grayscale first, no pyplot, no change of backend.

Ticks, limits and texts are the view model's, so the room that each needs is known before anything
is drawn: the layout is arithmetic, and a picture is drawn once. Matplotlib is loaded when the first
one is; its settings are the library's defaults plus ours inside ``styled()`` and the user's own
again after it.
"""

from __future__ import annotations

import io
import math
import textwrap
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.show.curves import spread
from vibrident.show.formulas import in_a_line
from vibrident.show.media.fonts import drawing_fonts, printable, split_lines
from vibrident.show.media.panel_drawing import draw_panel
from vibrident.show.views import (
    Figure,
    Stack,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

_SETTINGS: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 8,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "figure.titlesize": 10.5,
    "figure.dpi": 100,
    "savefig.dpi": 160,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#d9d9d9",
    "grid.linewidth": 0.5,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "text.parse_math": False,  # a "$" in a sensor's name is a "$"
    "pdf.fonttype": 42,  # TrueType, embedded
    "ps.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "vibrident",  # same result, same file
}
PNG_COMPRESSION = (
    2  # compression of a PNG: the usual one takes three times as long for a seventh less
)
_UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "ps": {"CreationDate": None}}
MAX_STACKS = 6  # most stacks drawn where one of many can be chosen elsewhere
# widths in inches of a picture of one or two, and of three stacks beside each other
WIDTHS = (6.7, 6.7, 8.6)
# Heights in points (1/72 inch) of a line of small print, a tick's label, an axis' label and a
# title.
_SMALL = 10.0
_TICK = 10.0
_LABEL = 12.0
_TITLE = 15.0
# Widths in points of a digit and of a small letter.
_DIGIT = 5.1
_LETTER = 4.2
_TITLE_LETTER = 4.6

_LOCK = threading.RLock()  # matplotlib's settings belong to the whole process


@contextmanager
def styled() -> Iterator[None]:
    """Draw with the shared settings; the process has its own again afterwards."""
    import matplotlib.style

    with (
        _LOCK,
        matplotlib.style.context(["default", {**_SETTINGS, "font.sans-serif": drawing_fonts()[0]}]),
    ):
        yield


def picture(figure: Figure) -> Picture:
    """Draw a figure; of many alike stacks at most six, spread evenly."""
    with styled():
        return _Drawing(figure).drawn()


def content(figure: Figure | Picture, kind: str) -> bytes:
    """Return a figure as bytes: ``png``, ``svg`` or ``pdf``, without a date."""
    options: dict[str, Any] = {"metadata": _UNDATED.get(kind)}
    if kind == "png":
        options["pil_kwargs"] = {"compress_level": PNG_COMPRESSION}
    stream = io.BytesIO()
    with styled():
        drawn = picture(figure) if isinstance(figure, Figure) else figure
        drawn.savefig(stream, format=kind, **options)
    return stream.getvalue()


def svg(figure: Figure) -> str:
    """Return the picture as SVG, without the words that the page says beside it."""
    return content(replace(figure, title="", subject="", caption="", note=""), "svg").decode()


def _fitting(line: str, width_pt: float) -> str:
    """Return a title that fits, without its middle, because names of records differ at the end."""
    most = max(12, int(width_pt / _TITLE_LETTER))
    return line if len(line) <= most else f"{line[: most // 3]}…{line[1 + most // 3 - most :]}"


def _wrapped(text: str, width_pt: float, most: int, letter: float = _LETTER) -> list[str]:
    return textwrap.wrap(
        printable(text), max(10, int(width_pt / letter)), max_lines=most, placeholder=" …"
    )


class _Drawing:
    """A figure on its way to paper; all lengths in points, from the top."""

    def __init__(self, figure: Figure) -> None:
        stacks = (
            [figure.stacks[i] for i in spread(len(figure.stacks), MAX_STACKS)]
            if figure.choice
            else figure.stacks
        )
        fitting = 1 if len(stacks) <= 1 else 2 if len(stacks) <= 4 else 3
        columns = figure.across or (fitting if figure.choice else max(1, len(stacks)))
        self.rows = [stacks[i : i + columns] for i in range(0, len(stacks), columns)]
        self.width = 72.0 * (figure.width_in or WIDTHS[min(columns, 3) - 1])
        down = [[row[j] for row in self.rows if j < len(row)] for j in range(columns) if self.rows]
        self.lefts = [max(map(_left_margin, column)) for column in down]
        shares = np.array([max(stack.width for stack in column) for column in down])
        self.widths = (self.width - sum(self.lefts) - 12.0 * columns) * shares / shares.sum()
        self.head = split_lines(figure.title)[:1] + _wrapped(
            figure.subject, self.width - 12.0, 3, 5.0
        )
        caption = " ".join(in_a_line(text) for text in (figure.caption, figure.note) if text)
        share = (
            f"{len(stacks)} of {len(figure.stacks)} records shown."
            if len(stacks) < len(figure.stacks)
            else ""
        )
        self.foot = _wrapped(f"{share} {caption}", self.width - 16.0, 5)
        every = (line for stack in stacks for panel in stack.panels for line in panel.series)
        self.keys = list(
            dict.fromkeys(label for line in every for label in (line.band, line.label) if label)
        )

    def drawn(self) -> Picture:
        """Return the picture, with an Agg canvas of its own."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure as Picture

        key_rows, columns = _key_rows(self.keys, self.width)
        top = 8.0 + _TITLE * bool(self.head) + 12.5 * max(0, len(self.head) - 1) + 13.5 * key_rows
        tops = [top]
        for row in self.rows:
            tops.append(tops[-1] + max(_tall(stack) for stack in row))
        self.height = tops[-1] + 4.0 + 9.6 * len(self.foot)
        self.picture = Picture(figsize=(self.width / 72.0, self.height / 72.0))
        FigureCanvasAgg(self.picture)
        self._write()
        handles: dict[str, Any] = {}
        for row, start in zip(self.rows, tops, strict=False):
            above = max(_above(stack) for stack in row)
            for j, stack in enumerate(row):
                left_pt = 4.0 + sum(self.lefts[: j + 1]) + sum(self.widths[:j]) + 12.0 * j
                self._stack(stack, left_pt, start + above, float(self.widths[j]), handles)
        if self.keys:
            anchor = (1.0 - 8.0 / self.width, 1.0 - (top - 13.5 * key_rows - 1.0) / self.height)
            look: dict[str, Any] = {
                "loc": "upper right",
                "bbox_to_anchor": anchor,
                "ncols": columns,
                "frameon": False,
            }
            look |= {
                "borderaxespad": 0.0,
                "borderpad": 0.1,
                "handlelength": 1.8,
                "columnspacing": 1.2,
            }
            labels = [label for label in self.keys if label in handles]
            self.picture.legend(
                [handles[label] for label in labels], list(map(printable, labels)), **look
            )
        return self.picture

    def _write(self) -> None:
        text = self.picture.text
        y = 6.0
        for i, line in enumerate(self.head):
            look: dict[str, Any] = (
                {"weight": "bold", "fontsize": 10.5} if i == 0 else {"fontsize": 9}
            )
            text(8.0 / self.width, 1.0 - y / self.height, line, va="top", **look)
            y += _TITLE if i == 0 else 12.5
        if self.foot:
            look = {"fontsize": 7.5, "color": "#404040", "linespacing": 1.15}
            text(8.0 / self.width, 4.0 / self.height, "\n".join(self.foot), va="bottom", **look)

    def _stack(
        self, stack: Stack, left_pt: float, top: float, width: float, handles: dict[str, Any]
    ) -> None:
        for i, panel in enumerate(stack.panels):
            top += _SMALL if panel.title and i else 0.0
            height = 72.0 * panel.height_in
            box = (
                left_pt / self.width,
                1.0 - (top + height) / self.height,
                width / self.width,
                height / self.height,
            )
            axes = self.picture.add_axes(box)
            title = "\n".join(text for text in (stack.title * (i == 0), panel.title) if text)
            title = "\n".join(_fitting(line, width + 12.0) for line in split_lines(title))
            if title:
                loc = "left" if i or (panel.title and len(stack.panels) > 1) else "center"
                # At a given height: the automatic one measures every label of the panel.
                axes.set_title(title, fontsize=8, pad=3.5, y=1.0, loc=loc)
            draw_panel(axes, panel, last=i == len(stack.panels) - 1)
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(label, handle)
            top += height + 7.0


def _left_margin(stack: Stack) -> float:
    """Return the width at the left of the axes' labels and of their longest tick."""
    return max(
        13.0
        + _LABEL * len(split_lines(panel.y.label))
        + _DIGIT * max((len(name) for _, name in panel.y.ticks), default=1)
        for panel in stack.panels
    )


def _above(stack: Stack) -> float:
    first = stack.panels[0].title
    return (
        4.0
        + _SMALL * (len(split_lines(stack.title)) + bool(first))
        + 3.0 * bool(stack.title or first)
    )


def _tall(stack: Stack) -> float:
    titles = sum(bool(panel.title) for panel in stack.panels[1:])
    panels = sum(72.0 * panel.height_in + 7.0 for panel in stack.panels) + _SMALL * titles
    return (
        _above(stack) + panels + _TICK + _LABEL * len(split_lines(stack.panels[-1].x.label)) + 2.0
    )


def _key_rows(keys: Sequence[str], width: float) -> tuple[int, int]:
    """Return the number of rows and columns of the key."""
    if not keys:
        return 0, 1
    widest = 36.0 + 4.9 * max(map(len, keys))
    columns = max(1, min(len(keys), int((width - 16.0) / widest)))
    return math.ceil(len(keys) / columns), columns
