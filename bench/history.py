"""Statistics of a sensor's history on simulated lives, with drift, jumps and noise.

python -m bench.history                 2000 lives a row; writes the table into studies/history.md
python -m bench.history --lives 50      a trial; prints the table alone
"""

from __future__ import annotations

import argparse
import datetime
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.publish import put_between
from vibrident.lab.history import control
from vibrident.lab.history.life import DAYS_A_YEAR, Entry, Event, Life, life, years_between
from vibrident.show.media import markdown

DOCUMENT = Path(__file__).parents[1] / "studies" / "history.md"
LIVES = 2000
WIDTH = "width"
NOISE_U = 0.002  # relative standard uncertainty of a calibration's noise
REFERENCE_U = 0.005  # relative standard uncertainty of the shared reference


@dataclass(frozen=True)
class Kind:
    """A population of sensors; sizes in units of the noise of one calibration.

    Attributes:
        name: in the table.
        line: standard deviation of the steady drift, a year.
        walk: standard deviation of the random walk after a year.
        jump: standard deviation of a jump at a repair; zero for none.
        untold: the same of a jump that was not entered.
        calibrations: fewest and most before the one that is predicted.
    """

    name: str
    line: float = 0.0
    walk: float = 0.0
    jump: float = 0.0
    untold: float = 0.0
    calibrations: tuple[int, int] = (3, 10)


KINDS = (
    Kind("drift, random walk, jump at a repair, and noise", 0.5, 0.5, 5.0),
    Kind("still"),
    Kind("steady drift, as large as the noise in a year", 1.0),
    Kind("steady drift, five times that", 5.0),
    Kind("random walk, as large as the noise in a year", 0.0, 1.0),
    Kind("random walk, five times that", 0.0, 5.0),
    Kind("steady drift and random walk", 1.0, 1.0),
    Kind("still, jump at a repair", jump=5.0),
    Kind("still, jump that nobody entered", untold=20.0),
    Kind("drift and random walk, two calibrations", 0.5, 0.5, calibrations=(2, 2)),
    Kind("drift and random walk, ten calibrations", 0.5, 0.5, calibrations=(10, 10)),
)


@dataclass(frozen=True)
class Simulated:
    """A life without its last calibration, which is predicted.

    Attributes:
        entries: the calibrations before.
        events: entered.
        truth: of the sensor at the date of the last one.
        last: that calibration.
    """

    entries: list[Entry]
    events: list[Event]
    truth: float
    last: Entry


def simulated(kind: Kind, rng: np.random.Generator) -> Simulated:
    """Draw a life.

    In half of all lives the reference is calibrated anew halfway, and has another error then.
    """
    count = int(rng.integers(kind.calibrations[0], kind.calibrations[1] + 1)) + 1
    gaps = rng.uniform(0.7, 2.2, count - 1)
    years = np.concatenate([[0.0], np.cumsum(gaps)])
    steps = rng.normal(size=count - 1) * np.sqrt(gaps) * kind.walk
    truth = kind.line * rng.normal() * years + np.concatenate([[0.0], np.cumsum(steps)])
    events = []
    dates = [
        datetime.date(2000, 1, 1) + datetime.timedelta(days=round(DAYS_A_YEAR * year))
        for year in years
    ]
    if (kind.jump or kind.untold) and count > 3:
        at = int(rng.integers(1, count - 1))
        truth[at:] += rng.normal() * (kind.jump or kind.untold)
        if kind.jump:
            events.append(Event(1, "repaired", dates[at] - datetime.timedelta(days=30)))
    values = 1.0 + NOISE_U * truth
    anew = count // 2 if rng.random() < 0.5 else count
    errors = REFERENCE_U * rng.normal(size=2)
    entries = []
    for i in range(count):
        second = i >= anew
        read = values[i] * (1 + errors[int(second)]) + NOISE_U * rng.normal()
        shared = {f"gain|reference {1 + second}|{REFERENCE_U:.2g}|": REFERENCE_U * read}
        entries.append(
            Entry(
                i,
                dates[i],
                read,
                float(np.hypot(NOISE_U, REFERENCE_U * read)),
                "V",
                None,
                shared,
                f'["{i}"]',
            )
        )
    return Simulated(entries[:-1], events, float(values[-1]), entries[-1])


def measured(kind: Kind, lives: int, seed: int) -> dict[str, float]:
    """Statistics of so many lives."""
    rng = np.random.default_rng(seed)
    figures = []
    for _ in range(lives):
        sensor = simulated(kind, rng)
        lived = life(sensor.entries, sensor.events)
        if lived.drift is not None:
            figures.append(
                (*_covered(lived, sensor), len(lived.breaks), *_agreeing(lived), _alarms(lived))
            )
    columns = np.array(figures, dtype=float).T
    names = ("sensor", "reading", WIDTH, "breaks", "en", "ordinary", "alarm")
    means = dict(zip(names, np.nanmean(columns, axis=1), strict=True))
    return means | {WIDTH: float(np.median(columns[2]))}


def _covered(lived: Life, sensor: Simulated) -> Iterator[float]:
    """Yield whether sensor and next calibration lie within their 95 %, and U over the noise."""
    assert lived.drift is not None
    at = years_between(sensor.entries[0].date, sensor.last.date)
    low, high = lived.drift.sensitivity(at).interval_95
    yield low <= sensor.truth <= high
    shared = np.array(
        [
            sum(u * e.shared.get(key, 0.0) for key, u in sensor.last.shared.items())
            for e in lived.entries
        ]
    )
    low, high = lived.drift.reading(at, shared, float(sensor.last.u or 0.0)).interval_95
    yield low <= float(sensor.last.value or 0.0) <= high
    yield (high - low) / 2 / (2 * NOISE_U)


def _agreeing(lived: Life) -> tuple[float, float]:
    """Share of neighbours that agree, by E_n with and without what they share."""
    agreements = [lived.agreement(i) for i in range(1, len(lived.entries))]
    if not agreements:
        return np.nan, np.nan
    return tuple(
        float(np.mean([abs(getattr(a, n) or 0.0) <= 1 for a in agreements]))
        for n in ("correlated", "ordinary")
    )


def _alarms(lived: Life) -> float:
    if len(lived.entries) < 2 or lived.breaks:
        return np.nan
    residuals = control.recursive_residuals(lived.value, lived.covariance)
    return float(
        any(chart.alarm for chart in control.charts(residuals, np.arange(residuals.size) == 0))
    )


def table(lives: int) -> str:
    """Return the study as a Markdown table."""
    lead = (
        f"{lives} lives a row; noise {100 * NOISE_U:g} %, reference {100 * REFERENCE_U:g} % (in "
        "half of the lives calibrated anew halfway); 3 to 10 calibrations, 0.7 to 2.2 years apart, "
        "unless said otherwise."
    )
    heads = ("sensors", "next calibration within its 95 %", "sensor within its 95 %")
    heads += (
        "median U of the next calibration, in U of its noise",
        "E_n within ±1",
        "ordinary E_n within ±1",
    )
    heads += ("new series a life", "EWMA or CUSUM alarm")
    rows = []
    for number, kind in enumerate(KINDS):
        figures = measured(kind, lives, number)
        shares = (f"{100 * figures[name]:.1f} %" for name in ("reading", "sensor"))
        agreeing = (f"{100 * figures[name]:.0f} %" for name in ("en", "ordinary"))
        last_cells = (f"{figures['breaks']:.3f}", f"{100 * figures['alarm']:.1f} %")
        rows.append((kind.name, *shares, f"{figures[WIDTH]:.1f}", *agreeing, *last_cells))
    return f"{lead}\n\n{markdown.table(heads, rows, range(1, len(heads)))}"


def main(arguments: list[str] | None = None) -> int:
    """Run the study; write it into the documentation where it is a whole one."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.history", description="Statistics of simulated lives."
    )
    parser.add_argument(
        "--lives",
        type=int,
        default=LIVES,
        help="lives a row; the page is written from the default on",
    )
    lives = parser.parse_args(arguments).lives
    text = table(lives)
    print(text)
    if lives >= LIVES:
        put_between(DOCUMENT, "study", text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
