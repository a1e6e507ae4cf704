"""The door to JAX: float64, and where the kernel cache lies."""

from pathlib import Path

import numpy as np

from vibrident.backend import arithmetic_error, cache_folder, jnp


def test_double_precision_by_default():
    assert jnp.asarray(1.0).dtype == np.float64
    assert float(jnp.asarray(1.0) + 1e-15) != 1.0


def test_the_arithmetic_that_faulty_releases_get_wrong():
    assert arithmetic_error() < 1e-13


def test_cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("VIBRIDENT_CACHE", str(tmp_path / "kernels"))
    assert cache_folder() == tmp_path / "kernels"
    monkeypatch.setenv("VIBRIDENT_CACHE", "")
    assert cache_folder() is None
    monkeypatch.delenv("VIBRIDENT_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = cache_folder()
    assert isinstance(folder, Path)
    assert folder.parent == tmp_path / "vibrident"
