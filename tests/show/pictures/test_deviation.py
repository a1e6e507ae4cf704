"""The picture of the deviations where U is mostly common to all points: noise and common part apart."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.sample_results import table2

from vibrident.show.figures import deviation
from vibrident.show.media.charts import charts


def with_common(percent, degrees, *, told=True):
    """Deviations of some 0.01 % with a common U (k = 2) of so much, told apart from the noise or not."""
    made = table2()
    points, model, n = made.measured, made.response, len(made.measured.frequency_hz)
    noise, turn = 0.005e-2 * points.magnitude, np.full(n, 0.003)
    common, common_turn = percent / 200 * points.magnitude, np.full(n, degrees / 2)
    wave = np.cos(np.arange(n))
    measured = replace(
        points,
        magnitude_uncertainty=np.hypot(noise, common),
        phase_deg_uncertainty=np.hypot(turn, common_turn),
        deviation_percent=0.01 * wave,
        deviation_phase_deg=0.006 * wave,
        deviation_uncertainty_percent=np.full(n, 0.005),
        deviation_phase_uncertainty_deg=turn,
        **({"magnitude_noise": noise, "phase_deg_noise": turn} if told else {}),
    )
    curve = replace(
        model,
        magnitude_uncertainty=percent / 200 * model.magnitude,
        phase_deg_uncertainty=np.full(len(model.frequency_hz), degrees / 2),
    )
    return replace(made, measured=measured, response=curve)


def panels(result):
    return deviation(result).stacks[0].panels


@pytest.mark.parametrize("told", [True, False])
def test_no_band_fills_its_panel(told):
    for panel in panels(with_common(1.0, 0.5, told=told)):
        shown = [np.nanmedian(one.half) for one in panel.series if one.kind == "line" and one.half is not None]
        assert len(shown) == told
        assert panel.title
        assert all(half < panel.y.high for half in shown)


def test_noise_is_drawn_and_the_common_part_is_said():
    magnitude, phase = panels(with_common(1.0, 0.5))
    assert magnitude.title == "U common to all points (k = 2): 1.0 %"
    assert phase.title == "U common to all points (k = 2): 0.50 °"
    for panel, half in ((magnitude, 0.01), (phase, 0.006)):
        assert panel.series[0].band == "noise of the points, U (k = 2)"
        assert panel.series[0].half == pytest.approx(half)


def test_two_bands_of_one_picture_have_two_colours():
    """The noise around the magnitudes and the model's U around the phases are two entries of one key."""
    ((_, drawn),) = charts(deviation(with_common(1.0, 0.0005)))
    fills = {trace["name"]: trace["fillcolor"] for trace in drawn["data"] if "fillcolor" in trace}
    assert {*fills} == {"noise of the points, U (k = 2)", "model, U (k = 2)"}
    assert len({*fills.values()}) == 2


def test_where_noise_prevails_the_band_is_the_models():
    for panel in panels(with_common(0.001, 0.0005)):
        assert panel.title == ""
        assert panel.series[0].band == "model, U (k = 2)"
