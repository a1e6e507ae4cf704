"""One look for all pictures: print and grayscale first, Okabe-Ito colours, no pyplot, no change of backend.

Matplotlib is loaded when the first picture is drawn. Its settings are the library's defaults plus ours inside
``styled()`` and the user's own again after it.
"""

from __future__ import annotations

import math
import textwrap
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vibrident.plots.units import sensor_name
from vibrident.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe & Ito (2008), told apart by all common kinds of colour vision
BLUE, VERMILION, GREEN, ORANGE = "#0072B2", "#D55E00", "#009E73", "#E69F00"
SKY, PURPLE, BLACK, GREY = "#56B4E9", "#CC79A7", "#000000", "#767676"

#: Colour, line style and marker of each of several lines: every pair differs without colour too.
LINES: tuple[tuple[str, Any, str], ...] = (
    (BLUE, "-", "o"),
    (VERMILION, "--", "s"),
    (GREEN, "-.", "^"),
    (BLACK, ":", "D"),
    (PURPLE, (0, (5, 1, 1, 1, 1, 1)), "v"),
    (ORANGE, (0, (8, 2)), "P"),
    (SKY, (0, (3, 1, 1, 1)), "X"),
)

#: Coverage factor of every band and bar.
K = 2.0

_SETTINGS: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
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
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "grid.color": "#d9d9d9",
    "grid.linewidth": 0.5,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "lines.linewidth": 1.4,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "#bfbfbf",
    "legend.fancybox": False,
    "text.parse_math": False,  # a "$" in a sensor's name is a "$"
    "pdf.fonttype": 42,  # TrueType, embedded
    "ps.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "vibrident",  # same result, same file
}
#: Compression of a PNG: the usual one takes three times as long for a seventh less.
LITTLE = 2
_UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "ps": {"CreationDate": None}}

_FINE, _COARSE = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), (1.0, 2.0, 5.0)  # labelled steps of a logarithmic decade

_LOCK = threading.RLock()  # matplotlib's settings belong to the whole process
FloatArray = NDArray[np.float64]


@contextmanager
def styled() -> Iterator[None]:
    """Draw with the shared settings; the process has its own again afterwards."""
    import matplotlib.style

    with _LOCK, matplotlib.style.context(["default", {**_SETTINGS, "font.sans-serif": _fonts()[0]}]):
        yield


def new_figure(width_in: float = 6.7, height_in: float = 4.8) -> Figure:
    """Return an empty figure with an Agg canvas of its own; sizes in inches (6.7 in fits an A4 text column)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> Path:
    """Write a figure in the format of the path's suffix (png, svg, pdf), without a date; return the path."""
    kind = path.suffix[1:].lower()
    options: dict[str, Any] = {"metadata": _UNDATED.get(kind)}
    if kind == "png":
        options["pil_kwargs"] = {"compress_level": LITTLE}
    with styled():
        _laid_out(figure)
        figure.savefig(path, **options)
    return path


def _laid_out(figure: Figure) -> None:
    """Give every axes its place for good: ``savefig`` would draw the whole figure once more for that."""
    import matplotlib

    if engine := figure.get_layout_engine():
        figure.set_dpi(matplotlib.rcParams["savefig.dpi"])
        engine.execute(figure)
        figure.set_layout_engine(None)


def printable(text: str) -> str:
    """One line in which each character that the fonts here lack is a □ (drawing it would warn)."""
    known = _fonts()[1]
    return "".join(c if ord(c) in known else "□" for c in " ".join(text.split()))


_FONTS: list[tuple[list[str], set[int]]] = []


def _fonts() -> tuple[list[str], set[int]]:
    """Families to draw with (DejaVu Sans, then what is installed for other scripts) and the characters they have."""
    if not _FONTS:
        from matplotlib.font_manager import fontManager
        from matplotlib.ft2font import FT2Font

        wanted = ("DejaVu Sans", "Noto Sans CJK SC", "Noto Sans CJK JP", "Microsoft YaHei", "PingFang SC", "SimHei")
        files = {font.name: font.fname for font in reversed(fontManager.ttflist) if font.name in wanted}
        families = [name for name in wanted if name in files]
        _FONTS.append((families, {code for name in families for code in FT2Font(files[name]).get_charmap()}))
    return _FONTS[0]


def head(figure: Figure, subject: str, result: Result) -> None:
    """Write what is shown, and under it the model and the sensor."""
    title(figure, subject, result.model, result.sensor)


def title(figure: Figure, subject: str, model: str, sensor: Any) -> None:
    """Write what is shown, and under it the model and the sensor, cut where they are too long for the figure."""
    from matplotlib.transforms import ScaledTranslation

    parts = (f"model {model}" if model else "", sensor_name(sensor))
    below = _wrapped(" · ".join(part for part in parts if part), int(13 * figure.get_figwidth()), 2)
    # empty lines of the title reserve the room that the smaller lines take
    figure.suptitle(subject + "\n" * len(below), x=0.012, ha="left", weight="bold")
    under = figure.transFigure + ScaledTranslation(0.0, -18.0 / 72.0, figure.dpi_scale_trans)
    figure.text(0.012, 1.0, "\n".join(below), transform=under, ha="left", va="top", fontsize=9, linespacing=1.35)


def note(figure: Figure, *lines: str) -> None:
    """Write small print under the picture, wrapped to its width; empty lines are left out."""
    width = int(15.5 * figure.get_figwidth())
    text = "\n".join(part for line in lines if line for part in _wrapped(line, width, 4))
    if text:
        figure.supxlabel(text, x=0.012, ha="left", fontsize=7.5, color="#404040")


def _wrapped(text: str, width: int, lines: int) -> list[str]:
    return textwrap.wrap(printable(text), width, max_lines=lines, placeholder=" …")


def shortened(text: str, width: int) -> str:
    """A name that fits: its end is kept, because the names of records differ there."""
    text = printable(text)
    return text if len(text) <= width else "…" + text[1 - width :]


def empty(axes: Axes, words: str) -> None:
    """Say in the middle of an axes why it shows nothing."""
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", color="#404040")
    axes.grid(False)
    axes.tick_params(which="both", left=False, bottom=False, labelleft=False, labelbottom=False)


def numbers(values: Sequence[float | None]) -> FloatArray:
    """Values as an array, None as NaN; shape (values,)."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


#: More points than this are drawn as fine dots without bars.
CROWD = 500


def marks(points: int) -> dict[str, Any]:
    """Marker and error-bar settings for that many points: open circles with caps, fine dots for a crowd."""
    if points <= 80:
        return {"marker": "o", "markersize": 4.2, "markerfacecolor": "white", "elinewidth": 1.0, "capsize": 2.2}
    if points <= CROWD:
        return {"marker": "o", "markersize": 2.4, "markerfacecolor": "white", "elinewidth": 0.6, "capsize": 0}
    return {"marker": ".", "markersize": 2.2, "elinewidth": 0.3, "capsize": 0, "rasterized": True}


def frequency_axis(axes: Axes, frequency_hz: FloatArray, *, label: bool = True) -> None:
    """Scale, limits and tick labels (``1 k``) of a frequency axis; logarithmic where the band is wider than 2:1."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if label:
        axes.set_xlabel("Frequency in Hz")
    usable = frequency_hz[np.isfinite(frequency_hz) & (frequency_hz > 0)]
    if usable.size == 0:
        return
    low, high = float(usable.min()), float(usable.max())
    if high / low < 1.001:
        low, high = low / math.sqrt(10), high * math.sqrt(10)
    if high / low > 2:
        axes.set_xscale("log")
        margin = (high / low) ** 0.03
        axes.set_xlim(low / margin, high * margin)
        decades = math.log10(high / low)
        if decades <= 3.4:
            axes.xaxis.set_major_locator(LogLocator(subs=_FINE if decades <= 1 else _COARSE, numticks=30))
        else:
            axes.xaxis.set_major_locator(LogLocator(numticks=max(4, min(13, math.ceil(decades) + 2))))
        axes.xaxis.set_minor_formatter(NullFormatter())
    else:
        margin = 0.04 * (high - low)
        axes.set_xlim(low - margin, high + margin)
    axes.xaxis.set_major_formatter(FuncFormatter(_plain_tick(thousands=True)))


def size_axis(axes: Axes, values: FloatArray, low: FloatArray | None = None, high: FloatArray | None = None) -> None:
    """Scale, limits and ticks of an axis of positive sizes: logarithmic where they span more than 3:1.

    Args:
        axes: its y axis is set.
        values: what must be in view.
        low: ends of the bars and bands, in view as far as a factor of two beyond the values.
        high: as low.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    usable = values[np.isfinite(values) & (values > 0)]
    if usable.size == 0:
        return
    smallest, largest = float(usable.min()), float(usable.max())
    bottom = max(_extreme(low, np.nanmin, smallest), smallest / 2)
    top = min(_extreme(high, np.nanmax, largest), largest * 2)
    if largest / smallest > 3:
        axes.set_yscale("log")
        margin = (top / bottom) ** 0.06
        axes.set_ylim(bottom / margin, top * margin)
        decades = math.log10(top / bottom)
        subs = _FINE if decades <= 1 else _COARSE if decades <= 2.5 else (1.0,)
        axes.yaxis.set_major_locator(LogLocator(subs=subs, numticks=30 if decades <= 2.5 else 9))
        axes.yaxis.set_major_formatter(FuncFormatter(_plain_tick() if decades <= 4 else _power_tick))
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        margin = 0.08 * (top - bottom) or 0.05 * top
        axes.set_ylim(bottom - margin, top + margin)


def _extreme(values: FloatArray | None, pick: Callable[..., Any], otherwise: float) -> float:
    if values is None or not np.isfinite(values).any():
        return otherwise
    return float(pick([pick(values[np.isfinite(values)]), otherwise]))


def _plain_tick(*, thousands: bool = False) -> Callable[[float, int | None], str]:
    def text(value: float, _position: int | None) -> str:
        if thousands and value >= 1e6:
            return f"{value / 1e6:g} M"
        if thousands and value >= 1e3:
            return f"{value / 1e3:g} k"
        return f"{value:g}".replace("-", "−")

    return text


def _power_tick(value: float, _position: int | None) -> str:
    digits = str(round(math.log10(value))).translate(str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"))
    return f"10{digits}"


def balanced_axis(axes: Axes, values: FloatArray, bars: FloatArray, floor: float) -> None:
    """Limits of a deviation axis: zero in view, bars in view as far as they do not dwarf the values.

    Args:
        axes: its y axis is set.
        values: deviations.
        bars: half lengths of the bars; NaN where there is none.
        floor: least half range, so that rounding noise does not look like a deviation.
    """
    usable = values[np.isfinite(values)]
    reach = float(np.abs(usable).max()) if usable.size else 0.0
    longest = np.abs(values) + np.where(np.isfinite(bars), bars, 0.0)
    longest = longest[np.isfinite(longest)]
    if longest.size:
        reach = max(reach, min(float(longest.max()), 4 * reach + 4 * float(np.median(longest))))
    reach = max(reach, floor)
    axes.set_ylim(-1.12 * reach, 1.12 * reach)
