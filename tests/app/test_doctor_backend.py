"""The door to JAX: sound arithmetic, float64, the pinned version, the cure for other versions, the cache folder."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from tests.support.sources import ROOT

from vibrident.base import backend
from vibrident.base.backend import jax, jnp
from vibrident.base.errors import InputError

OTHER_VERSION = "0.10.2"
CURE = "--xla_cpu_experimental_ynn_fusion_type="

PRETEND = f"""
import importlib.metadata, os
real = importlib.metadata.version
importlib.metadata.version = lambda name: {OTHER_VERSION!r} if name == "jax" else real(name)
"""


def run_python(code: str, **environment: str) -> str:
    """Run code in a fresh interpreter with these environment variables; return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_numbers_are_float64():
    assert jax.config.jax_enable_x64
    assert jnp.asarray(1.0).dtype == np.float64
    assert float(jnp.asarray(1.0) + 1e-15) > 1.0


def test_kernels_are_released_only_when_there_are_many():
    assert not backend.release_kernels(10**9)
    kept = jax.jit(lambda x: x + 1.0)
    assert kept(1.0) == 2.0
    if backend.release_kernels(1):  # where the system counts maps
        assert kept(1.0) == 2.0


def test_jax_is_an_extra_from_the_trusted_version_on():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f"jax>={backend.TRUSTED}" in project["optional-dependencies"]["network"]
    assert not [each for each in project["dependencies"] if each.startswith(("jax", "equinox", "optax", "pyarrow"))]


@pytest.mark.parametrize(
    ("version", "cured"),
    [("0.10.1", False), ("0.10.2", True), ("0.11.2", True), ("0.12.0.1", True), ("0.12.1", False), ("0.13.0", False)],
)
def test_the_flag_is_set_for_the_versions_that_need_it(version, cured):
    """Others may not know it, and XLA ends a process whose flags it does not know."""
    assert backend._with_remedy("", version) == (CURE if cured else "")
    assert backend._with_remedy(CURE, version) == CURE


STATE = "import os, vibrident.base.backend as b; print(os.environ['XLA_FLAGS'], b.jax.config.jax_compilation_cache_dir)"


def test_another_version_gets_the_flag_that_cures_it_beside_those_that_are_set_already(tmp_path):
    """No cache is wanted here, and none is made."""
    user, home = "--xla_cpu_enable_fast_math=false", str(tmp_path)
    said = run_python(PRETEND + STATE, XLA_FLAGS=user, VIBRIDENT_CACHE="", XDG_CACHE_HOME=home, HOME=home)
    assert said.split() == [user, CURE, "None"]
    assert not any(tmp_path.iterdir())


#: Uses the cache again after each of its entries has become what another process has written half.
HALF = """
import warnings
from pathlib import Path
b.arithmetic_error()
for entry in Path(os.environ["VIBRIDENT_CACHE"]).glob("*-cache"):
    entry.write_bytes(entry.read_bytes()[: entry.stat().st_size // 2])
b.jax.clear_caches()
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    print(b.arithmetic_error() < 1e-13, bool(said), {str(w.message)[:48] for w in said})
"""


def test_the_installed_version_computes_rightly_and_keeps_its_kernels_where_a_cache_is_wanted(tmp_path):
    """Another process may be writing there: what is found half written is compiled again."""
    as_for_users = {"XLA_FLAGS": "", "JAX_DISABLE_MOST_OPTIMIZATIONS": "false"}
    said = run_python(STATE + HALF, VIBRIDENT_CACHE=str(tmp_path), **as_for_users)
    assert any(tmp_path.iterdir())
    folder, outcome = said.splitlines()
    assert folder.split()[-1] == str(tmp_path)
    assert outcome == "True True {'Error reading persistent compilation cache entry'}"


def test_another_version_that_computes_wrongly_is_refused(monkeypatch):
    monkeypatch.setattr(backend, "_installed", OTHER_VERSION)
    monkeypatch.setattr(backend, "arithmetic_error", lambda: float("inf"))
    with pytest.raises(InputError, match=rf"(?s)JAX {OTHER_VERSION}.*pip install 'jax=={backend.TRUSTED}'"):
        backend._require_sound_arithmetic()


def test_another_version_that_computes_rightly_is_accepted(monkeypatch):
    monkeypatch.setattr(backend, "_installed", OTHER_VERSION)
    backend._require_sound_arithmetic()


def test_the_cache_lies_where_the_variable_says(monkeypatch, tmp_path):
    monkeypatch.setenv("VIBRIDENT_CACHE", str(tmp_path))
    assert backend.cache_folder() == tmp_path


def test_an_empty_variable_means_no_cache(monkeypatch):
    monkeypatch.setenv("VIBRIDENT_CACHE", "")
    assert backend.cache_folder() is None


def test_without_the_variable_the_cache_is_the_users_own_by_version(monkeypatch, tmp_path):
    monkeypatch.delenv("VIBRIDENT_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert backend.cache_folder() == tmp_path / "vibrident" / f"jax-{jax.__version__}"
