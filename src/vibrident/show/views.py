"""View models: what is shown, said once for every medium. Text is plain; renderers escape it.

Formulas are set in ``formulas.Words`` alone.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Okabe & Ito (2008), distinguishable with all common kinds of colour vision
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
ORANGE = "#E69F00"
SKY = "#56B4E9"
PURPLE = "#CC79A7"
BLACK = "#000000"
GREY = "#767676"

K = 2.0  # coverage factor of every band and bar
MAX_POINTS_WITH_BARS = (
    200  # more points than this are drawn without bars, which would hide everything else
)


Marker = Literal["", "o", "s", "^", "D", "v", "x", "."]


# Text and tables


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    title: str  # what it holds
    # a ``number`` is set flush right; a ``share`` is a percentage, with a bar behind it where the
    # medium can
    kind: Literal["text", "number", "share"] = "text"
    unit: str = ""  # of its numbers, ready for print
    # omitted in a narrow terminal, because other columns hold the same information
    spare: bool = False

    @property
    def heading(self) -> str:
        """Return the title with the unit: ``magnitude / (mV/(m/s²))``."""
        if not self.unit:
            return self.title
        unit = f"({self.unit})" if "/" in self.unit else self.unit
        first, *second = self.title.split("\n")
        return "\n".join([f"{first} / {unit}", *second]) if self.title else unit


def columns(*titles: str, kind: Literal["text", "number"] = "text") -> tuple[Column, ...]:
    """Return columns of one kind."""
    return tuple(Column(title, kind) for title in titles)


@dataclass(frozen=True)
class Table:
    """Cells as text, and what is said before and after them."""

    columns: tuple[Column, ...]  # what each column holds
    # as many cells each as there are columns. A row whose first cell is empty belongs to the row
    # above
    rows: tuple[tuple[str, ...], ...]
    lead: tuple[str, ...] = ()  # paragraphs before the table
    notes: tuple[str, ...] = ()  # paragraphs after it
    title: str = ""  # heading, where the table has one of its own
    groups: dict[int, str] = field(default_factory=dict)  # number of a row to the words above it
    doubtful: tuple[int, ...] = ()  # numbers of rows that deserve a second look
    quoted: tuple[int, ...] = ()  # numbers of rows whose values are somebody else's; set in italics
    # number of a row to the address that its first cell leads to, where the medium has links
    links: dict[int, str] = field(default_factory=dict)
    name: str = ""  # short name, for an anchor or a mark in a document

    @property
    def header(self) -> tuple[str, ...]:
        """Return the headings of the columns."""
        return tuple(column.heading for column in self.columns)

    @property
    def right(self) -> tuple[int, ...]:
        """Return the numbers of the columns that are set flush right."""
        return tuple(j for j, column in enumerate(self.columns) if column.kind != "text")

    def select(self, keep: tuple[int, ...]) -> Table:
        """Return the table with these columns only."""
        rows = tuple(tuple(row[j] for j in keep) for row in self.rows)
        selected = tuple(self.columns[j] for j in keep)
        return replace(self, columns=selected, rows=rows)

    def telling(self) -> Table:
        """Return the table without empty columns; the first one is kept."""
        keep = (
            j
            for j in range(len(self.columns))
            if j == 0 or not self.rows or any(row[j] for row in self.rows)
        )
        return self.select(tuple(keep))


@dataclass(frozen=True)
class Sentence:
    """A paragraph with a bold ``lead``, and an ``end`` in the colour of its kind."""

    text: str
    kind: Literal["plain", "note", "fine", "doubt"] = "plain"
    lead: str = ""
    end: str = ""


Fact = tuple[str, str | None]  # a name and a text; None is a blank to fill


@dataclass(frozen=True)
class Facts:
    """Names and texts."""

    rows: tuple[Fact, ...]
    title: str = ""


@dataclass(frozen=True)
class Signatures:
    """Lines to sign on: what for, and by whom."""

    rows: tuple[Fact, ...]


@dataclass(frozen=True)
class Card:
    """A main number of the result: its name, value and uncertainty."""

    label: str
    value: str
    below: str


@dataclass(frozen=True)
class Cards:
    """Cards beside each other."""

    cards: tuple[Card, ...]


@dataclass(frozen=True)
class Doubt:
    """A warning for a person: title and code, the messages, what it means, what to do."""

    title: str
    code: str
    messages: tuple[str, ...]
    meaning: str
    action: str
    remedy: str = "What to do:"  # what stands before the action


# Curves


@dataclass(frozen=True)
class Look:
    """Style of a line or a mark."""

    colour: str
    dash: Literal["solid", "dashed", "dotted", "dashdot"] = "solid"
    width: float = 1.4
    marker: Marker = ""


MODEL = Look(BLUE)
MEASURED = Look(VERMILION, marker="o")
#: Of several lines: every pair differs without colour too.
LINES = (
    Look(BLUE, marker="o"),
    Look(VERMILION, "dashed", marker="s"),
    Look(GREEN, "dashdot", marker="^"),
    Look(BLACK, "dotted", marker="D"),
    Look(PURPLE, "dashed", marker="v"),
    Look(ORANGE, "dashdot", marker="s"),
    Look(SKY, "dotted", marker="x"),
)


def band_colour(look: Look) -> str:
    """Return the colour of the band around a line: sky around blue and black, else the line's."""
    return SKY if look.colour in (BLUE, BLACK) else look.colour


@dataclass(frozen=True, eq=False)
class Series:
    """A line, cloud, band or bars in a panel."""

    x: FloatArray  # shape (points,)
    y: FloatArray  # shape (points,)
    label: str = ""  # for the key; empty for no entry
    look: Look = MODEL  # colour, dash and mark
    # a line, marks, marks on stems, or columns around x
    kind: Literal["line", "points", "stems", "columns"] = "line"
    # half width of a line's band or half lengths of the bars, shape (points,); None for neither
    half: FloatArray | None = None
    band: str = ""  # what the band is called in the key
    texts: tuple[str, ...] = ()  # text of each point, beside its label
    names: tuple[str, ...] = ()  # record of each point


@dataclass(frozen=True)
class Axis:
    """Limits of an axis and the labels of its ticks; ``axes`` makes them."""

    label: str
    low: float
    high: float
    ticks: tuple[tuple[float, str], ...] = ()
    log: bool = False
    dates: bool = False
    levels: bool = False  # whether its values, which are positive, may be shown in dB


@dataclass(frozen=True, eq=False)
class Panel:
    """A drawing that shares x with those above and below it."""

    x: Axis  # axis below the last panel
    y: Axis  # axis at the left
    series: tuple[Series, ...]  # what is drawn
    height_in: float = 1.8  # in print, inches
    title: str = ""  # above the panel
    rules: tuple[float, ...] = ()  # values of y at which a line runs across
    marks: tuple[tuple[float, str], ...] = ()  # values of x at which a line runs down, with words
    empty: str = ""  # text shown if there is nothing to draw
    square: bool = False  # one unit is as long in x as in y


@dataclass(frozen=True, eq=False)
class Stack:
    """Panels above each other; ``width`` is relative to that of stacks beside it."""

    panels: tuple[Panel, ...]
    title: str = ""
    width: float = 1.0


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture."""

    name: str  # of its file, without suffix
    title: str  # what is shown
    # beside each other; where ``choice`` is set, one can be chosen where the medium allows it, and
    # a few are drawn where it does not
    stacks: tuple[Stack, ...]
    subject: str = ""  # model and sensor
    caption: str = ""  # what is drawn, and how to read it
    note: str = ""  # text in a figure that is shown alone
    choice: bool = False  # the stacks are alike, one a record
    across: int = 0  # stacks in a row; zero: all of them, or what fits where there is a choice
    width_in: float = 0.0  # in print, inches; zero: by the number of stacks in a row


# Documents


@dataclass(frozen=True)
class Folded:
    """Content behind a line that opens it, where the medium can fold."""

    summary: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Gallery:
    """Small pictures or lists, as many beside each other as there is room for."""

    blocks: tuple[Block, ...]


Block = Sentence | Facts | Signatures | Cards | Doubt | Table | Figure | Gallery | Folded


@dataclass(frozen=True, eq=False)
class Section:
    """A titled part; ``name`` is its anchor."""

    name: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Letterhead:
    """The head of a document that is issued."""

    lines: tuple[str, ...]  # who issues it; empty for a blank
    number: str | None  # None is a blank
    subject: str  # on each page, beside the title
    foot: str  # below each page
    date: datetime.date | None  # of the document
    # of the frame: page, no, laboratory, place_and_date
    words: dict[str, str] = field(default_factory=dict)
    logo: str = ""  # SVG, PNG or JPEG in base64


@dataclass(frozen=True, eq=False)
class Document:
    """A document: title, head, and sections that are not empty."""

    title: str
    head: tuple[Block, ...]
    sections: tuple[Section, ...]
    letterhead: Letterhead | None = None
    draft: str = ""  # across each page
    language: str = "en"
    second_language: str = ""


def section(name: str, title: str, *blocks: Block | None) -> Section:
    """Return a section of the blocks that are not None."""
    return Section(name, title, tuple(block for block in blocks if block is not None))


def document(title: str, head: tuple[Block, ...], sections: list[Section]) -> Document:
    """Return a document of the sections that are not empty."""
    return Document(title, head, tuple(section for section in sections if section.blocks))


def listed(length: int, most: int) -> int:
    """Return how many entries to show: all, or ``most`` if more than one would be left out."""
    return length if length <= most + 1 else most


def count(number: int, noun: str) -> str:
    """Return a number with its noun: ``1 point``, ``2 points``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def capitalised(text: str) -> str:
    """Return a text with its first letter in upper case, the others unchanged."""
    return text[:1].upper() + text[1:]
