"""A package adds a departure by an object of the built-in ones' class."""

import re
from pathlib import Path

import numpy as np
from tests.support.random_record import calibration, motion

import vibrident
from vibrident.fit.departures.departure import Departure
from vibrident.fit.registry import DEPARTURES


def knock(time_s):
    """At 0.15 s, 2 ms wide."""
    return np.exp(-0.5 * ((time_s - 0.15) / 2e-3) ** 2)


class Burst(Departure):
    """A knock at a known time."""

    name, code, pooled = "burst", "drift", False

    def columns(self, group, scale):
        yield "knocks", group.bins_of(scale.motion * knock(group.time_s))[:, None]

    def sentence(self, candidate, score):
        return "somebody knocks"


def test_it_is_looked_for_beside_the_others(monkeypatch):
    every = {**DEPARTURES.all(), "burst": Burst()}
    monkeypatch.setattr(DEPARTURES, "all", lambda: every)
    u, y = motion(np.random.default_rng(7))
    result = vibrident.identify(calibration(u, y + 0.02 * np.max(y) * knock(np.arange(y.size) / 20e3)))
    assert any("Somebody knocks" in f.message for f in result.findings)
    assert not any("Somebody knocks" in f.message for f in vibrident.identify(calibration(u, y)).findings)


def test_the_example_of_the_docs_finds_crosstalk(monkeypatch):
    page = (Path(__file__).parents[3] / "docs" / "plug-ins.md").read_text(encoding="utf-8")
    (source,) = [code for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "Crosstalk" in code]
    names = {}
    exec(source, names)
    every = {**DEPARTURES.all(), "crosstalk": names["CROSSTALK"]}
    monkeypatch.setattr(DEPARTURES, "all", lambda: every)
    u, y = motion(np.random.default_rng(8))
    result = vibrident.identify(calibration(u, y + 1e-3 * u))
    assert any("holds the reference itself" in finding.message for finding in result.findings)
