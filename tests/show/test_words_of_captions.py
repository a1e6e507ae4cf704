"""Formulas in the captions of pictures are set, as they are our own words."""

import vibrident
from vibrident.show import report


def test_the_phase_convention_is_set_as_a_formula():
    result = vibrident.identify(vibrident.simulate("paper", frequencies_hz=[200, 400, 600, 800], samples=512))
    for page in (result._repr_html_(), report.content(result, "html").decode()):
        assert "e<sup>jωt</sup>" in page
        assert "e^{jωt}" not in page


def test_a_comparison_sets_it_too():
    made = [
        vibrident.identify(vibrident.simulate("paper", frequencies_hz=[200, 400, 800], samples=512, seed=s))
        for s in (1, 2)
    ]
    page = report.content(made, "html", names=["a", "b"]).decode()
    assert "e<sup>jωt</sup>" in page
    assert "e^{jωt}" not in page
