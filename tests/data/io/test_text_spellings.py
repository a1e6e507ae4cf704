"""Numbers and times as people and programs spell them: read to the digit, or refused with line and column."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrident.data.io.columns import StartTime
from vibrident.data.io.formats.csv import CsvFile
from vibrident.data.io.plain_text import OVERFLOWS
from vibrident.data.io.stamps import parse_stamps

NS_2026 = 1_795_341_600_000_000_000  # 2026-11-22T10:00:00Z


@pytest.fixture(params=["light", "pandas"])
def _way(request, monkeypatch):
    """Small files are read without pandas where that is not loaded."""
    monkeypatch.setattr("vibrident.data.io.formats.csv.MAX_LIGHT_BYTES", 0 if request.param == "pandas" else 1 << 30)


def opened(tmp_path, content: str | bytes, name="x.csv") -> CsvFile:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return CsvFile(path)


def with_cell(cell: str, gap=",", rows=30) -> str:
    """Return a table whose row 21 has this cell in its last column."""
    lines = [f"0.{n:02d}{gap}1.5{gap}{cell if n == 20 else 2.5}" for n in range(rows)]
    return f"t{gap}a{gap}v\n" + "\n".join(lines) + "\n"


CELLS = {
    "1.0D+00": 1.0, "-2.5d-03": -2.5e-3, ".5D+2": 50.0, "\u22121.5": -1.5, "\u2212 1.5": -1.5, "+ 0.08": 0.08,
    "-  0.08": -0.08, "- 1.5E-2": -0.015, "1.5e\u22122": 0.015, "+.5": 0.5, "5.": 5.0, "1E5": 1e5,
    "\u221e": math.inf, "-\u221e": -math.inf, "\u2212\u221e": -math.inf, "+\u221e": math.inf, "Inf": math.inf,
    "-inf": -math.inf, "Infinity": math.inf, "1.#INF": math.inf, "-1.#INF": -math.inf, "NaN": math.nan,
    "OVLD": math.nan, "+OVLD": math.nan, "OL": math.nan, "-OL": math.nan, "+++++": math.nan, "-----": math.nan,
    "BURN OUT": math.nan, "Burnout": math.nan, "Overload": math.nan, "": math.nan, "N/A": math.nan,
    "*****": math.nan, "-1.#IND": math.nan,
}  # fmt: skip


@pytest.mark.usefixtures("_way")
@pytest.mark.parametrize("gap", [",", ";", "\t"])
@pytest.mark.parametrize("cell", CELLS)
def test_a_spelling_is_read(tmp_path, cell, gap):
    (values,) = opened(tmp_path, with_cell(cell, gap)).load([2])

    assert values.shape == (30,)
    np.testing.assert_array_equal(values[20], CELLS[cell])
    np.testing.assert_array_equal(np.delete(values, 20), 2.5)


@pytest.mark.usefixtures("_way")
@pytest.mark.parametrize("cell", [cell for cell in CELLS if cell and cell != "N/A"])
def test_a_spelling_is_read_between_blanks(tmp_path, cell):
    (values,) = opened(tmp_path, with_cell(cell, "  ")).load([2])
    np.testing.assert_array_equal(values[20], CELLS[cell])


@pytest.mark.parametrize("word", OVERFLOWS)
def test_an_overflow_is_refused_where_it_is_needed(tmp_path, refused, word):
    source = opened(tmp_path, with_cell(word.upper()))
    (values,) = source.load([2])
    source.require_finite(2, values[:20], 0, "repair")
    refused(lambda: source.require_finite(2, values[15:], 15, "repair"), where="line 22, column 3 ('v')")


def test_an_overflow_in_the_last_row_is_no_summary(tmp_path):
    values = opened(tmp_path, "a,v\n" + "1.5,2.5\n" * 9 + "OVLD,-\u221e\n").load([0, 1])
    np.testing.assert_array_equal(np.array(values)[:, -1], [np.nan, -np.inf])


TEXTS = ["high", "1d5", "3d2", "0x10", "1_000", "over there", "OLD", "1.5 V", "1,5", "1.5-", "--5", "+ +5", "1 2"]


@pytest.mark.usefixtures("_way")
@pytest.mark.parametrize("cell", TEXTS)
def test_other_text_is_an_error(tmp_path, refused, cell):
    source = opened(tmp_path, with_cell(cell, ";"))
    refused(lambda: source.load([2]), where="line 22, column 3 ('v')", found=repr(cell))


GROUPED = {
    "1,234.50": ";", "1.234,50": ";", "1 234,5": ";", "1'234.5": ",", "1,234,567": "\t", "1.234.567": ",",
    "-1,234.50": "  ", "1\u00a0234,5": ";",
}  # fmt: skip


@pytest.mark.parametrize("cell", GROUPED)
def test_separators_of_thousands_are_refused(tmp_path, refused, cell):
    gap = GROUPED[cell]
    content = f"t{gap}v\n" + "".join(f"{n}{gap}{cell}\n" for n in range(9))
    refused(lambda: opened(tmp_path, content).load([1]), problem="thousands", found=cell[-4:], where="line 2, column 2")
    np.testing.assert_array_equal(opened(tmp_path, content).load([0])[0], np.arange(9.0))


def test_quoted_numbers_with_separators_of_thousands_are_refused(tmp_path, refused):
    content = "t,v\n" + "".join(f'{n},"1,234.50"\n' for n in range(9))
    refused(lambda: opened(tmp_path, content).load([1]), problem="thousands", found="'1,234.50'", where="line 2")
    content = "v,w\n" + '"1,234.50","2,345.00"\n' * 9
    refused(lambda: opened(tmp_path, content), problem="thousands", found="'1,234.50'", where="line")


@pytest.mark.parametrize(("gap", "sign"), [(";", "."), (";", ","), ("\t", ".")])
def test_integers_with_separators_of_thousands_are_refused(tmp_path, refused, gap, sign):
    """12.345 and 678 were read as 12.345 and 678."""
    numbers = [f"{7919 * n % 40000 - 20000:,d}".replace(",", sign) for n in range(40)]
    content = f"t{gap}v\n" + "".join(f"{n}{gap}{number}\n" for n, number in enumerate(numbers))
    refused(lambda: opened(tmp_path, content), problem="thousands", where="line 2, column 2", found="-20")
    decimals = content.replace(f"{sign}000\n", f"{sign}5\n")  # of another number in a row
    assert opened(tmp_path, decimals).load([1])[0][0] == -20.5


@pytest.mark.usefixtures("_way")
def test_remarks_behind_some_rows_are_left_out(tmp_path):
    rows = [f"0.{n:02d}\t1.5\t{n}" + ("\tshaker on" if n in (0, 7) else "") for n in range(30)]
    source = opened(tmp_path, "t\ta\tv\tComment\n" + "\n".join(rows) + "\n")
    assert source.names == ("t", "a", "v")
    np.testing.assert_array_equal(source.load([2])[0], np.arange(30.0))


STAMPS = {
    "2026-11-22T10:00:00.125+01:00": NS_2026 + 125_000_000 - 3_600_000_000_000,
    "2026-11-22T10:00:00,125Z": NS_2026 + 125_000_000,
    "2026-11-22 10:00:00.125 UTC": NS_2026 + 125_000_000,
    "2026-11-22T10:00:00-0530": NS_2026 + 19_800_000_000_000,
    "2026/11/22 10:00:00.1234567899": NS_2026 + 123_456_789,
    "22.11.2026 10:00:00,5": NS_2026 + 500_000_000,
    "22.11.2026, 10:00:00": NS_2026,
    "11/22/2026 10:00:00.25 AM": NS_2026 + 250_000_000,
    "22/11/2026 10:00:00": NS_2026,
    "22-Nov-2026 10:00:00.5": NS_2026 + 500_000_000,
}
TIMES = {
    "1:05:03.250 PM": 47_103_250_000_000, "12:00:00 AM": 0, "12:30:00 pm": 45_000_000_000_000,
    "10:00:00.125": 36_000_125_000_000, "10:00:00,125": 36_000_125_000_000, "9:59:59": 35_999_000_000_000,
}  # fmt: skip


@pytest.mark.parametrize("stamp", [*STAMPS, *TIMES])
def test_a_stamp_states_the_start(tmp_path, stamp):
    gap = ";" if "," in stamp else ","
    source = opened(tmp_path, f"t{gap}v\n" + f"{stamp}{gap}1.5\n" * 9)
    assert source.in_seconds(0)
    np.testing.assert_array_equal(source.load([0])[0], np.zeros(9))
    assert source.start(0) == StartTime({**STAMPS, **TIMES}[stamp], epoch=stamp in STAMPS)
    assert source.start(1) is None


def test_stamps_pass_noon_and_midnight(tmp_path):
    source = opened(
        tmp_path, "t,v\n" + "".join(f"{t},1\n" for t in ("11:59:59.5 AM", "12:00:00.0 PM", "12:00:00.5 PM"))
    )
    np.testing.assert_array_equal(source.load([0])[0], [0.0, 0.5, 1.0])
    rows = ("11:59:59.5 PM", "12:00:00 AM", "", "12:00:00.5 AM")
    source = opened(tmp_path, "t,v\n" + "".join(f"{t},1\n" for t in rows))
    np.testing.assert_array_equal(source.load([0])[0], [0.0, 0.5, np.nan, 1.0])


SPLIT_STAMPS = {
    "date and time": ("2026-11-22,10:00:00.5,1.5\n", 1, NS_2026 + 500_000_000, True),
    "blanks": ("2026-11-22  10:00:00.5  1.5\n", 1, NS_2026 + 500_000_000, True),
    "AM between blanks": ("11/22/2026 10:00:00.5 AM 1.5\n", 1, NS_2026 + 500_000_000, True),
    "PM alone": ("10:00:00.5;PM;1.5\n", 0, 79_200_500_000_000, False),
}


@pytest.mark.parametrize("kind", SPLIT_STAMPS)
def test_date_and_time_in_two_columns_are_one_stamp(tmp_path, kind):
    row, position, ns, epoch = SPLIT_STAMPS[kind]
    source = opened(tmp_path, row * 9)
    assert source.in_seconds(position)
    assert source.start(position) == StartTime(ns, epoch=epoch)
    np.testing.assert_array_equal(source.load([position])[0], np.zeros(9))


BAD_STAMPS = {
    "two readings": (["03/04/2026 10:00:00", "03/04/2026 10:00:01"], "line 2", "3 Apr, or 4 Mar"),
    "no such day": (["2026-02-30 10:00:00"] * 2, "line 2", "2026-02-30"),
    "no such hour": (["10:00:00", "25:00:00"], "line 3", "25:00:00"),
    "13 PM": (["1:00:00 PM", "13:00:00 PM"], "line 3", "13:00:00 PM"),
    "text": (["10:00:00", "later"], "line 3", "later"),
    "a date in some": (["2026-11-22 10:00:00", "10:00:01"], "line 3", "'10:00:01'"),
    "before 1678": (["1066-10-14 10:00:00"] * 2, "line 2", "1066"),
    "month of 13": (["13/13/2026 10:00:00"] * 2, "line 2", "13/13/2026"),
}


@pytest.mark.parametrize("kind", BAD_STAMPS)
def test_a_stamp_without_one_reading_is_refused(tmp_path, refused, kind):
    stamps, where, found = BAD_STAMPS[kind]
    source = opened(tmp_path, "t,v\n" + "".join(f"{stamp},1\n" for stamp in stamps))
    refused(lambda: source.load([0]), where=where, found=found)


def test_one_day_above_12_tells_the_order_of_all():
    stamps = parse_stamps(["12/11/2026 23:59:59.5", "13/11/2026 00:00:00"], frozenset(), str)
    np.testing.assert_array_equal(stamps.elapsed_s, [0.0, 0.5])
    stamps = parse_stamps(["05/05/2026 10:00:00"], frozenset(), str)
    assert stamps.ns[0] == np.datetime64("2026-05-05T10:00:00", "ns").astype(np.int64)


DIALECTS = [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("  ", "."), ("  ", ",")]
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"]
RATES = [
    ("# sample_rate = 51200 Hz", 51200.0), ("Sampling rate: 10240Hz", 10240.0), ("# dt: 9.765625e-05 s", 10240.0),
    ("# fs = 12.8 kHz", 12800.0), ("", None),
]  # fmt: skip
finite = st.floats(allow_nan=False, allow_infinity=False, width=64)


@settings(derandomize=True, max_examples=150, deadline=None)
@given(
    rows=st.lists(st.tuples(finite, finite, finite), min_size=8, max_size=40),
    dialect=st.sampled_from(DIALECTS),
    encoding=st.sampled_from(ENCODINGS),
    rate=st.sampled_from(RATES),
    units=st.sampled_from([(), ("s", "m/s²", "mV"), ("second", "g", "Volt"), ("[ms]", "(g)", "[V]")]),
    end=st.sampled_from(["\n", "\r\n"]),
    spelling=st.sampled_from(["plain", "true minus", "Fortran", "blank behind the sign"]),
    last=st.sampled_from(["", "\x1a", "\n\n", "separators"]),
)
def test_a_table_reads_back_from_every_dialect(
    tmp_path_factory, rows, dialect, encoding, rate, units, end, spelling, last
):
    gap, decimal = dialect
    if spelling == "true minus" and encoding == "latin-1":
        encoding = "cp1252"

    def spelled(value: float) -> str:
        text = f"{value:.16E}".replace(".", decimal)
        if spelling == "true minus":
            return text.replace("-", "\u2013" if encoding == "cp1252" else "\u2212")
        if spelling == "Fortran":
            return text.replace("E", "D")
        if spelling == "blank behind the sign":
            return f"{'-' if text[0] == '-' else '+'} {text.lstrip('-')}"
        return text

    lines = [rate[0]] if rate[0] else []
    lines.append(gap.join(("time", "reference", "response")))
    lines += [gap.join(units)] if units else []
    lines += [gap.join(map(spelled, row)) for row in rows]
    tail = gap * 2 + end if last == "separators" and gap != "  " else last if last != "separators" else ""
    path = tmp_path_factory.mktemp("dialect") / "x.csv"
    path.write_bytes((end.join(lines) + end + tail).encode(encoding))

    for by_pandas in (True, False):
        with pytest.MonkeyPatch.context() as way:
            way.setattr("vibrident.data.io.formats.csv.MAX_LIGHT_BYTES", 0 if by_pandas else 1 << 30)
            source = CsvFile(path)
            assert source.names == ("time", "reference", "response")
            assert tuple(source.stated_unit(p) for p in range(3)) == (
                tuple(unit.strip("[]()") for unit in units) if units else ("", "", "")
            )
            assert [clock and clock.rate_hz for clock in map(source.clock, range(3))] == [rate[1]] * 3
            np.testing.assert_array_equal(np.column_stack(source.load([0, 1, 2])), np.array(rows))
