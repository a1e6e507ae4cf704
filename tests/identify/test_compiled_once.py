"""Identifying again compiles nothing, and a process that has compiled much lets go of it."""

from __future__ import annotations

import logging

import pytest

import vibrident
from vibrident.backend import jax, release_kernels
from vibrident.simulation import simulate, with_noise


@pytest.mark.parametrize("excitation", ["sine", "random"])
def test_the_same_kind_of_data_compiles_nothing_twice(excitation, caplog):
    shape = {"frequencies_hz": [100.0, 250.0, 400.0, 630.0, 1000.0]} if excitation == "sine" else {"repeats": 2}
    clean = simulate("paper", excitation, samples=4000, start="rest", seed=1, **shape)
    for seed in range(2):
        vibrident.identify(with_noise(clean, response_noise=0.01, seed=seed), estimator="ipnn")
    with caplog.at_level(logging.WARNING), jax.log_compiles():
        vibrident.identify(with_noise(clean, response_noise=0.01, seed=9), estimator="ipnn")
    assert [r.getMessage()[:80] for r in caplog.records if r.getMessage().startswith("Compiling")] == []


def test_kernels_are_released_only_when_there_are_many():
    assert not release_kernels(10**9)
    kept = jax.jit(lambda x: x + 1.0)
    assert kept(1.0) == 2.0
    if release_kernels(1):  # where the system counts maps
        assert kept(1.0) == 2.0
