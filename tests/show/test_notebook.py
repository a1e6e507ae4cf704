"""What a notebook shows of a result and of a sensor: a table and the curve, text of others as text."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from tests.support.exported import CASES, paper, result

NASTY = "<script>alert(1)</script>"


def shown(html: str) -> str:
    """The text of a fragment, without pictures."""
    return re.sub(r"<[^>]+>", " ", re.sub(r'src="[^"]*"', "", html))


def test_a_result_shows_its_parameters_its_verdict_and_one_curve():
    html = paper()._repr_html_()
    assert html.count("data:image/svg+xml;base64,") == 1
    for word in ("sensitivity", "natural frequency", "damping ratio", "U (k = 2)", "95 % interval", "Fit:"):
        assert word in shown(html)


@pytest.mark.parametrize("name", ["paper", "coil", "everything"])
def test_a_sensor_shows_its_values_as_its_result_does(name):
    one = result(*CASES[name])
    html = one.to_sensor()._repr_html_()
    assert html.count("data:image/svg+xml;base64,") == 1
    rows = re.findall(r"<tr><td[^>]*>([^<]*)</td><td[^>]*>([^<]*)</td><td[^>]*>([^<]*)</td>", one._repr_html_())
    own = re.findall(r"<tr><td[^>]*>([^<]*)</td><td[^>]*>([^<]*)</td><td[^>]*>([^<]*)</td>", html)
    assert len(own) == len(one.to_sensor().values)
    assert set(own) <= set(rows)


def test_text_of_others_is_text():
    html = replace(paper(), sensor={"type": NASTY}, response_unit=NASTY)._repr_html_()
    assert "<script" not in html
    assert "alert(1)" in html
    assert "<script" not in replace(paper().to_sensor(), response_unit=NASTY)._repr_html_()


def test_the_representation_of_a_sensor_states_values_with_u_and_no_arrays():
    sensor = paper().to_sensor()
    text = repr(sensor)
    assert text.startswith("<Sensor accelerometer: sensitivity=")
    assert text.count(" ± ") == 3
    assert "array" not in text
    assert len(text) < 300
