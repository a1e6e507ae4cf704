"""A result names what took part in it, and nothing that did not."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from tests.support.file_formats import WRITERS
from tests.support.random_record import calibration, motion

import vibrident
from vibrident.base.participants import participants, takes_part, watching
from vibrident.data.registry import READERS
from vibrident.fit.judge.provenance import LIBRARIES

CORE = {"numpy", "scipy"}
CALIBRATION = """
[reference]
column = "a"
unit = "m/s^2"
[response]
column = "v"
unit = "V"
[sampling]
rate_hz = 1000.0
[[records]]
file = "x.*"
excitation = "random"
"""


def libraries(result) -> set[str]:
    named = result.provenance["libraries"]
    assert all(version(name) == stated for name, stated in named.items())
    return set(named)


@pytest.fixture(scope="module")
def record():
    return calibration(*motion(np.random.default_rng(7)))


def test_jax_is_named_where_it_ran_and_only_there(record):
    """It is loaded by then, and a second one that needs none does not name it."""
    bent = vibrident.identify(vibrident.simulate("cubic", "random", samples=400, response_noise=0.01))
    assert libraries(bent) == {*CORE, "jax", "jaxlib"}
    assert libraries(vibrident.identify(record)) == CORE
    assert "plug_ins" not in bent.provenance


def test_what_takes_part_within_takes_part_without():
    with watching():
        takes_part("a")
        with watching():
            takes_part("b")
            assert participants() == {"b"}
        assert participants() == {"a", "b"}
    takes_part("c")
    assert participants() == frozenset()


def written(path: Path, columns: dict[str, np.ndarray]) -> None:
    names, values = list(columns), np.column_stack(list(columns.values()))
    match path.suffix:
        case ".csv":
            np.savetxt(path, values, delimiter=",", header=",".join(names), comments="")
        case ".h5":
            import h5py

            with h5py.File(path, "w") as file:
                for name in names:
                    file[name] = columns[name]
        case ".mat":
            import scipy.io

            scipy.io.savemat(path, columns)
        case ".wav":
            import soundfile

            soundfile.write(path, 0.1 * values / np.max(np.abs(values)), 1000, subtype="DOUBLE")
        case ".xlsx":
            import openpyxl

            book = openpyxl.Workbook()
            for row in [names, *values[:50].tolist()]:
                book.active.append(row)
            book.save(path)


#: Reads each file and its numbers in a process of its own, and prints which of these packages that one loaded.
READ = """
import os, sys
from pathlib import Path
from vibrident.data.io.reader import open_columns
files = sys.argv[1].split("|")
for file in files:
    sys.stdout.flush()
    if os.fork():
        os.wait()
        continue
    open_columns(Path(file)).load([0])
    print(Path(file).parent.name, *(module for module in sys.argv[2:] if module in sys.modules), flush=True)
    os._exit(0)
"""
KNOWN = {package: package.lower() for packages in LIBRARIES.values() for package in packages}


@pytest.fixture(scope="module")
def loaded_by(tmp_path_factory) -> dict[str, set[str]]:
    """Packages that reading a file of each reader loads, beside what the module of readers loads itself."""
    rng, files = np.random.default_rng(20251113), []
    for reader in LIBRARIES:
        ending = {"hdf5": ".h5", "excel": ".xlsx"}.get(reader, READERS[reader].endings[0])
        files.append(tmp_path_factory.mktemp("readers") / reader / f"x{ending}")
        files[-1].parent.mkdir()
        columns = {"a": rng.standard_normal(500), "v": rng.standard_normal(500)}
        WRITERS.get(files[-1].name, written)(files[-1], columns)
    words = [sys.executable, "-c", READ, "|".join(map(str, files)), *KNOWN.values(), "pandas", "jax"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=True)
    return {reader: set(packages) for reader, *packages in map(str.split, done.stdout.splitlines())}


def test_every_reader_of_this_package_says_its_libraries():
    assert set(LIBRARIES) == set(READERS.built_in())


@pytest.mark.parametrize("reader", sorted(LIBRARIES))
@pytest.mark.skipif(not hasattr(os, "fork"), reason="the process is copied for each reader")
def test_a_reader_loads_the_libraries_that_are_said_of_it(reader, loaded_by):
    loaded = loaded_by[reader]
    assert {KNOWN[package] for package in LIBRARIES[reader]} <= loaded
    if reader in ("csv", "hdf5", "wav", "matlab"):  # libraries of the others load some of these themselves
        assert loaded == {KNOWN[package] for package in LIBRARIES[reader]}


@pytest.mark.parametrize(("ending", "named"), [(".csv", set()), (".h5", {"h5py"})])
def test_the_reader_of_a_file_is_named(ending, named, tmp_path, record):
    one = record.records[0]
    written(tmp_path / f"x{ending}", {"a": one.reference, "v": one.response})
    text = CALIBRATION.replace("1000.0", repr(one.sampling_rate_hz))
    (tmp_path / "c.toml").write_text(text, encoding="utf-8")
    assert libraries(vibrident.identify(tmp_path / "c.toml")) == CORE | named
