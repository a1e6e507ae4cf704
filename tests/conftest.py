"""Settings that hold for every test; set before any library that reads them is loaded."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from vibrident.app.cli import COLLECTION_THRESHOLD_OBJECTS
from vibrident.base.memory import keep_freed, use_one_thread

# The threads of two test processes would wait for each other. NumPy reads it when it is loaded.
assert "numpy" not in sys.modules or "OPENBLAS_NUM_THREADS" in os.environ, "a plug-in of pytest has loaded NumPy"
use_one_thread()
keep_freed()

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402
from tests.support.extras import installed, lacks  # noqa: E402
from tests.support.unit_mark import UnitMark  # noqa: E402

# Each of the many processes that tests start would compile the package anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
gc.disable()  # until all tests are collected: modules that are loaded make no garbage
# One cache for all workers: what one has compiled the others need not. JAX compiles again what it finds half written,
# with a warning that pyproject.toml lets pass.
os.environ["VIBRIDENT_CACHE"] = str(Path(__file__).resolve().parents[1] / ".jax_cache")
# Compiling is most of what a test of a network costs: three quarters of that are the optimiser's and those of the newer
# of two ways to fuse loops. `make nightly` compiles as for users.
if os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "true") == "true":
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")
os.environ["MPLBACKEND"] = "Agg"
os.environ["COLUMNS"] = "160"  # what a table wraps must not depend on who runs the tests
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # as the package sets it, for tests that load JAX first

# The first example of a test may compile; the same examples on every run.
settings.register_profile("vibrident", deadline=None, derandomize=True)
settings.load_profile("vibrident")


def pytest_configure(config: pytest.Config) -> None:
    """Mark units; the process that reports tests learns how long they took, its workers do not."""
    if config.pluginmanager.has_plugin("cacheprovider"):
        is_quick = "unit" in config.option.markexpr
        is_worker = hasattr(config, "workerinput")
        config.pluginmanager.register(UnitMark(config.cache, is_quick=is_quick, is_worker=is_worker))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A test marked ``draws(few, many)`` has few of them in ``make test``, and many in ``make nightly``."""
    mark = metafunc.definition.get_closest_marker("draws")
    if mark:
        few, many = mark.args
        metafunc.parametrize("draws", [few, pytest.param(many, marks=pytest.mark.slow)], ids=["few", "many"])


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """On the plain install, files that are about what an extra brings are left out."""
    file = collection_path / "conftest.py" if collection_path.is_dir() else collection_path
    return True if file.suffix == ".py" and file.is_file() and lacks(file) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a test marked ``quick`` the cases that the mark does not name are slow.

    Tests of the page come first: an idle worker takes over what stands last in the list of another, and would start a
    server and a browser of its own.
    """
    items.sort(key=lambda item: "web" not in item.path.parts)
    for item in items:
        for needed in item.iter_markers("needs"):
            if not installed(needed.args[0]):
                item.add_marker(pytest.mark.skip(reason=f"needs the extra {needed.args[0]}"))
        mark = item.get_closest_marker("quick")
        if mark and item.callspec.id not in mark.args:
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish() -> None:
    """Modules and tests stay until the end: looking for garbage among them again and again took seconds."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(COLLECTION_THRESHOLD_OBJECTS)
    gc.enable()


@pytest.fixture(scope="module", autouse=True)
def _release_kernels() -> Iterator[None]:
    """A compiled kernel holds memory maps; Linux allows 65 530 a process, and the suite would end in a segfault."""
    yield
    maps = Path("/proc/self/maps")
    if "jax" in sys.modules and maps.exists() and maps.read_text().count("\n") > 20_000:
        sys.modules["jax"].clear_caches()
        gc.collect()


@pytest.fixture
def rng() -> np.random.Generator:
    """The same random numbers for every test, in whatever order they run."""
    return np.random.default_rng(20251113)


@pytest.fixture
def unpainted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of documents have their size and nothing in it: for what looks at words and numbers alone."""
    monkeypatch.setattr("vibrident.show.media.drawing._Drawing._stack", lambda *_: None)
