import io
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as MatplotlibFigure
from matplotlib.image import imread
from tests.support.sample_results import CALIBRATIONS, SAMPLES, table2, table_only, troubled

import vibrident
from vibrident.show import figures, plots, use_figures
from vibrident.show.curves import from_start
from vibrident.show.media import drawing
from vibrident.use.correction.acceleration import ORIGINS


def drawn(figure):
    figure.draw_without_rendering()  # a warning is an error here
    return figure


def check_labels(figure):
    for axes in figure.axes:
        assert axes.get_ylabel(), "a y axis has no label"
        if axes.xaxis.get_tick_params().get("labelbottom", True):
            assert axes.get_xlabel(), "an x axis has no label"
    for axes in figure.axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            named = ("in ", "(dimensionless)", "Number of", "Loss", "Iteration", "Record", "")
            assert label == "" or any(part and part in label for part in named), f"no unit in {label!r}"


def check_inside(figure):
    """Nothing sticks out of the figure: no clipped title, label, note or legend."""
    box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert box.x0 > -0.02
    assert box.y0 > -0.02
    assert box.x1 < width + 0.02
    assert box.y1 < height + 0.02


@pytest.mark.parametrize("picture", plots.PICTURES)
@pytest.mark.parametrize("sample", SAMPLES)
def test_every_picture_of_every_result(sample, picture):
    figure = drawn(plots.draw(picture, SAMPLES[sample]()))
    check_labels(figure)
    check_inside(figure)


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_every_inspection(name):
    figure = drawn(drawing.picture(plots.inspection(CALIBRATIONS[name]())))
    check_labels(figure)
    check_inside(figure)


def test_long_names_of_records_and_sensors_run_into_nothing():
    """Titles beside each other keep apart, and the serial number, which comes last, is there."""
    result = table2()
    names = [f"a folder of a very long name/measurement of the sensor, run {i:03d}" for i in range(6)]
    signals = tuple(replace(one, record=name) for one, name in zip(result.signals, names, strict=False))
    sensor = {"manufacturer": 20 * "Maker ", "type": 10 * "kind ", "serial_number": "0123456789"}
    figure = drawn(plots.draw("signals", replace(result, signals=signals, sensor=sensor)))
    titles = [axes.title.get_window_extent() for axes in figure.axes if axes.get_title()]
    assert len(titles) == 6
    assert not any(a.overlaps(b) for i, a in enumerate(titles) for b in titles[:i])
    assert all("run 00" in axes.get_title() for axes in figure.axes if axes.get_title())
    assert any("0123456789" in text.get_text() for text in figure.texts)
    check_inside(figure)


def test_labels_carry_the_units_of_the_result():
    upper, lower = plots.draw("sensitivity", table2()).axes
    assert "mV/(m/s²)" in upper.get_ylabel()
    assert "acceleration" in upper.get_ylabel()
    assert "°" in lower.get_ylabel()
    assert "lag negative" in lower.get_ylabel()
    assert lower.get_xlabel() == "Frequency in Hz"


def test_sensitivity_names_sensor_model_and_warnings():
    figure = plots.draw("sensitivity", troubled())
    text = " ".join([*(t.get_text() for t in figure.texts), figure.get_supxlabel()])
    for word in ("accelerometer+delay", "MSV 3000", "4711", "k = 2"):
        assert word in text
    text = " ".join(text.split())
    assert all(code.replace("_", " ") in text for code in troubled().warning_codes)


def test_bars_and_band_are_two_standard_uncertainties():
    result = table2()
    axes = plots.draw("sensitivity", result).axes[0]
    band = axes.collections[0].get_paths()[0].get_extents()
    top = max(
        1e3 * (m + 2 * u) for m, u in zip(result.response.magnitude, result.response.magnitude_uncertainty, strict=True)
    )
    assert band.y1 == pytest.approx(top, rel=1e-9)
    segments = axes.containers[0].lines[2][0].get_segments()
    u = 1e3 * np.array(result.measured.magnitude_uncertainty)
    np.testing.assert_allclose([s[1][1] - s[0][1] for s in segments], 4 * u, rtol=1e-9)


def test_measured_phase_lies_on_the_turn_of_the_model():
    lower = plots.draw("sensitivity", SAMPLES["single_point"]()).axes[1]
    model, measured = (
        next(float(line.get_ydata()[0]) for line in lower.lines if line.get_marker() == marker) for marker in ("s", "o")
    )
    assert model == pytest.approx(-178.0)
    assert measured == pytest.approx(-181.0)


def test_only_pictures_with_content_are_saved(tmp_path):
    written = plots.save_all(table_only(), tmp_path / "new", formats=("png", "svg", "pdf"))
    assert sorted(path.name for path in written) == sorted(
        f"{name}.{suffix}" for name in ("sensitivity", "deviation", "residuals") for suffix in ("png", "svg", "pdf")
    )
    assert all(path.stat().st_size > 1000 for path in written)
    assert b"/Subtype /Type0" in (tmp_path / "new" / "sensitivity.pdf").read_bytes()  # TrueType, embedded
    nothing = SAMPLES["nothing_measured"]()
    assert all(make(table2()) for make in plots.PICTURES.values())
    assert [name for name, make in plots.PICTURES.items() if make(nothing)] == ["sensitivity"]


@pytest.mark.parametrize("suffix", ["svg", "pdf", "png"])
def test_same_result_same_file(tmp_path, suffix):
    files = [plots.save(plots.draw("deviation", table2()), tmp_path / f"{i}.{suffix}").read_bytes() for i in range(2)]
    assert files[0] == files[1]


def test_the_loss_breaks_where_the_weights_change():
    run = replace(table2().training, weighting_changes=(3,))
    (stack,) = figures.training(replace(table2(), training=run)).stacks
    loss = stack.panels[0]
    assert [len(part.x) for part in loss.series] == [3, len(run.loss) - 3]
    assert [place for place, _ in loss.marks] == [2.5]
    assert "weights of the residual change" in figures.training(replace(table2(), training=run)).caption
    (whole,) = figures.training(table2()).stacks
    assert len(whole.panels[0].series) == 1
    assert whole.panels[0].marks == ()


def test_an_identification_says_where_its_weights_change():
    found = vibrident.identify(
        vibrident.simulate("paper", frequencies_hz=[100.0, 400.0, 700.0], seed=4), estimator="ipnn"
    )
    changes = set(found.training.weighting_changes)
    assert changes
    jumps = np.flatnonzero(np.diff(found.training.loss) > 1e-9 * np.array(found.training.loss[1:])) + 1
    assert set(jumps) <= changes


def test_times_of_a_clock_that_counts_from_an_epoch_are_shown_from_the_start():
    time = 1.7e9 + np.linspace(0.0, 0.5, 101)
    shown, label = from_start(time)
    assert shown[0] == 0.0
    assert shown[-1] == pytest.approx(500.0, rel=1e-6)
    assert label == "Time from 1700000000 s in ms"
    assert from_start(np.linspace(1.0, 3.0, 101))[1] == "Time in s"


def test_a_correction_shows_every_origin_of_its_uncertainty():
    assert tuple(use_figures._ORIGINS) == ORIGINS


@pytest.mark.parametrize("face", ["white", (1.0, 1.0, 1.0, 0.5)])
def test_a_png_shows_what_matplotlib_saves_and_leaves_the_figure_as_it_was(face):
    figure = MatplotlibFigure(figsize=(2.0, 1.0), dpi=77, facecolor=face)
    canvas = FigureCanvasAgg(figure)
    figure.add_axes((0.2, 0.2, 0.7, 0.7)).plot([0.0, 1.0], [0.0, 1.0])
    saved, ours = io.BytesIO(), io.BytesIO(drawing.content(figure, "png"))
    with drawing.styled():
        figure.savefig(saved, format="png")
    saved.seek(0)
    expected, found = imread(saved), imread(ours)
    assert np.array_equal(found[..., :3], expected[..., :3])
    assert (figure.canvas, figure.get_dpi()) == (canvas, 77)
