"""A chart of a sensitivity is shown on a logarithmic axis, a linear one, and in dB: the same curve."""

import numpy as np
import pytest
from tests.support.sample_results import table2

from vibrident.show.figures import sensitivity
from vibrident.show.media.charts import charts


def menu():
    ((_, drawn),) = charts(sensitivity(table2()))
    (choice,) = drawn["layout"]["updatemenus"]
    return drawn, choice, {one["label"]: one["args"][0] for one in choice["buttons"]}


def test_each_scale_says_what_it_shows_and_the_present_one_is_marked():
    drawn, choice, kinds = menu()
    assert [*kinds] == ["log", "linear", "dB"]
    present = drawn["layout"]["yaxis"].get("type", "linear")
    assert [*kinds][choice["active"]] == {"log": "log", "linear": "linear"}[present]
    assert "dB re 1 mV/(m/s²)" in kinds["dB"]["yaxis.title.text"]
    assert "dB" not in kinds["log"]["yaxis.title.text"]
    assert kinds["linear"]["yaxis.title.text"] == kinds["log"]["yaxis.title.text"]


def test_the_ticks_of_the_levels_are_20_lg_of_where_they_stand():
    _, _, kinds = menu()
    levels = kinds["dB"]
    assert levels["yaxis.type"] == "log"
    names = [float(text.replace("−", "-")) for text in levels["yaxis.ticktext"]]
    assert len(names) >= 3
    assert 20 * np.log10(levels["yaxis.tickvals"]) == pytest.approx(names, abs=1e-9)
    assert levels["yaxis.range"] == kinds["log"]["yaxis.range"]
    low, high = kinds["linear"]["yaxis.range"]
    assert kinds["log"]["yaxis.range"] == pytest.approx([np.log10(low), np.log10(high)])


def test_costs_and_deviations_have_no_levels():
    from vibrident.show.figures import deviation

    ((_, drawn),) = charts(deviation(table2()))
    assert "updatemenus" not in drawn["layout"]
