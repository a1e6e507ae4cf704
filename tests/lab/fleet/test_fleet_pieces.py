"""The pieces of a fleet: keys, batches, parts, limits, and what is called an outlier."""

import os
import subprocess
import sys
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.support.fleets import good

from vibrident.base.errors import InputError
from vibrident.lab.fleet import orders as of_workers
from vibrident.lab.fleet import parts, row
from vibrident.lab.fleet.coordinator import BATCH_S, Batches
from vibrident.lab.fleet.key import fingerprint
from vibrident.lab.fleet.limits import Specification, read_limits
from vibrident.lab.fleet.orders import Orders, memory_limit
from vibrident.lab.fleet.page import write_page
from vibrident.lab.fleet.patterns import Paths, find_files
from vibrident.lab.fleet.statistics import MIN_OUTLIER_VALUES, outlier_limit, statistics
from vibrident.lab.fleet.table import write_table


def test_a_key_follows_content_and_settings_and_not_the_place(tmp_path):
    orders = Orders(str(tmp_path))
    first = fingerprint(str(good(tmp_path / "a", 1)), orders)
    assert fingerprint(str(good(tmp_path / "other" / "place", 1)), Orders("elsewhere", run="x")) == first
    keys = {first.key, fingerprint(str(good(tmp_path / "b", 2)), orders).key}
    keys |= {fingerprint(str(tmp_path / "a/c.toml"), Orders("", **other)).key for other in _OTHERS}
    (tmp_path / "a/frf.csv").unlink()
    keys.add(fingerprint(str(tmp_path / "a/c.toml"), orders).key)
    assert len(keys) == 3 + len(_OTHERS)


_OTHERS = ({"model": "accelerometer+delay"}, {"estimator": "ml"}, {"version": "0"})


def test_a_certificate_of_the_reference_is_part_of_the_key(tmp_path):
    file = good(tmp_path, 1)
    known = '\n[[reference.known_response]]\nfile = "known.csv"\nfrequency = 1\nmagnitude = 2\nphase = 3\n'
    file.write_text(file.read_text() + known)
    keys = set()
    for text in (None, "f,S,phase\n1,1,0\n", "f,S,phase\n1,2,0\n"):
        if text is not None:
            (tmp_path / "known.csv").write_text(text)
        keys.add(fingerprint(str(file), Orders("")).key)
    assert len(keys) == 3


def test_batches_are_of_one_shape_and_about_ten_seconds_and_small_at_the_end():
    batches = Batches()
    for number in range(2000):
        batches.add("long" if number % 2 else "short", (f"{number}", f"{number}"))
    assert len(batches.take(4)[1]) == 1  # nothing is known of this shape
    for shape, each in (("long", 1.0), ("short", 0.05)):
        batches.update_time(shape, each, 1)
    sizes: dict[str, list[int]] = {"long": [], "short": []}
    while batches:
        shape, tasks = batches.take(4)
        sizes[shape].append(len(tasks))
    assert max(sizes["long"]) == BATCH_S
    assert max(sizes["short"]) == BATCH_S / 0.05
    assert sum(map(sum, sizes.values())) == 1999
    assert sizes["long"][-1] <= 2


def test_paths_and_keys_come_back_as_they_were_given():
    given = [f"/data/{number}/\udcff {number % 7}.toml" for number in range(700)]
    paths = Paths()
    for path in given:
        paths.add(path)
    assert (list(paths), len(paths), paths[3], paths[699]) == (given, 700, given[3], given[699])
    digits = [f"{number:x}".ljust(64, "0") for number in range(1, 9000)]
    assert parts.digits(parts.packed(digits)) == digits


def simulated(count: int, seed: int = 1, status: str = row.IDENTIFIED, unit: str = "V/(m/s^2)"):
    """Rows as a worker would give them."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        gain = 0.01 * (1 + 0.01 * rng.standard_normal())
        made = row._row(f"{number:064x}", status, "", {"type": "A", "serial_number": f"SN{number}"}, 0.2)
        parameters = {"sensitivity": [gain, 1e-5, unit], "natural_frequency": [5000.0 + number % 7, 1.0, "Hz"]}
        yield {**made, "model": "accelerometer", "estimator": "ml", "parameters": parameters, "adequate": True}


def test_of_two_rows_of_a_key_one_counts(tmp_path):
    (identified,) = simulated(1)
    failed = {**identified, "status": row.FAILED, "parameters": {}}
    other = {**identified, "key": "f" * 64}
    parts.write_part(tmp_path, [failed, other], 5.0, None)
    parts.write_part(tmp_path, [identified], 1.0, None)
    (tmp_path / "damaged.parquet").write_bytes(b"PAR1 and no more")
    (tmp_path / "empty.parquet").touch()
    index = parts.index(tmp_path, None, 5.0, None)
    assert parts.digits(index.keys) == [identified["key"], "f" * 64]
    assert index.is_final.all()
    assert index.parameters[index.part[0]] == ("sensitivity", "natural_frequency")


def test_a_part_that_was_damaged_or_is_none_is_ignored(tmp_path):
    whole = tmp_path / parts.write_part(tmp_path, list(simulated(3)), 1.0, None)
    content, count = whole.read_bytes(), lambda: parts.index(tmp_path, None, 1.0, None).keys.size
    written, seen = pq.read_table(whole).to_pylist(), 0
    for place in range(7, len(content), len(content) // 60):
        whole.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        kept = count()
        assert kept in (0, 3)
        assert not kept or pq.read_table(whole).to_pylist() == written  # a byte that says nothing
        seen += not kept
    assert seen > 20
    whole.write_bytes(content)
    (tmp_path / "copy.parquet").write_bytes(content)
    for number, keys in enumerate(([None], ["xyz"], [1.0])):
        rest = {"status": ["identified"], "time_limit_s": [1.0], "memory_limit_bytes": [None]}
        pq.write_table(pa.table({"key": keys, **rest}), tmp_path / f"{number}.parquet")
    (tmp_path / "folder.parquet").mkdir()
    assert count() == 3


def test_a_command_loads_no_pandas_for_arrow():
    script = (
        "import sys, pyarrow as pa; from vibrident.lab.fleet import parts; parts.load_arrow(); "
        "table = pa.table({'a': ['x']}); assert 'pandas' not in sys.modules; assert table.to_pandas().a[0] == 'x'"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=120)


def test_folders_behind_links_count_and_no_link_leads_in_circles(tmp_path):
    for name in ("here/a", "elsewhere/b", "elsewhere/c/d"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "c.toml").touch()
    links = {
        "here/out": "../elsewhere",
        "here/again": "../elsewhere/c",
        "elsewhere/c/back": "../../here",
        "here/up": "..",
    }
    for link, target in links.items():
        (tmp_path / link).symlink_to(target)
    files = {os.path.realpath(path) for path in find_files([str(tmp_path / "here")]).paths}
    assert files == {str(tmp_path / name / "c.toml") for name in ("here/a", "elsewhere/b", "elsewhere/c/d")}


def test_what_a_missing_library_refuses_is_in_the_table_and_tried_again(tmp_path):
    orders = Orders(str(tmp_path), results=False)
    orders.parts_folder.mkdir()
    (kept,) = simulated(1)
    missing = InputError("It needs npTDMS.", found="none", remedy="pip install 'vibrident[tdms]'")
    passing = row.refused("e" * 64, missing, {"type": "A"}, None, 0.1)
    assert passing["passing"]
    assert not row.refused("e" * 64, InputError("No.", remedy="correct it"), {}, None, 0.1)["passing"]
    calibrations = ["b.toml", "a.toml"], parts.packed(["e" * 64, kept["key"]])
    whole = parts.write_part(orders.parts_folder, [passing, kept], 1.0, None)
    tally = write_table(tmp_path / "fleet.parquet", *calibrations, orders)
    assert tally.statuses == {"refused": 1, "identified": 1}
    assert pq.read_table(tmp_path / "fleet.parquet")["status"].to_pylist() == ["refused", "identified"]
    assert parts.index(orders.parts_folder, None, 1.0, None).is_final.tolist() == [True, False]
    found_now = {**next(simulated(1)), "key": "e" * 64}
    parts.write_part(orders.parts_folder, [found_now], 1.0, None)
    assert write_table(tmp_path / "fleet.parquet", *calibrations, orders).statuses == {"identified": 2}
    (orders.parts_folder / whole).unlink()
    with pytest.raises(InputError, match="Rows were removed"):
        write_table(tmp_path / "fleet.parquet", *calibrations, orders)


def test_statistics_know_limits_and_their_unit(tmp_path):
    orders = Orders(str(tmp_path), results=False)
    orders.parts_folder.mkdir()
    found = [*simulated(200), *simulated(1, status=row.REFUSED)]
    found[-1].update(key="e" * 64, parameters={}, adequate=None)
    found[7]["parameters"]["sensitivity"][0] = 0.012
    parts.write_part(orders.parts_folder, found[:90], 1.0, None)
    parts.write_part(orders.parts_folder, found[90:], 1.0, None)
    order = [*range(200, -1, -1)]
    names, keys = [f"{number}.toml" for number in order], parts.packed([found[number]["key"] for number in order])
    tally = write_table(tmp_path / "fleet.parquet", names, keys, orders)
    assert (tally.rows, tally.doubts) == (201, 1)
    limit = {"type": "A", "parameter": "sensitivity", "nominal": 0.01, "tolerance_percent": 10.0}
    made = statistics(tmp_path / "fleet.parquet", tally, Specification.model_validate({"limits": [limit]}))
    (outlier,) = made.outliers
    assert (order[outlier.row], outlier.parameter, outlier.outside) == (7, "sensitivity", True)
    (one,) = made.yields
    assert (one.calibrations, one.identified, one.conforming) == (201, 200, 199)
    gains = made.groups[0].distributions[0]
    values = [row["parameters"]["sensitivity"][0] for row in found[:200]]
    assert gains.median == pytest.approx(np.median(values), rel=1e-12)
    assert (gains.histogram.counts.sum(), gains.histogram.below, gains.histogram.above) == (199, 0, 1)  # the outlier

    def with_unit(**changes):
        specification = Specification.model_validate({"limits": [limit | changes]})
        return statistics(tmp_path / "fleet.parquet", tally, specification).yields[0].conforming

    assert with_unit(unit="mV/(m/s^2)", nominal=10.0) == 199
    assert with_unit(unit="mV/(m/s^2)", nominal=10.0, tolerance=1.0, tolerance_percent=None) == 199
    assert with_unit(unit="mV/(m/s)") == 0  # a limit that cannot be used is not kept

    (tmp_path / "results").mkdir()
    specification = Specification.model_validate({"limits": [limit]})
    page = write_page(tmp_path / "fleet.html", tmp_path / "fleet.parquet", tally, specification, 0.0).read_text()
    assert f'<a href="results/{found[7]["key"]}.json">SN7</a>' in page
    assert '--share:99.00%">99.00 %' in page
    assert page.count("<img ") == 4  # two parameters, this run and the time of each calibration
    assert "<script" not in page


@pytest.mark.parametrize("count", [MIN_OUTLIER_VALUES, 50, 300])
def test_normal_values_show_an_outlier_in_one_group_of_a_hundred(count):
    values = np.random.default_rng(count).standard_normal((4000, count))
    distance = np.abs(values - np.median(values, axis=1, keepdims=True))
    spread = 1.482602218505602 * np.median(distance, axis=1)
    alarms = float(np.mean(distance.max(axis=1) / spread > outlier_limit(count)))
    assert 0.002 < alarms < 0.015


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[limits]]\nparameter='sensitivity'\nnominal=1\ntolerance=1\ntolerance_percent=2", "both"),
        ("[[limits]]\nparameter='sensitivity'\nnominal=1", "neither"),
        ("[[limits]]\nparameter='sensitvity'\nnominal=1\ntolerance=1", "did you mean 'sensitivity'"),
        ("[[limits]]\nparameter='sensitivity'\nnominal='1'\ntolerance=1", "limits file"),
        ("[[limits]]\nparameter='sensitivity'\nnominal=1\ntollerance=1", "did you mean 'tolerance'"),
        ("[[limits]]\nparameter='sensitivity'\nnominal=nan\ntolerance=1", "finite"),
        ("[[limits]]\nparameter='sensitivity'\nnominal=0\ntolerance_percent=1", "zero"),
        ("[[limits]]\nparameter='delay'\nnominal=0\ntolerance=1\n" * 2, "Two limits"),
        ("", "no limit"),
        ("limits", "TOML"),
    ],
)
def test_a_limits_file_that_is_wrong_says_where(tmp_path, text, said):
    file = tmp_path / "limits.toml"
    file.write_text(text)
    with pytest.raises(InputError) as refused:
        read_limits(file)
    assert said in str(refused.value)
    assert "limits.toml" in refused.value.where


class Point(NamedTuple):
    """As an entry point is, as far as the key asks."""

    dist: SimpleNamespace


@pytest.mark.parametrize("group", ["models", "estimators", "readers", "departures"])
def test_the_key_changes_with_a_plug_in_that_takes_part(tmp_path, monkeypatch, group):
    file = str(good(tmp_path / "a", 1))

    def key(**groups):
        points = {
            f"vibrident.{name}": [Point(SimpleNamespace(name="other", version=version))]
            for name, version in groups.items()
        }
        monkeypatch.setattr(of_workers, "installed", lambda: points)
        return fingerprint(file, Orders(str(tmp_path))).key

    keys = [key(), key(**{group: "1.0"}), key(**{group: "1.1"})]
    assert len(set(keys)) == 3
    assert key(**{group: "1.0"}) == keys[1]
    assert key(exports="1.0", sources="1.0") == keys[0]  # no result depends on these


def test_a_process_may_hold_at_least_four_gigabytes_or_the_machine():
    assert memory_limit(Orders("", memory_limit_bytes=7)) == 7
    found = memory_limit(Orders(""))
    assert found is None or found > 1e9


def test_a_process_that_is_ready_has_loaded_what_identifies():
    """Else the time limit of its first calibration would hold the loading of the libraries."""
    code = """
import sys
from types import SimpleNamespace
from typing import NamedTuple
from vibrident.lab.fleet.worker import ready
ready()
print("vibrident.data.io" in sys.modules, "vibrident.use.identification" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.split() == ["True", "True"]
