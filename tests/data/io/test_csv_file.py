"""The CSV reader: every usual layout reads to the same numbers; every damage is named with file, line and column."""

import math

import numpy as np
import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrident.data.io.formats.csv import CsvFile

ROWS = [(0.0, 1.5, -2.25), (0.5, 2.5, 3.0e-3), (1.0, -1.0, 12.75), (1.5, 0.25, 1e10)]


@pytest.fixture(params=["light", "pandas"])
def _way(request, monkeypatch):
    """Small files are read without pandas."""
    monkeypatch.setattr("vibrident.data.io.formats.csv.MAX_LIGHT_BYTES", 0 if request.param == "pandas" else 1 << 30)


def opened(tmp_path, content: str | bytes, name: str = "x.csv") -> CsvFile:
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return CsvFile(path)


def text(delimiter=",", decimal=".", header="t,ref,resp\n", end="\n", form="{!r}", after="") -> str:
    lines = [delimiter.join(form.format(v).replace(".", decimal) for v in row) + after for row in ROWS]
    return (header.replace(",", delimiter) if header else "") + end.join(lines) + end


LAYOUTS = {
    "comma": text(),
    "semicolon": text(";"),
    "tab": text("\t"),
    "blanks": text("   "),
    "leading blanks": text("  ", header="  t  ref  resp\n").replace("\n", "\n   "),
    "semicolon, decimal comma": text(";", ","),
    "tab, decimal comma": text("\t", ","),
    "blanks, decimal comma": text("  ", ","),
    "comma and blank": text(", "),
    "byte order mark": "\ufeff" + text(),
    "carriage returns": text(end="\r\n").replace("resp\n", "resp\r\n"),
    "plus signs": text(form="{:+}"),
    "quoted numbers": text(form='"{!r}"'),
    "quoted numbers, decimal comma": text(";", ",", form='"{!r}"'),
    "quoted names": text(header='"t","ref","resp"\n'),
    "trailing separators": text(after=",", header="t,ref,resp,\n"),
    "trailing separators, not in the header": text(after=","),
    "trailing blanks": text("\t", after="  "),
    "units row": text(header="t,ref,resp\ns,m/s^2,V\n"),
    "units row in brackets": text(header="t,ref,resp\n[s],[m/s²],(mV)\n"),
    "blank line under units": text(header="t,ref,resp\ns,m/s^2,V\n\n"),
    "comments": "# made by hand\n% on a Tuesday, at 5 o'clock\n" + text(),
    "names in the last comment": text(header="# a file\n# t,ref,resp\n"),
    "preamble": "Rate:,51200\nOperator:,N.N.\n" + text(),
    "blank lines at the end": text() + "\n" * 5000,
    "blank lines between": text().replace("\n0.5", "\n\n  \n0.5"),
    "rows of separators at the end": text() + ",,\r\n" * 5000,
    "end mark": text() + "\x1a",
    "end mark of a sector": text() + "\x1a" + "\0" * 500,
    "end mark and more": text("\t") + "\r\n\x1a\x1a\x1a\n",
    "UTF-16": text().encode("utf-16"),
    "UTF-16, big end first": "\ufeff".encode("utf-16-be") + text(";", ",").encode("utf-16-be"),
    "UTF-16 without a mark": text("\t").encode("utf-16-le"),
    "UTF-16 without a mark, big end first": text("\t", end="\r\n").encode("utf-16-be"),
    "UTF-16, an end mark": (text() + "\x1a").encode("utf-16"),
    "true minus": text().replace("-", "\u2212"),
    "true minus, decimal comma": text(";", ",").replace("-", "\u2212"),
    "a dash of Windows for a minus": text().replace("-", "\u2013").encode("cp1252"),
    "blanks behind the signs": text(form="{:+}").replace("+", "+ ").replace("-", "-  ").replace("e+ ", "e+"),
    "blanks behind the signs, between blanks": text("   ", form="{:+}")
    .replace("+", "+ ")
    .replace("-", "- ")
    .replace("e+ ", "e+"),
    "exponents of Fortran": text("  ", form="{:.17E}").replace("E", "D"),
    "exponents of Fortran, true minus": text(form="{:.17E}").replace("E", "D").replace("-", "\u2212"),
    "no final line end": text().rstrip("\n"),
    "commas in quoted numbers": text(",", ",", form='"{!r}"'),
    "LabVIEW": "Channels,2,\nSamples,3,3\n***End_of_Header***,,\n" + text(header="t,ref,resp,Comment\n"),
    "a header of numbers above the names": "Gain,1,1\nOffset,0,0\n" + text(),
}


@pytest.mark.usefixtures("_way")
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_reads_to_the_same_numbers(tmp_path, layout):
    source = opened(tmp_path, LAYOUTS[layout])

    assert source.names == ("t", "ref", "resp")
    columns = source.load([source.position_of(name, "key") for name in ("t", "ref", "resp")])
    np.testing.assert_array_equal(np.column_stack(columns), np.array(ROWS))


def test_without_header(tmp_path):
    source = opened(tmp_path, "\ufeff" + text(header=""))

    assert source.names == ("", "", "")
    np.testing.assert_array_equal(source.load([2, 0])[0], [row[2] for row in ROWS])


def test_one_column_of_fixed_width(tmp_path):
    source = opened(tmp_path, " -1.7155029e-006\r\n  3.8233083e-005\r\n", "x.txt")

    assert source.names == ("",)
    np.testing.assert_array_equal(source.load([0])[0], [-1.7155029e-6, 3.8233083e-5])


def test_one_column_with_blanks_in_its_name(tmp_path):
    source = opened(tmp_path, "acceleration in m/s²\n1.5\n-2.5\n")

    np.testing.assert_array_equal(source.load([source.position_of("acceleration in m/s²", "key")])[0], [1.5, -2.5])


def test_index_column_without_a_name(tmp_path):
    source = opened(tmp_path, ",freqs,mag\n0,10.0,1.5\n1,12.5,2.5\n")

    assert source.names == ("", "freqs", "mag")
    assert source.position_of("mag", "key") == source.position_of(3, "key") == 2


def test_latin_1_header(tmp_path):
    source = opened(tmp_path, "t;a in µm\n0;1\n1;2\n".encode("latin-1"))

    np.testing.assert_array_equal(source.load([source.position_of("a in µm", "key")])[0], [1, 2])


def test_a_header_in_gb_2312(tmp_path):
    source = opened(tmp_path, "时间,参考加速度\n0,1\n1,2\n".encode("gb2312"))

    np.testing.assert_array_equal(source.load([source.position_of("参考加速度", "key")])[0], [1, 2])


STAMPS = ["{}", "2026-11-22T{}", "2026/11/22 {}Z", "22.11.2026 {}"]


@pytest.mark.parametrize("stamp", STAMPS)
def test_times_of_day_are_read_in_seconds(tmp_path, stamp):
    rows = "".join(f"{stamp.format(f'10:00:0{k // 4}.{250 * (k % 4):03d}')};{k}\n" for k in range(9))
    source = opened(tmp_path, "t;v\n" + rows)

    assert source.in_seconds(0)
    assert not source.in_seconds(1)
    times, values = source.load([0, 1])
    np.testing.assert_array_equal(times, 0.25 * values)


def test_midnight_passes_forwards(tmp_path):
    source = opened(tmp_path, "t,v\n23:59:59.5,0\n00:00:00.0,1\n00:00:00.5,2\n")

    np.testing.assert_array_equal(source.load([0])[0], [0.0, 0.5, 1.0])


def test_columns_that_are_not_needed_may_hold_text(tmp_path):
    source = opened(tmp_path, "t,day,v\n0,2014/07/30,1.5\n1,NaN,2.5\n2,,3.5\n")

    np.testing.assert_array_equal(source.load([2])[0], [1.5, 2.5, 3.5])


def test_integers_first_decimal_commas_later(tmp_path):
    lines = ["0;0,5"] + ["0;0"] * 60
    np.testing.assert_array_equal(opened(tmp_path, "\n".join(lines)).load([1])[0][:2], [0.5, 0])


def test_empty_cell_is_nan_and_located(tmp_path):
    source = opened(tmp_path, "# c\nt,v\n0,1.5\n\n1,\n2,3.5\n")

    (values,) = source.load([1])
    assert math.isnan(values[1])
    assert source.locate(1, 1) == f"{tmp_path / 'x.csv'}, line 5, column 2 ('v')"


def many_rows(count: int) -> list[str]:
    return [f"{k},{k * 0.5},{-k}" for k in range(count)]


DAMAGE = {
    "empty file": ("", {"problem": "empty", "found": "0 bytes"}),
    "only blank lines": ("\n\n  \n", {"problem": "empty"}),
    "only comments": ("# nothing\n# here\n", {"problem": "no rows", "found": "comments"}),
    "header without rows": ("t,ref,resp\n", {"problem": "no rows", "where": "t,ref,resp"}),
    "text in a cell": ("t,v\n0,1\n1,high\n2,3\n", {"found": "'high'", "where": "line 3, column 2 ('v')"}),
    "text behind blank lines": ("t,v\n0,1\n\n\n1,high\n2,3\n", {"found": "'high'", "where": "line 5, column 2 ('v')"}),
    "text far down": (
        "t,v,w\n" + "\n".join([*many_rows(3000), "3000,1.5x,0"]),
        {"found": "'1.5x'", "where": "line 3002, column 2 ('v')"},
    ),
    "text in a quoted cell": ('t,v\n"0","1"\n"1","a ""b"""\n', {"found": "a", "where": "line 3, column 2"}),
    "wrong decimal sign": ("t;v\n0;1.5\n1;2.5\n2;2,5\n", {"found": "'2,5'", "where": "line 4, column 2 ('v')"}),
    "thousands separator": ("t;v\n0;1,5\n1;2,5\n2;1.002,5\n", {"found": "'1.002,5'", "where": "line 4"}),
    "underscore": ("t,v\n0,1\n1,1_000\n", {"found": "'1_000'", "where": "line 3"}),
    "row too short": ("t,v\n0,1\n1\n2,3\n", {"expected": "2 fields", "found": "1 field", "where": "line 3"}),
    "row too long": ("t,v\n0,1\n1,2,3\n2,3\n", {"found": "3 fields", "where": "line 3"}),
    "last line truncated": ("t,v,w\n0,1,2\n1,2,3\n2,", {"found": "2 fields", "where": "line 4", "remedy": "truncated"}),
    "ragged blanks": (" 0 1\n 1 2\n 2\n", {"found": "1 field", "where": "line 3"}),
    "ragged and quoted": ('"0","1"\n"1"\n"2","3"\n"4","5"\n', {"found": "1 field", "where": "line 2"}),
    "binary file": (b"\x89HDF\0\0\0\0", {"problem": "not plain text"}),
    "old Macintosh": ("t,v\r0,1\r", {"problem": "carriage return"}),
    "first row half text": ("t,v\n0,bad\n1,2\n2,3\n3,4\n", {"found": "'bad' in column 2", "where": "line 2"}),
    "mean below the data": ("t,v\n0,1\n1,2\nMean,1.5\n", {"found": "Mean,1.5", "where": "line 4"}),
    "commas of two kinds": ("t,v\n0,0,1,5\n0,1,1,7\n", {"expected": "2 numbers", "remedy": "semicolons"}),
    "numbers as names": ("time,1\n0,5\n1,6\n2,7\n", {"found": "'time' in column 1", "where": "line 1"}),
}


@pytest.mark.usefixtures("_way")
@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_named(tmp_path, refused, damage):
    content, labels = DAMAGE[damage]

    error = refused(lambda: opened(tmp_path, content).load([1]), **labels)
    assert "x.csv" in error.where


def test_line_ends_inside_quotes(tmp_path, refused):
    content = 't,note,v\n0,ok,1\n1,"two\nlines",2\n2,ok,3\n3,ok,4\n4,ok,5\n5,ok,5\n6,ok,5\n'
    refused(lambda: opened(tmp_path, content).load([0]), where="line 3")


def test_missing_and_ambiguous_columns(tmp_path, refused):
    source = opened(tmp_path, "t,acc,acc,volt\n0,1,2,3\n1,2,3,4\n")

    refused(lambda: source.position_of("acc", "[reference] column"), problem="not unique", remedy="2 or 3")
    error = refused(lambda: source.position_of("volts", "[response] column"), remedy="'volt'", found="'volts'")
    assert "'t', 'acc', 'acc', 'volt'" in error.expected
    assert "[response] column" in error.where
    refused(lambda: source.position_of(5, "[response] column"), expected="1 to 4", found="column 5")
    bare = opened(tmp_path, "0,1\n1,2\n", "bare.csv")
    refused(lambda: bare.position_of("t", "key"), expected="no header", remedy="column number")


def test_what_the_system_refuses(tmp_path, refused, monkeypatch):
    refused(lambda: CsvFile(tmp_path / "none.csv"), found="no file", where="none.csv", remedy="path")
    refused(lambda: CsvFile(tmp_path), found="a folder")
    source = opened(tmp_path, text())

    def forbidden(*_args, **_kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(tmp_path), "open", forbidden)
    refused(lambda: CsvFile(tmp_path / "x.csv"), found="may not be read")
    refused(lambda: source.load([0]), found="may not be read")


def test_only_needed_columns_are_parsed(tmp_path, monkeypatch):
    monkeypatch.setattr("vibrident.data.io.formats.csv.MAX_LIGHT_BYTES", 0)
    asked = []
    original = pandas.read_csv
    monkeypatch.setattr(pandas, "read_csv", lambda *a, **k: asked.append(k["usecols"]) or original(*a, **k))

    opened(tmp_path, text()).load([2])
    assert asked == [[2]]


finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
DIALECTS = st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), ("  ", ",")])


@settings(derandomize=True, max_examples=60, deadline=None)
@given(
    rows=st.lists(st.tuples(finite, finite, finite), min_size=2, max_size=12),
    dialect=DIALECTS,
    header=st.booleans(),
    units=st.booleans(),
    plus=st.booleans(),
    end=st.sampled_from(["\n", "\r\n"]),
)
def test_every_float_survives_every_dialect(tmp_path_factory, rows, dialect, header, units, plus, end):
    delimiter, decimal = dialect
    form = "{:+.17g}" if plus else "{:.17g}"
    lines = [delimiter.join(form.format(v).replace(".", decimal) for v in row) for row in rows]
    if header:
        lines[:0] = [delimiter.join(("time", "reference", "response"))]
        lines[1:1] = [delimiter.join(("s", "m/s^2", "V"))] if units else []
    path = tmp_path_factory.mktemp("dialect") / "x.csv"
    path.write_bytes((end.join(lines) + end).encode())

    for by_pandas in (True, False):
        with pytest.MonkeyPatch.context() as way:
            way.setattr("vibrident.data.io.formats.csv.MAX_LIGHT_BYTES", 0 if by_pandas else 1 << 30)
            source = CsvFile(path)
            assert source.names == (("time", "reference", "response") if header else ("", "", ""))
            np.testing.assert_array_equal(np.column_stack(source.load([0, 1, 2])), np.array(rows))


def test_plain_files_are_read_without_pandas(tmp_path, monkeypatch):
    monkeypatch.setattr("vibrident.data.io.formats.csv.MAX_LIGHT_BYTES", 1 << 30)
    monkeypatch.setattr(pandas, "read_csv", None)
    for layout in ("comma", "semicolon", "tab", "blanks", "comma and blank", "carriage returns", "tab, decimal comma"):
        values = opened(tmp_path, LAYOUTS[layout]).load([2, 0])
        np.testing.assert_array_equal(values, np.array(ROWS).T[[2, 0]], err_msg=layout)


def test_what_stands_in_another_cell_is_not_taken_for_a_number_of_this_one(tmp_path, monkeypatch, refused):
    monkeypatch.setattr("vibrident.data.io.formats.csv.MAX_LIGHT_BYTES", 1 << 30)
    (first,) = opened(tmp_path, "1,2\n,3\n4,5\n").load([0])
    np.testing.assert_array_equal(first, [1.0, np.nan, 4.0])
    source = opened(tmp_path, "1,2\n3 4,\n5,6\n7,8\n")
    refused(lambda: source.load([0]), where="line 2")


def test_chunks_do_not_change_line_numbers(tmp_path, monkeypatch, refused):
    monkeypatch.setattr("vibrident.data.io.formats.csv._CHUNK_BYTES", 64)
    lines = many_rows(500)
    source = opened(tmp_path, "\n".join([*lines[:250], "", *lines[250:]]))
    (values,) = source.load([0])
    np.testing.assert_array_equal(values, np.arange(500.0))
    assert "line 500," in source.locate(0, 498)
    lines[400] = "1,2"
    refused(lambda: opened(tmp_path, "\n".join(lines)).load([0]), where="line 401")
