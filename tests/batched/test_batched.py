"""Fits of many calibrations at once: on JAX's CPU backend, the same program that a GPU runs."""

from __future__ import annotations

import dataclasses
import threading
from types import SimpleNamespace

import numpy as np
import pytest

import vibrident
from vibrident.batched import Together, program
from vibrident.errors import InputError, NotConverged, VibridentError
from vibrident.estimators import optimise
from vibrident.simulation import simulate, with_noise


def sines(seed: int, model: str = "paper"):
    """A calibration by sines with noise of its own; seeds differ in gain too."""
    clean = simulate(model, frequencies_hz=[160.0, 800.0, 2000.0, 4000.0, 5000.0], samples=500, start="steady", seed=1)
    noisy = with_noise(clean, response_noise=0.01, seed=seed)
    records = tuple(dataclasses.replace(one, response=(1 + 0.01 * seed) * one.response) for one in noisy.records)
    return dataclasses.replace(noisy, records=records)


@pytest.fixture
def on_cpu(monkeypatch):
    """The program of the GPU on JAX's CPU backend."""
    monkeypatch.setattr(program, "gpu", lambda: program.jax.devices("cpu")[0])


def require_same(ones, others):
    for one, other in zip(ones, others, strict=True):
        for name, parameter in one.parameters.items():
            again = other.parameters[name]
            assert again.value == pytest.approx(parameter.value, rel=1e-9, abs=1e-9 * parameter.standard_uncertainty)
            assert again.standard_uncertainty == pytest.approx(parameter.standard_uncertainty, rel=1e-9)
        assert other.fit.chi2_reduced == pytest.approx(one.fit.chi2_reduced, rel=1e-9)
        assert other.warning_codes == one.warning_codes
        np.testing.assert_allclose(other.response.magnitude, one.response.magnitude, rtol=1e-9)


@pytest.mark.parametrize("estimator", ["ml", "ipnn"])
def test_a_batch_gives_the_numbers_of_each(on_cpu, estimator):
    calibrations = [sines(seed) for seed in range(1, 4)]
    plain = [vibrident.identify(one, estimator=estimator) for one in calibrations]
    together = list(vibrident.identify_many(calibrations, estimator=estimator, device="gpu"))
    require_same(plain, together)
    assert [one.settings["device"] for one in together] == ["gpu"] * 3
    assert "device" not in plain[0].settings


def test_what_cannot_go_that_way_is_fitted_on_the_processor_and_says_so(on_cpu, monkeypatch):
    monkeypatch.setattr(program, "descend", lambda some, device: pytest.fail("nothing is to be sent there"))
    whole = sines(1)
    mask = np.ones(500, dtype=bool)
    mask[200:203] = False
    gaps = dataclasses.replace(
        whole, records=tuple(dataclasses.replace(one, valid=mask, reference_valid=mask | True) for one in whole.records)
    )
    wrong = dataclasses.replace(whole, model="akzelerometer")
    made = vibrident.identify_many([gaps, wrong], estimator="ipnn", refused="return", device="gpu")
    fitted, refused = made
    assert fitted.settings["device"] == "cpu: samples are missing"
    require_same([vibrident.identify(gaps, estimator="ipnn")], [fitted])
    assert isinstance(refused, VibridentError)


def test_a_descent_that_needs_bent_steps_is_made_on_the_processor_and_says_so(on_cpu, monkeypatch):
    monkeypatch.setattr(optimise, "STRAIGHT", 1)  # as if every descent of a network were long
    calibrations = [sines(seed) for seed in (1, 2)]
    together = list(vibrident.identify_many(calibrations, estimator="ipnn", device="gpu"))
    require_same([vibrident.identify(one, estimator="ipnn") for one in calibrations], together)
    assert "a descent follows a curved valley" in together[0].settings["device"]


def test_without_a_gpu_it_is_refused_at_once():
    with pytest.raises(InputError, match="No GPU is here") as refused:
        vibrident.identify_many(iter([]), device="gpu")
    assert "jax[cuda12]" in refused.value.remedy
    with pytest.raises(ValueError, match="one worker"):
        vibrident.identify_many([], device="gpu", workers=2)


def test_threads_meet_where_they_fit_and_an_error_stays_with_its_shape():
    batches: list[list[str]] = []

    def descend(some):
        batches.append(sorted(one.name for one in some))
        if some[0].shape == "bad":
            raise NotConverged("no")
        return [f"end of {one.name}" for one in some]

    together, found = Together(descend, 3), {}

    def work(*names):
        for name in names:
            try:
                found[name] = together.trace(SimpleNamespace(name=name, shape=name.rstrip("0123456789")))
            except NotConverged as error:
                found[name] = str(error)
        together.end()

    threads = [threading.Thread(target=work, args=names) for names in (("a1", "a2"), ("a3",), ("bad1", "a4"))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert sorted(batches) == [["a1", "a3"], ["a2", "a4"], ["bad1"]]
    assert found == {**{f"a{i}": f"end of a{i}" for i in (1, 2, 3, 4)}, "bad1": "no"}
