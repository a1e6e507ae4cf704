from dataclasses import replace

import pytest
from rich.console import Console
from tests.support.sample_results import S0, SAMPLES, pickup, table2, table_only, troubled

from vibrident.base.settings import python_word, rendered
from vibrident.lab.history.tables import all_due
from vibrident.show import terminal, words
from vibrident.show.media.console import on_console
from vibrident.show.methods import compared, planned
from vibrident.show.rows import table_of


def printed(renderable, width=100):
    console = Console(width=width, force_terminal=False, color_system=None)
    with console.capture() as capture:
        console.print(renderable)
    lines = capture.get().splitlines()
    assert all(len(line) <= width for line in lines)
    return "\n".join(lines)


@pytest.mark.parametrize("width", [80, 100])
@pytest.mark.parametrize("sample", SAMPLES)
def test_summary_prints_every_number_in_full(sample, width):
    text = printed(terminal.summary(SAMPLES[sample]()), width)
    assert "Fit: rmse" in text
    assert "…" not in text.replace(" … ", "")
    for code in SAMPLES[sample]().warning_codes:
        assert f"({code})" in text


def test_summary_of_table2():
    text = printed(terminal.summary(table2(), ["out/result.json", "out/report.md"]))
    row = next(line for line in text.splitlines() if line.strip().startswith("sensitivity"))
    assert row.split() == ["sensitivity", "104.04", "0.11", "0.21", "mV/(m/s²)", "103.83", "…", "104.25"]
    assert "derived from these" in text
    assert "interval" not in printed(terminal.summary(table2()), 70)
    assert "adequate" in text
    assert "Written: out/result.json\n         out/report.md" in text


def test_warnings_in_plain_words():
    text = " ".join(printed(terminal.summary(troubled()), 10_000).split())
    for code in troubled().warning_codes:
        assert words.explain(code).title in text
        assert rendered(words.explain(code).action, python_word).replace("`", "") in text
    assert "cubic stiffness (weakly determined)" in text
    assert "(not identifiable) (u not stated)" in text
    assert "not adequate" in text


def test_weights_are_the_papers_table_1():
    text = printed(terminal.weights_table(table2()))
    rows = [line.split()[0] for line in text.splitlines() if line.strip()]
    assert [row for row in rows if row.startswith("W") and row != "Weights"] == ["W1", "W2", "W3", "W4"]
    assert "C (I + Ts A)⁻¹" in text
    assert "0.98412" in text


@pytest.mark.parametrize("width", [80, 100, 140])
def test_compare(width):
    lsm = table_only()
    lower = replace(lsm.parameters["sensitivity"], value=S0 * 0.99)
    lsm = replace(lsm, model="accelerometer+delay", parameters={**lsm.parameters, "sensitivity": lower}, settings={})
    text = printed(on_console(*compared([table2(), lsm])), width)
    assert "104.04(11)" in text
    assert "−1.0 %" in text
    assert "deviation from ipnn" in text
    assert "0.84" in text  # time of the one that states it
    truth = {"sensitivity": S0, "delay": 0.0}
    text = printed(on_console(*compared([table2(), lsm], ["network", "least squares"], truth)), width)
    assert "+0.030 %" in text
    assert "+12.4" in text  # no relative deviation from zero
    assert "the true value" in text
    assert "network" in text


def test_compare_across_models_and_repeats():
    text = printed(on_console(*compared([table2(), table2(), pickup()])), 120)
    assert "#1" in text
    assert "#2" in text
    assert "velocity-pickup" in text
    assert "generator constant" in text


@pytest.mark.parametrize("width", [60, 80, 100])
def test_columns_without_room_go_below_and_no_number_is_cut_off(width):
    results = [table2() for _ in range(7)]
    text = printed(on_console(*compared(results, [f"ipnn accelerometer+delay {i}" for i in range(7)])), width)
    assert text.count("104.04(11)") == 7
    assert "(continued)" in text
    starts = [line for line in text.splitlines() if line.strip().startswith("sensitivity")]
    assert len(starts) > 1


def test_a_table_of_rows():
    rows = [
        {"record": "[bold]a.csv", "frequency_hz": 12.589254, "samples": 10240, "clipped": False, "notes": ["x", "y"]},
        {"record": "b", "frequency_hz": None, "extra": 1},
    ]
    text = printed(on_console(table_of(rows)))
    assert "[bold]a.csv" in text
    assert "/ Hz" in text
    assert "12.589" in text
    assert "no" in text
    assert "x, y" in text
    assert "–" in text
    assert printed(on_console(table_of([]))) is not None


def test_a_table_of_rows_of_many_columns_fits():
    rows = [
        {
            "record": f"shaker_{i:02d}.csv",
            "excitation": "sine",
            "frequency_hz": 12.589254 * 1.26**i,
            "rate_hz": 51200.0,
            "samples": 10240,
            "duration_s": 0.2 + i,
            "reference_rms": 6.9345 + i,
            "response_rms": 0.70712,
            "clipped": i == 3,
            "notes": "drift" if i == 2 else None,
        }
        for i in range(5)
    ]
    text = printed(on_console(table_of(rows)), 80)
    for word in ("9.9345", "yes", "drift", "shaker_04.csv", "12.589", "excitation sine", "rate 51200 Hz"):
        assert word in text


def test_a_plan_states_u_to_two_digits_and_values_to_its_place():
    from vibrident.use.planning import Recording, plan

    sensor = {"sensitivity": 0.1, "natural_frequency": 652.0, "damping_ratio": 0.18}
    frequencies = [20.0, 80.0, 200.0, 400.0, 650.0, 900.0]
    recording = Recording(12800.0, 4000, response_noise=0.01)
    table = planned(plan("accelerometer", sensor, frequencies_hz=frequencies, recording=recording))
    text = printed(terminal.on_console(table), 80)
    for name, value, u, *_ in table.rows:
        assert len(u.replace(".", "").lstrip("0")) == 2, name
        assert len(value.partition(".")[2]) == len(u.partition(".")[2]), name
        assert f"{value}" in text


@pytest.mark.parametrize("width", [80, 100, 120])
def test_words_of_headings_are_whole_beside_long_sentences(width):
    why = "the drift is not known: fewer than three calibrations count, and of these two are of one day"
    row = {"serial_number": "ACS_001", "type": "MSV 3000", "calibrations": 12, "last": "2025-03-31", "date": ""}
    row |= {"why": why, "by_interval": "2026-03-31", "by_staircase": "2026-09-30", "risk_today": 0.01, "axis": ""}
    text = printed(on_console(all_due([row, row])), width)
    assert all(word in text.split() for word in ("serial", "calibrations", "risk", "interval", "staircase", "today"))
