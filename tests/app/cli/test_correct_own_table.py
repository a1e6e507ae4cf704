"""`vibrident correct` on a table of the user's own: the same table with acceleration and u as columns."""

import numpy as np
import pandas as pd
import pytest
from bench.laboratory import RATE_HZ, TRUE, records, response
from tests.support import shell

import vibrident
from vibrident.data.records import Calibration, Circumstances


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A result, and a signal of the sensor with the motion behind it."""
    folder = tmp_path_factory.mktemp("known")
    made = records(np.random.default_rng(1), TRUE, Circumstances(), (80.0, 160.0, 480.0, 800.0, 960.0))
    result = vibrident.identify(Calibration(tuple(made)), "accelerometer").save(folder / "result.json")
    times = np.arange(2048) / RATE_HZ
    motion = 5.0 * np.exp(2j * np.pi * 160.0 * times)
    return result, times, np.imag(motion), np.imag(motion * response(160.0, **TRUE))


def corrected(known, path, *more):
    done = shell.run("correct", known[0], path, "--out", path.parent / "out", "--no-pictures", *more)
    assert done.exit_code == 0, done.output
    return path.parent / "out" / path.name


def check(known, acceleration, u):
    middle = slice(400, -400)
    rms = np.sqrt(np.mean((np.array(acceleration)[middle] - known[2][middle]) ** 2))
    assert rms < 0.05
    assert np.all(np.array(u)[middle] > 0)


def test_a_german_csv_keeps_what_it_held(known, tmp_path):
    _, times, _, signal = known
    rows = [
        f"{t:.9f};{v:.7f};Bemerkung {n}".replace(".", ",") for n, (t, v) in enumerate(zip(times, signal, strict=True))
    ]
    path = tmp_path / "mess.csv"
    path.write_text("Messung vom 3. März\nZeit [s];Spannung [V];Text\n" + "\n".join(rows) + "\n", encoding="latin-1")
    out = corrected(known, path, "--column", "Spannung [V]", "--time", "1").read_text(encoding="latin-1").splitlines()
    assert out[0] == "Messung vom 3. März"
    assert out[1] == "Zeit [s];Spannung [V];Text;acceleration;acceleration_standard_uncertainty"
    assert [line.rsplit(";", 2)[0] for line in out[2:]] == rows
    numbers = np.array([[float(cell.replace(",", ".")) for cell in line.split(";")[-2:]] for line in out[2:]])
    check(known, *numbers.T)


@pytest.mark.needs("parquet")
def test_parquet(known, tmp_path):
    _, times, _, signal = known
    table = pd.DataFrame({"v": 1e3 * signal, "who": ["me"] * times.size})
    table.to_parquet(tmp_path / "t.parquet")
    path = corrected(known, tmp_path / "t.parquet", "--column", "v", "--rate", RATE_HZ, "--scale", 1e-3)
    out = pd.read_parquet(path)
    assert out["v"].equals(table["v"])
    assert out["who"].equals(table["who"])
    check(known, out["acceleration"], out["acceleration_standard_uncertainty"])


@pytest.mark.needs("excel")
def test_excel(known, tmp_path):
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["t / s", "v / V", "note"])
    for row in zip(known[1].tolist(), known[3].tolist(), ["=1+1"] * 2048, strict=True):
        sheet.append(row)
    book.create_sheet("other")["A1"] = "kept"
    book.save(tmp_path / "t.xlsx")
    out = openpyxl.load_workbook(corrected(known, tmp_path / "t.xlsx", "--column", "v / V"))  # the times by their name
    rows = list(out.worksheets[0].iter_rows(values_only=True))
    assert rows[0][:4] == ("t / s", "v / V", "note", "acceleration")
    assert rows[1][2] == "=1+1"
    before = openpyxl.load_workbook(tmp_path / "t.xlsx").worksheets[0].iter_rows(values_only=True)
    assert [row[:3] for row in rows] == list(before)
    assert out["other"]["A1"].value == "kept"
    check(known, [row[3] for row in rows[1:]], [row[4] for row in rows[1:]])


@pytest.mark.parametrize(("more", "said"), [((), "--column"), (("--column", "w"), "w"), (("--column", "v"), "--time")])
def test_what_is_missing_is_said(known, tmp_path, more, said):
    (tmp_path / "t.csv").write_text("v,acceleration\n" + "".join(f"{v!r},1\n" for v in known[3][:64].tolist()))
    done = shell.run("correct", known[0], tmp_path / "t.csv", "--out", tmp_path / "out", *more)
    assert done.exit_code == 2
    assert said in done.output
    assert not (tmp_path / "out").exists()
    twice = shell.run(
        "correct", known[0], tmp_path / "t.csv", "--out", tmp_path / "out", "--column", "v", "--rate", RATE_HZ
    )
    assert twice.exit_code == 2
    assert "already" in twice.output


@pytest.mark.parametrize(
    ("heading", "more", "words"),
    [
        ("t,q (pC)", (), "set --scale to V per pC"),
        ("t,v (V)", ("--rate", 3), "remove or correct --rate"),
        ("t,v", ("--time", "nope"), "asked for by --time"),
        ("t,v (mV)", ("--scale", 1e-3), "remove --scale"),
    ],
)
def test_a_message_names_options_and_no_calibration_file(heading, more, words, known, tmp_path):
    rows = [f"{t!r},{v!r}\n" for t, v in zip(known[1][:64].tolist(), known[3][:64].tolist(), strict=True)]
    path = tmp_path / "t.csv"
    path.write_text(heading + "\n" + "".join(rows))
    done = shell.run("correct", known[0], path, "--out", tmp_path / "out", "--column", 2, *more)
    assert done.exit_code == 2
    assert words in done.output
    for absent in ("calibration file", "[sampling]", "[response]", "rate_hz", "⟦"):
        assert absent not in done.output
