"""Page of the study: how often the package was right, warned, or was wrong without a word."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy.stats import beta

from bench.adversary.judge import (
    ALARM,
    BAD,
    IMPACT_TOLERANCE,
    MAX_DISTANCE_U,
    REFUSED,
    RIGHT,
    ROUNDING_ERROR,
    SILENT,
    TRACEBACK,
    WARNED,
)
from vibrident.show.media import markdown

CLASSES = (RIGHT, WARNED, REFUSED, SILENT, ALARM, TRACEBACK)
Row = tuple[str, ...]
MAX_LISTED = 400  # most failures that are listed by name
HEAD = """# Sensors, motions and defects from a simulator of its own

Written by `python -m bench.adversary`; do not edit. {runs} of {cases} cases, in an order by chance;
code of commit {commit}. `python -m bench.adversary` runs the rest, and `--jobs` says in how many
processes.

An exact simulator, which shares no code with the package's estimators or its own simulation, makes
recordings of a sensor: the transfer function tone by tone on a grid of tones below half the
sampling rate, free motion from the poles, bent springs by harmonic balance;
`tests/bench/test_adversary.py` holds it against an integrator of order eight. Each case draws the
sensor's place against the band (below, in, at the end of, above, far above), its damping (0.001 to
3), sign and gain (1e-9 to 1e9), the sampling rate (100 Hz to 1 MHz) and the quantity of the
reference from its own seed. `clean`: nothing is wrong, noise of fourteen kinds. `defect`: one thing
is wrong with the recordings, or with one of them. `lacking`: the sensor has what the model asked
for lacks, or its spring bends; a sensor of two modes has the static sensitivity of both. `table`:
tabulated responses. `several`: two or three defects at once. `foreign`: no recording of the sensor
asked for (noise, the response of another measurement, one that is rectified or runs backwards):
nothing that is stated of it is true. `decay`: free decays. `extreme`: scales from 1e-150 to 1e150,
one to sixty records of 100 to 100 000 samples, records of few periods, declared systematic effects.
`file`: time columns in many units, and rates that contradict them. What the other groups draw
stands at the end of the page.

- **right**: every stated parameter within {limit:g} standard uncertainties of the truth, and on
  clean data no warning.
- **warned**: a parameter is further off, and a warning is there that a person would heed: any but
  `polarity`; `weakly_determined` and `at_bound` only for the parameters that their message names.
- **refused**: the data are refused with what is wrong.
- **silent-wrong**: a stated parameter is further off, without such a warning. Target: 0.5 % of the
  cases.
- **false alarm**: a warning, or a refusal, where nothing is wrong. `polarity` of a negative gain,
  and `weakly_determined` or `at_bound` of a parameter whose stated uncertainty is above 0.9 %, are
  true and do not count; nor does `short_record` below two periods, or `reference_noise` where there
  is such noise. Target: 1 % of the clean cases.
- **traceback**: anything but a result or a refusal. Target: none.

A distance in standard uncertainties of few degrees of freedom is that of a normal variable as
improbable as Student's. Errors below {rounding:g} of the truth count as none. A parameter without a
stated uncertainty claims nothing.
"""


def table(lines: list[dict[str, Any]], commit: str) -> str:
    """Return the page as Markdown."""
    from bench.adversary.cases import CASES
    from bench.adversary.groups import sections

    outcomes = [
        {"name": line["cell"], "run": run, **outcome}
        for line in lines
        for run, outcome in enumerate(line["runs"], line["first"])
    ]
    head = HEAD.format(
        runs=len(outcomes),
        cases=len(CASES),
        commit=commit,
        limit=MAX_DISTANCE_U,
        rounding=ROUNDING_ERROR,
    )
    parts = [head, *_verdict(outcomes)]
    clean = [outcome for outcome in outcomes if outcome["name"].startswith("clean/")]
    parts += _counted("By group", "group", outcomes, _name_part(0))
    parts += _counted("Clean recordings by motion", "motion", clean, _name_part(2))
    parts += _counted("Clean recordings by sensor", "sensor", clean, _name_part(1))
    parts += _counted("Clean recordings by noise", "noise", clean, _name_part(3))
    parts += _counted(
        "Defects by cause",
        "cause",
        [outcome for outcome in outcomes if outcome["cause"]],
        lambda outcome: outcome["cause"],
    )
    return "\n".join(
        [*parts, *_impacts(outcomes), *_scatter(outcomes), *_failures(outcomes), *sections(), ""]
    )


def _name_part(number: int) -> Callable[[dict[str, Any]], str]:
    """Return what stands at this place of a case's name; the last place takes the rest."""
    return lambda outcome: outcome["name"].split("/", 3)[number]


def _verdict(outcomes: list[dict[str, Any]]) -> list[str]:
    clean = [outcome for outcome in outcomes if outcome["clean"]]
    rows = [
        _rate("silent-wrong", outcomes, SILENT, "0.5 %", 0.005),
        _rate("silent-wrong on clean cases", clean, SILENT, "0.5 %", 0.005),
        _rate("false alarms on clean cases", clean, ALARM, "1 %", 0.01),
        _rate("tracebacks", outcomes, TRACEBACK, "none", 0.0),
    ]
    return [
        "## Against the targets",
        "",
        markdown.table(
            ("", "cases", "rate", "95 % between", "target", ""), rows, right=(1, 2, 3, 4)
        ),
        "",
    ]


def _rate(what: str, among: list[dict[str, Any]], kind: str, target: str, limit: float) -> Row:
    count = sum(outcome["class"] == kind for outcome in among)
    total = max(len(among), 1)
    low = 100.0 * float(beta.ppf(0.025, count, total - count + 1)) if count else 0.0
    high = 100.0 * float(beta.ppf(0.975, count + 1, total - count)) if count < total else 100.0
    verdict = "met" if count <= limit * total else "**NOT met**"
    return (
        what,
        f"{count} of {total}",
        f"{100 * count / total:.2f} %",
        f"{low:.2g} to {high:.2g} %",
        target,
        verdict,
    )


def _counted(
    title: str, label: str, outcomes: Iterable[dict[str, Any]], key: Callable[[dict[str, Any]], str]
) -> list[str]:
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for outcome in outcomes:
        counts[key(outcome)][outcome["class"]] += 1
    rows = [
        (
            name,
            str(sum(class_counts.values())),
            *(str(class_counts[kind] or "") for kind in CLASSES),
        )
        for name, class_counts in sorted(counts.items())
    ]
    return [
        f"## {title}",
        "",
        markdown.table((label, "cases", *CLASSES), rows, right=range(1, 2 + len(CLASSES))),
        "",
    ]


def _impacts(outcomes: list[dict[str, Any]]) -> list[str]:
    """Return how often what a warning says of the worst parameter is so."""
    impacts = [
        outcome["impact"]
        for outcome in outcomes
        if outcome.get("impact") and math.isfinite(outcome["impact"]["off"])
    ]
    if not impacts:
        return []
    rows = []
    for code in (None, *sorted({outcome["code"] for outcome in impacts})):
        signs = [outcome["true"] for outcome in impacts if code in (None, outcome["code"])]
        rows.append(
            (
                f"`{code}`" if code else "all",
                str(len(signs)),
                f"{100 * sum(signs) / len(signs):.0f} %",
            )
        )
    far = [outcome["true"] for outcome in impacts if abs(outcome["off"]) > MAX_DISTANCE_U]
    if far:
        rows.insert(
            1,
            (
                f"of them more than {MAX_DISTANCE_U:g} u off",
                str(len(far)),
                f"{100 * sum(far) / len(far):.0f} %",
            ),
        )
    return [
        "## Whether the impact is true",
        "",
        "Defects that a departure names, where the model explains the data: is the parameter that "
        "it moves most as far",
        "from where the same recordings without the defect lead to as the warning says, within "
        f"{100 * IMPACT_TOLERANCE:.0f} % or one standard uncertainty? Target: 80 %.",
        "",
        markdown.table(("warning", "cases", "true"), rows, right=(1, 2)),
        "",
    ]


def _scatter(outcomes: list[dict[str, Any]]) -> list[str]:
    """Describe the spread of the distances of clean cases.

    A normal variable's are below 1, 2, 3 in 68, 95, 99.7 %.
    """
    clean = [
        outcome for outcome in outcomes if outcome["clean"] and outcome["class"] in (RIGHT, SILENT)
    ]
    z = np.array([value for outcome in clean for value in outcome["z"].values()])
    if not z.size:
        return []
    shares = ", ".join(f"{100 * float(np.mean(z <= k)):.1f} % within {k}" for k in (1, 2, 3, 4))
    text = (
        f"Clean cases without a warning, {z.size} stated parameters: "
        f"{shares} standard uncertainties."
    )
    return ["## How far from the truth", "", text, ""]


def _failures(outcomes: list[dict[str, Any]]) -> list[str]:
    failed = sorted(
        (outcome for outcome in outcomes if outcome["class"] in BAD),
        key=lambda outcome: (outcome["class"], outcome["name"]),
    )
    rows = [
        (
            outcome["class"],
            f"`{outcome['name']}`{_run(outcome)}",
            _worst(outcome),
            _printed(outcome),
        )
        for outcome in failed[:MAX_LISTED]
    ]
    more = [f"… and {len(failed) - MAX_LISTED} more.", ""] if len(failed) > MAX_LISTED else []
    return [
        "## What failed",
        "",
        "`python -m bench.adversary --show NAME` runs one again.",
        "",
        markdown.table(("", "case", "furthest off", "said"), rows),
        "",
        *more,
    ]


def _run(outcome: dict[str, Any]) -> str:
    return f", run {outcome['run']}" if outcome["run"] else ""


def _worst(outcome: dict[str, Any]) -> str:
    if not outcome.get("z"):
        return "–"
    name, value = max(outcome["z"].items(), key=lambda item: item[1])
    return f"{name} {value:.3g} u" if value < 1e12 else f"{name}, u = 0"


def _printed(outcome: dict[str, Any]) -> str:
    if outcome["class"] == TRACEBACK:
        return outcome["says"][0].splitlines()[0][:80].replace("|", "\\|")
    return ", ".join(f"`{code}`" for code in outcome["codes"]) or "–"
