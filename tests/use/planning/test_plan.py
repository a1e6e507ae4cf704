"""Plans against the estimator that carries them out, and optimal choices against the theory of optimal design."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.records import ResponseTable, SystematicEffect
from vibrident.fit.estimators import MaximumLikelihood
from vibrident.fit.problem import Evidence
from vibrident.physics.models import parse
from vibrident.physics.simulation import SENSORS, ChannelNoise, one_third_octave, simulate, with_noise
from vibrident.show import methods
from vibrident.use.planning import Recording
from vibrident.use.planning.design import best_points, best_weights, efficiency, loss

PAPER = dict(SENSORS["paper"].parameters)
GEOPHONE = dict(SENSORS["geophone"].parameters)
BAND = one_third_octave(100.0, 2000.0)
RECORDING = Recording(25600.0, 2000, response_noise=0.01, reference_noise=0.005)

#: Model, parameters, frequencies, recording.
CASES = {
    "paper": ("accelerometer", PAPER, BAND, RECORDING),
    "delay": ("accelerometer+delay", {**PAPER, "delay": 4e-5}, BAND, RECORDING),
    "geophone": (
        "velocity-pickup",
        GEOPHONE,
        one_third_octave(2.0, 100.0),
        Recording(1000.0, 4000, response_noise=0.002, reference_noise=0.01),
    ),
}


def carried_out(case: str, runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and stated standard uncertainties of so many simulated calibrations, both (runs, p)."""
    model, values, frequencies, how = CASES[case]
    clean = simulate(
        (model, values),
        "sine",
        frequencies_hz=frequencies,
        sampling_rate_hz=how.sampling_rate_hz,
        samples=how.samples,
        start="steady",
    )
    rows = []
    for seed in range(runs):
        noisy = with_noise(clean, response_noise=how.response_noise, reference_noise=how.reference_noise, seed=seed)
        found = vibrident.identify(noisy, estimator="ml").parameters
        rows.append([(found[name].value, found[name].standard_uncertainty) for name in values])
    table = np.array(rows, dtype=float)
    return table[:, :, 0], table[:, :, 1]


def planned(case: str) -> tuple[np.ndarray, np.ndarray]:
    """Standard uncertainties and covariance of a plan, in the order of the parameters."""
    model, values, frequencies, how = CASES[case]
    found = vibrident.plan(model, values, frequencies_hz=frequencies, recording=how)
    u = np.array([found.parameters[name].standard_uncertainty for name in values])
    order = [found.correlation.names.index(name) for name in values]
    return u, np.array(found.correlation.matrix)[np.ix_(order, order)] * np.outer(u, u)


def test_the_plan_states_what_identify_will_state() -> None:
    estimates, stated = carried_out("paper", 4)
    u, covariance = planned("paper")
    np.testing.assert_allclose(np.median(stated, axis=0) / u, 1.0, atol=0.10)
    off = estimates - np.array(list(CASES["paper"][1].values()))
    # Mahalanobis distance of 4 × 3 independent numbers: χ² with 12 degrees of freedom, 1e-4 at either side
    distance = np.einsum("ri,ij,rj->", off, np.linalg.inv(covariance), off)
    assert 1.43 < distance < 39.1


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_planned_uncertainty_is_the_scatter_of_many_calibrations(case: str) -> None:
    estimates, stated = carried_out(case, 400)
    u, _ = planned(case)
    # 400 runs tell a standard deviation to 3.5 %
    np.testing.assert_allclose(np.std(estimates, axis=0) / u, 1.0, atol=0.10)
    np.testing.assert_allclose(np.median(stated, axis=0) / u, 1.0, atol=0.10)


def test_a_planned_table_is_exact() -> None:
    """The covariance of a table's fit at the truth is the plan's."""
    f = one_third_octave(10.0, 1000.0)
    truth = np.abs(2.0 * 500.0**2 / (500.0**2 - f**2 + 2j * 0.3 * 500.0 * f))
    phase = np.angle(1.0 / (500.0**2 - f**2 + 2j * 0.3 * 500.0 * f))
    table = ResponseTable(f, truth, phase, 0.002 * truth, np.full(f.shape, 0.003))
    found = vibrident.identify(vibrident.Calibration(table=table))
    values = {"sensitivity": 2.0, "natural_frequency": 500.0, "damping_ratio": 0.3}
    plan = vibrident.plan(
        "accelerometer", values, frequencies_hz=f, magnitude_uncertainty=0.002, phase_uncertainty_rad=0.003
    )
    for name in values:
        expected = found.parameters[name].standard_uncertainty
        assert plan.parameters[name].standard_uncertainty == pytest.approx(expected, rel=1e-5)
    assert plan.parameters["resonance_frequency"].value == pytest.approx(500.0 * np.sqrt(1 - 2 * 0.09))
    again = vibrident.plan(found, magnitude_uncertainty=0.002, phase_uncertainty_rad=0.003)
    alike = vibrident.plan(found)  # points as good as its own
    four = vibrident.plan(found, times_as_long=4.0)
    for name in values:
        u = plan.parameters[name].standard_uncertainty
        assert again.parameters[name].standard_uncertainty == pytest.approx(u, rel=1e-4)
        assert four.parameters[name].standard_uncertainty == pytest.approx(
            0.5 * alike.parameters[name].standard_uncertainty, rel=1e-9
        )


def test_a_plan_from_a_result_keeps_what_more_data_do_not_reduce() -> None:
    """Gains common to all points are stated as in the result, however many points and however long the records."""
    made = simulate("paper", "sine", frequencies_hz=BAND, sampling_rate_hz=25600.0, samples=2000, response_noise=1e-3)
    gain, timing = SystematicEffect("amplifier", "gain", 0.006), SystematicEffect("cable", "timing", 1e-7)
    found = vibrident.identify(replace(made, reference_standard_uncertainty=0.008, effects=(gain, timing)))
    for longer in (1.0, 100.0):
        planned = vibrident.plan(found, times_as_long=longer)
        assert planned.parameters["sensitivity"].standard_uncertainty == pytest.approx(
            found.parameters["sensitivity"].standard_uncertainty, rel=0.01
        )
        assert "leaves out systematic effects of the calibration: cable." in planned.warnings[-1]
    rejected = vibrident.plan(replace(found, fit=replace(found.fit, adequate=False)))
    assert "rejected the model" in rejected.warnings[-1]
    without = vibrident.plan(found, reference_uncertainty=0.0)
    noise = found.settings["uncertainty_budget"][0]["contributions"]
    for name, u in noise.items():
        if not found.parameters[name].derived:
            assert without.parameters[name].standard_uncertainty == pytest.approx(u, rel=0.3)


def test_a_plan_of_the_same_again_states_the_same_where_noise_has_one_level() -> None:
    """Over the gain it is least within the resonance, and grows below a high-pass: smoothed away, the natural frequency
    had 1.7 times its uncertainty."""
    values = {**PAPER, "highpass_frequency": 50.0}
    noise = ChannelNoise(white=0.01, unit="channel")
    made = simulate(
        ("accelerometer+highpass", values), "sine", frequencies_hz=np.geomspace(5.0, 1000.0, 12),
        sampling_rate_hz=5000.0, samples=5000, start="steady", response_noise=noise, seed=3,
    )  # fmt: skip
    found = vibrident.identify(made, model="accelerometer+highpass")
    planned = vibrident.plan(found)
    for name in values:
        u = found.parameters[name].standard_uncertainty
        assert planned.parameters[name].standard_uncertainty == pytest.approx(u, rel=0.1)


def u_of(plan: object) -> np.ndarray:
    return np.array([p.standard_uncertainty / abs(p.value) for p in plan.parameters.values() if not p.derived])  # type: ignore[attr-defined]


def test_laws_of_length_noise_amplitude_and_units() -> None:
    def plan(
        values: dict[str, float] = PAPER, f: np.ndarray = BAND, amplitude: float = 10.0, **more: float
    ) -> np.ndarray:
        settings = {"sampling_rate_hz": 25600.0, "samples": 8000, "response_noise_rms": 1e-3, **more}
        return u_of(
            vibrident.plan(
                "accelerometer", values, frequencies_hz=f, amplitude=amplitude, recording=Recording(**settings)
            )
        )

    base = plan()
    np.testing.assert_allclose(plan(samples=32000), 0.5 * base, rtol=0.02)  # the noise is known a little better, too
    np.testing.assert_allclose(plan(response_noise_rms=2e-3), 2.0 * base, rtol=1e-9)
    np.testing.assert_allclose(plan(amplitude=30.0), base / 3.0, rtol=1e-9)
    scaled = {**PAPER, "sensitivity": -1e3 * PAPER["sensitivity"]}
    np.testing.assert_allclose(plan(scaled, response_noise_rms=1.0), base, rtol=1e-9)
    slow = {**PAPER, "natural_frequency": 0.01 * PAPER["natural_frequency"]}
    np.testing.assert_allclose(plan(slow, 0.01 * BAND, sampling_rate_hz=256.0), base, rtol=1e-6)


def test_the_reference_counts_once_and_for_the_gain_alone() -> None:
    def plan(systematic: float) -> dict[str, float]:
        found = vibrident.plan(
            "accelerometer", PAPER, frequencies_hz=BAND, recording=RECORDING, reference_uncertainty=systematic
        )
        return {name: p.standard_uncertainty / abs(p.value) for name, p in found.parameters.items()}

    without, with_it = plan(0.0), plan(0.003)
    assert with_it["sensitivity"] == pytest.approx(np.hypot(without["sensitivity"], 0.003))
    assert with_it["natural_frequency"] == pytest.approx(without["natural_frequency"])


def test_what_will_be_weakly_determined_is_said() -> None:
    """Far below resonance with a free delay, damping and delay trade against each other, as in the real table."""
    values = {"sensitivity": 0.2277, "natural_frequency": 51e3, "damping_ratio": 0.08, "delay": 0.0}
    below = vibrident.plan(
        "accelerometer+delay",
        values,
        frequencies_hz=one_third_octave(100.0, 20e3),
        magnitude_uncertainty=0.003,
        phase_uncertainty_rad=0.009,
    )
    assert not below.parameters["damping_ratio"].identifiable
    assert any("damping ratio" in w and "delay" in w for w in below.warnings)
    around = vibrident.plan(
        "accelerometer+delay",
        values,
        frequencies_hz=one_third_octave(400.0, 80e3),
        magnitude_uncertainty=0.003,
        phase_uncertainty_rad=0.009,
    )
    assert around.parameters["damping_ratio"].identifiable
    assert around.warnings == ()


def information(seed: int, points: int, order: int) -> np.ndarray:
    rows = np.random.default_rng(seed).standard_normal((points, 2, order))
    return np.einsum("kri,krj->kij", rows, rows)


@pytest.mark.parametrize("criterion", ["D", "A"])
@pytest.mark.parametrize("repeats", [False, True])
def test_exchange_finds_what_trying_all_finds(criterion: str, repeats: bool) -> None:
    for seed in range(4):
        many, scale = information(seed, 10, 3), np.array([1.0, 0.5, 2.0])
        every = itertools.combinations_with_replacement if repeats else itertools.combinations
        counts = [np.bincount(pick, minlength=10) for pick in every(range(10), 4)]
        least = min(loss(np.einsum("k,kij->ij", c, many), criterion, scale) for c in counts)
        found = best_points(many, 4, criterion, scale, repeats=repeats)
        assert found.sum() == 4
        assert repeats or found.max() == 1
        assert loss(np.einsum("k,kij->ij", found, many), criterion, scale) == pytest.approx(least, abs=1e-9)


def test_best_weights_obey_the_equivalence_theorem() -> None:
    """Kiefer & Wolfowitz 1960: at the D-optimum the variance function tr(M⁻¹ F_k) is at most p, p in its support."""
    many = information(7, 30, 4)
    weights = best_weights(many, "D", np.ones(4))
    variance = np.einsum("kij,ji->k", many, np.linalg.inv(np.einsum("k,kij->ij", weights, many)))
    assert weights.sum() == pytest.approx(1.0)
    assert variance.max() < 4.0 * (1.0 + 1e-5)
    np.testing.assert_allclose(variance[weights > 0.02], 4.0, rtol=1e-3)


@pytest.mark.parametrize("criterion", ["D", "A"])
@pytest.mark.quick("D")
def test_choices_are_better_than_spread_ones_and_near_the_best(criterion: str) -> None:
    settings = {"frequencies_hz": BAND, "recording": RECORDING, "criterion": criterion}
    few = vibrident.plan("accelerometer", PAPER, best=6, **settings)
    free = vibrident.plan("accelerometer", PAPER, best=6, repeats=True, **settings)
    assert sum(few.uses) == sum(free.uses) == 6
    assert max(few.uses) == 1
    assert 0.5 < few.efficiency <= free.efficiency + 1e-6 <= 1.0 + 2e-6
    assert free.efficiency > 0.95
    names = list(few.spread)
    chosen = np.array([few.parameters[name].standard_uncertainty for name in names])
    spread = np.array([few.spread[name] for name in names])
    size = np.array([abs(few.parameters[name].value) for name in names])
    if criterion == "A":
        assert np.sum((chosen / size) ** 2) < np.sum((spread / size) ** 2)
    else:
        assert np.prod(chosen) < np.prod(spread)
    assert efficiency(np.ones(4, int), information(1, 4, 3), "D", np.ones(3)) <= 1.0 + 1e-6


def test_a_line_is_best_measured_at_its_ends() -> None:
    """A textbook case: for a straight line, half the points at either end (Fedorov 1972)."""
    x = np.linspace(-1.0, 1.0, 11)
    many = np.einsum("ki,kj->kij", np.stack([np.ones(11), x], 1), np.stack([np.ones(11), x], 1))
    found = best_points(many, 6, "D", np.ones(2), repeats=True)
    np.testing.assert_array_equal(found, [3, *[0] * 9, 3])
    assert efficiency(found, many, "D", np.ones(2)) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(
    "wrong",
    [
        {"frequencies_hz": None},
        {"frequencies_hz": [0.0, 10.0, 20.0]},
        {"recording": None},
        {"best": 1},
        {"best": 99},
        {"criterion": "E"},
        {"amplitude": [1.0, 2.0]},
        {"amplitude": 0.0},
        {"frequencies_hz": [100.0, 12000.0]},
        {"quantity": "jerk"},
        {"parameters": {"sensitivity": 1.0}},
        {"parameters": {**PAPER, "natural_frequency": -1.0}},
        {"magnitude_uncertainty": 0.01},
    ],
)
def test_bad_input(wrong: dict[str, object]) -> None:
    settings: dict[str, object] = {"parameters": PAPER, "frequencies_hz": BAND, "recording": RECORDING, **wrong}
    with pytest.raises(InputError):
        vibrident.plan("accelerometer", **settings)  # type: ignore[arg-type]


def test_bad_recordings() -> None:
    for wrong in ({"samples": 4}, {"sampling_rate_hz": 0.0}, {"response_noise": 0.0}, {"response_noise": -1.0}):
        with pytest.raises(InputError):
            Recording(**{"sampling_rate_hz": 1000.0, "samples": 1000, "response_noise": 0.1, **wrong})  # type: ignore[arg-type]


def test_a_resonance_sharper_than_the_points_is_said() -> None:
    """Free motion that outlasts a record takes of the tone beside it; a resonance between points may be missed."""
    sharp = {"sensitivity": 1.0, "natural_frequency": 800.0, "damping_ratio": 0.003}
    how = Recording(25600.0, 2000, response_noise=0.005)
    found = vibrident.plan("accelerometer", sharp, frequencies_hz=BAND, recording=how)
    assert any("rings on" in text for text in found.warnings)
    assert any("No point lies within the resonance" in text for text in found.warnings)
    near = int(np.argmin(np.abs(found.frequency_hz - 800.0)))
    assert found.relative_deviation[near] > 1.1 * np.median(found.relative_deviation)
    damped = vibrident.plan("accelerometer", sharp | {"damping_ratio": 0.3}, frequencies_hz=BAND, recording=how)
    assert damped.warnings == ()
    np.testing.assert_allclose(damped.relative_deviation, found.relative_deviation[0], rtol=0.02)


@pytest.mark.parametrize("noise", [{"reference_noise": 0.005}, {"response_noise": 0.005}])
@pytest.mark.quick("noise1")
def test_planned_for_a_sharp_sensor_as_the_right_optimum_scatters(noise: dict[str, float]) -> None:
    """From the truth as start, eight calibrations scatter as planned: the optimum is what a search may miss."""
    values = {"sensitivity": 1.0, "natural_frequency": 712.0, "damping_ratio": 0.003}
    how = Recording(25600.0, 8000, **noise)
    found = vibrident.plan("accelerometer", values, frequencies_hz=BAND, recording=how)
    clean = simulate(
        ("accelerometer", values), "sine", frequencies_hz=BAND, sampling_rate_hz=25600.0, samples=8000, start="steady"
    )
    off = []
    for seed in range(8):
        evidence = Evidence.gather(with_noise(clean, seed=seed, **noise), parse("accelerometer"))
        estimate = MaximumLikelihood(model_error=False).fit(replace(evidence, start=values))
        got = estimate.coordinates.values(estimate.z)
        off.append([(got[n] - values[n]) / found.parameters[n].standard_uncertainty for n in values])
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5


def test_a_delay_of_zero_has_one_unit_in_its_row_and_short_records_not_chosen_are_no_doubt() -> None:
    values = {"sensitivity": 0.01, "natural_frequency": 5000.0, "damping_ratio": 0.05, "delay": 0.0}
    recording = Recording(51200.0, 10000, response_noise=1e-3)
    candidates = one_third_octave(10.0, 5000.0)
    plan = vibrident.plan("accelerometer+delay", values, frequencies_hz=candidates, recording=recording, best=5)
    row = next(row for row in methods.planned(plan).rows if row[0] == "delay")
    u, unit, alternatives = float(row[2]), row[3], [float(text) for text in row[5:]]
    assert unit == "ps"
    assert all(0.1 * u < alternative < 100.0 * u for alternative in alternatives)
    has_short = bool(np.any(plan.frequency_hz * 10000 / 51200.0 < 5.0))
    assert any("fewer than 5 periods" in text for text in plan.warnings) == has_short
