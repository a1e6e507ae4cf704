"""Laws of a joint fit: what it says of simulated calibrations of one sensor, whose truth is known."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from tests.support.joint_sensors import MECHANICS, SENSITIVITY, pickups, shock, table

import vibrident
from vibrident.data.records import Calibration, SystematicEffect
from vibrident.result import Result

PICKUPS = {"natural_frequency": 4.5, "damping_ratio": 0.6}
Make = Callable[[int], tuple[Calibration, Calibration]]


def two_tables(seed: int) -> tuple[Calibration, Calibration]:
    velocity = MECHANICS | {"generator_constant": 28.0}
    return table(seed), table(seed + 10_000, "velocity-pickup", velocity)


def table_and_shock(seed: int) -> tuple[Calibration, Calibration]:
    return table(seed), shock(seed)


def decays_and_table(seed: int) -> tuple[Calibration, Calibration]:
    """Free decays of another channel, and a table of the same sensor."""
    decays = vibrident.simulate(
        ("accelerometer", MECHANICS | {"sensitivity": 3.0}), "decay",
        sampling_rate_hz=12800.0, samples=512, response_noise=0.03, seed=seed + 500,
    )  # fmt: skip
    return decays, table(seed)


def separate(result: Result, name: str) -> list[float]:
    row = next(row for row in result.settings["joint"]["shared"] if row["name"] == name)
    return [one["standard_uncertainty"] for one in row["separate"].values()]


def error_in_u(result: Result, truth: dict[str, float]) -> np.ndarray:
    """Errors of the shared parameters, turned to be independent and of unit variance, shape (parameters,)."""
    names = list(truth)
    order = [result.correlation.names.index(name) for name in names]
    correlation = np.array(result.correlation.matrix)[np.ix_(order, order)]
    found = [result.parameters[name] for name in names]
    scaled = [(p.value - truth[name]) / (p.standard_uncertainty or 0.0) for p, name in zip(found, names, strict=True)]
    return np.linalg.solve(np.linalg.cholesky(correlation), np.array(scaled))


def uniform_probability(chances: Sequence[float]) -> float:
    from scipy.stats import kstest

    return kstest(chances, "uniform").pvalue


def check_scatter(make: Make, truth: dict[str, float], seeds: Sequence[int]) -> list[float]:
    """Scatter over u is one within three standard errors, u is below each separate one; returns the probabilities."""
    errors, chances = [], []
    for seed in seeds:
        results = vibrident.identify_together(make(seed))
        for name in truth:
            u = [result.parameters[name].standard_uncertainty for result in results]
            assert u[0] == pytest.approx(u[1], rel=1e-9)
            assert u[0] is not None
            assert u[0] < min(separate(results[0], name))
            values = [result.parameters[name].value for result in results]
            assert values[0] == pytest.approx(values[1], rel=1e-12)
        errors.append(error_in_u(results[0], truth))
        chances.append(results[0].settings["joint"]["consistency"]["probability"])
        assert all(one["own_fit_used"] for one in results[0].settings["joint"]["calibrations"])
    squares = np.square(errors)
    assert np.sqrt(np.mean(squares)) == pytest.approx(1.0, abs=3.0 / np.sqrt(2.0 * squares.size))
    return chances


@pytest.mark.draws(15, 30)
def test_two_tables(draws: int) -> None:
    """Probabilities of consistency are uniform where calibrations are consistent."""
    chances = check_scatter(two_tables, MECHANICS, range(draws))
    assert uniform_probability(chances) > 0.01


def test_free_decays_alone_and_a_table() -> None:
    """Decays share natural frequency and damping, whatever the order; the gain stays the table's."""
    check_scatter(decays_and_table, MECHANICS, range(4))
    decays, points = decays_and_table(0)
    by_decay, by_table = vibrident.identify_together([decays, points])
    assert "sensitivity" not in by_decay.parameters
    assert by_table.parameters["sensitivity"].value == pytest.approx(SENSITIVITY["sensitivity"], rel=0.01)
    sources = [row["source"] for row in by_table.settings["uncertainty_budget"]]
    assert sources == ["calibration 1: noise", "calibration 2: stated uncertainties"]
    back = vibrident.identify_together([points, decays])
    for name in MECHANICS:
        assert back[0].parameters[name].value == pytest.approx(by_table.parameters[name].value, rel=1e-9)
    other = vibrident.simulate(
        ("accelerometer", MECHANICS | SENSITIVITY | {"damping_ratio": 0.21}), "decay",
        sampling_rate_hz=25600.0, samples=1024, response_noise=0.01, seed=3,
    )  # fmt: skip
    for result in vibrident.identify_together([points, other]):
        (message,) = [w.message for w in result.warnings if w.code == "estimators_disagree"]
        assert "damping ratio differs most: 0.2" in message


@pytest.mark.parametrize(
    ("make", "truth"), [(table_and_shock, MECHANICS | SENSITIVITY), (pickups, PICKUPS)], ids=["shock", "pickups"]
)
def test_records(make: Make, truth: dict[str, float]) -> None:
    check_scatter(make, truth, range(2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "truth"), [(table_and_shock, MECHANICS | SENSITIVITY), (pickups, PICKUPS)], ids=["shock", "pickups"]
)
def test_many_records(make: Make, truth: dict[str, float]) -> None:
    assert uniform_probability(check_scatter(make, truth, range(100, 300))) > 0.01


@pytest.mark.parametrize("make", [table_and_shock, pickups], ids=["shock", "pickups"])
@pytest.mark.quick("shock")
def test_a_joint_fit_of_one_is_its_own_fit(make: Make) -> None:
    for calibration in make(0):
        (joint,) = vibrident.identify_together([calibration])
        alone = vibrident.identify(calibration)
        assert joint.parameters.keys() == alone.parameters.keys()
        for name, one in alone.parameters.items():
            u = one.standard_uncertainty or 0.0
            assert joint.parameters[name].value == pytest.approx(one.value, abs=1e-3 * u)
            assert joint.parameters[name].standard_uncertainty == pytest.approx(u, rel=1e-3)
        assert joint.warnings == alone.warnings


@pytest.mark.parametrize("make", [table_and_shock, pickups], ids=["shock", "pickups"])
@pytest.mark.quick("shock")
def test_the_order_changes_nothing(make: Make) -> None:
    there = vibrident.identify_together(make(1))
    back = vibrident.identify_together(make(1)[::-1])[::-1]
    for one, other in zip(there, back, strict=True):
        for name, parameter in one.parameters.items():
            u = parameter.standard_uncertainty or 0.0
            assert other.parameters[name].value == pytest.approx(parameter.value, abs=1e-3 * u)
            assert other.parameters[name].standard_uncertainty == pytest.approx(u, rel=1e-4)
    first, second = (results[0].settings["joint"]["consistency"]["chi2"] for results in (there, back))
    assert first == pytest.approx(second, rel=1e-6)


def test_units_change_nothing() -> None:
    """A response in mV is another output by its unit, so that the gains are apart; the mechanics stay."""
    first, second = two_tables(2)
    assert second.table is not None
    scaled = 1e3 * second.table.magnitude
    deviation = 1e3 * np.asarray(second.table.magnitude_uncertainty)
    in_mv = Calibration(
        table=vibrident.ResponseTable(
            second.table.frequency_hz, scaled, second.table.phase_rad, deviation, second.table.phase_uncertainty_rad
        ),
        model=second.model,
        response_unit="mV",
    )
    one, other = vibrident.identify_together([first, second]), vibrident.identify_together([first, in_mv])
    for name in MECHANICS:
        u = one[0].parameters[name].standard_uncertainty or 0.0
        assert other[0].parameters[name].value == pytest.approx(one[0].parameters[name].value, abs=1e-4 * u)
        assert other[0].parameters[name].standard_uncertainty == pytest.approx(u, rel=1e-6)
    gain = [results[1].parameters["generator_constant"] for results in (one, other)]
    assert gain[1].value == pytest.approx(1e3 * gain[0].value, rel=1e-7)


def test_calibrations_that_disagree_are_named_and_the_joint_interval_reaches_both() -> None:
    """Natural frequencies 1 % apart. Without inflation the uncertainties are those of the noise."""
    other = table(1, values=MECHANICS | SENSITIVITY | {"natural_frequency": 1.01 * MECHANICS["natural_frequency"]})
    agreed = vibrident.identify_together([table(0), table(1)])
    results = vibrident.identify_together([table(0), other])
    assert [result.warning_codes for result in agreed] == [(), ()]
    for result in results:
        (message,) = [w.message for w in result.warnings if w.code == "estimators_disagree"]
        assert "The natural frequency differs most" in message
        assert not result.settings["joint"]["consistency"]["consistent"]
        assert "Birge ratio" in message
        low, high = result.parameters["natural_frequency"].interval_95
        shared = {row["name"]: row for row in result.settings["joint"]["shared"]}["natural_frequency"]
        for alone in shared["separate"].values():
            assert low < alone["value"] < high
    of_noise = vibrident.identify_together([table(0), other], uncertainty="noise")
    u = of_noise[0].parameters["natural_frequency"].standard_uncertainty
    assert u == pytest.approx(agreed[0].parameters["natural_frequency"].standard_uncertainty, rel=0.05)
    (message,) = [w.message for w in of_noise[0].warnings if w.code == "estimators_disagree"]
    assert "do not cover" in message


def test_a_systematic_effect_of_both_is_not_averaged() -> None:
    """One reference for both: its uncertainty stays on the gain. Two references: it shrinks by √2. Mechanics: none."""
    relative = 0.02
    plain = vibrident.identify_together([table(0), table(1)])[0]
    common = vibrident.identify_together(
        [table(seed, reference_standard_uncertainty=relative) for seed in (0, 1)]
    )[0]  # fmt: skip
    apart = vibrident.identify_together(
        [table(i, effects=(SystematicEffect(f"voltmeter {i}", "gain", relative),)) for i in (0, 1)]
    )[0]
    noise = plain.parameters["sensitivity"].standard_uncertainty or 0.0
    for result, effective in ((common, relative), (apart, relative / np.sqrt(2.0))):
        gain = result.parameters["sensitivity"]
        assert gain.standard_uncertainty == pytest.approx(np.hypot(noise, effective * gain.value), rel=2e-3)
    for name in MECHANICS:
        u = plain.parameters[name].standard_uncertainty or 0.0
        assert common.parameters[name].standard_uncertainty == pytest.approx(u, rel=1e-9)
        own = apart.parameters[name].standard_uncertainty or 0.0  # their gains differ by less than noise, or by more
        assert 1.0 - 1e-6 < own / u <= 1.0
    for name in MECHANICS | SENSITIVITY:  # what both have in common moves nothing (Peelle's puzzle)
        assert common.parameters[name].value == pytest.approx(plain.parameters[name].value, rel=1e-9)
    rows = [row["kind"] for row in common.settings["uncertainty_budget"]]
    assert rows == ["data", "data", "gain"]


@pytest.mark.draws(6, 60)
def test_the_better_reference_counts_for_what_references_limit(draws: int) -> None:
    """A table of little noise against a poor reference, one of more noise against a good one: errors as stated."""
    errors = []
    for seed in range(draws):
        gains = 1.0 + np.array([0.02, 0.001]) * np.random.default_rng([7, seed]).standard_normal(2)
        poor, good = (
            table(seed + 1000 * i, values=MECHANICS | {"sensitivity": 0.1 * gain},
                  effects=(SystematicEffect(f"reference {i}", "gain", u),))
            for i, (gain, u) in enumerate(zip(gains, (0.02, 0.001), strict=True))
        )  # fmt: skip
        result = vibrident.identify_together([poor, good])[0]
        errors.append(error_in_u(result, MECHANICS | SENSITIVITY))
        assert (result.parameters["sensitivity"].standard_uncertainty or 0.0) < 0.0015 * 0.1
        assert "estimators_disagree" not in result.warning_codes
    squares = np.square(errors)
    assert np.sqrt(np.mean(squares)) == pytest.approx(1.0, abs=3.0 / np.sqrt(2.0 * squares.size))


def test_two_halves_are_the_whole() -> None:
    """Of a table, and of decays."""
    whole = table(3)
    assert whole.table is not None
    halves = [dataclasses.replace(whole, table=of_points(whole.table, part)) for part in (slice(0, 6), slice(6, None))]
    made = [decays_and_table(seed)[0] for seed in (0, 1)]
    both = dataclasses.replace(made[0], records=(*made[0].records, *made[1].records))
    for one, parts in ((whole, halves), (both, made)):
        alone = vibrident.identify(one)
        for joint in vibrident.identify_together(parts):
            for name, parameter in alone.parameters.items():
                u = parameter.standard_uncertainty or 0.0
                assert joint.parameters[name].value == pytest.approx(parameter.value, abs=0.01 * u)
                assert joint.parameters[name].standard_uncertainty == pytest.approx(u, rel=0.01)


def of_points(given: vibrident.ResponseTable, part: slice) -> vibrident.ResponseTable:
    names = ("magnitude", "phase_rad", "magnitude_uncertainty", "phase_uncertainty_rad")
    return dataclasses.replace(
        given, frequency_hz=given.frequency_hz[part], **{name: getattr(given, name)[part] for name in names}
    )


def test_each_takes_from_the_other_what_it_lacks() -> None:
    """Three points far below resonance tell the gain alone; with a table of the resonance all is known."""
    low = table(0, frequency_hz=np.array([20.0, 25.0, 31.5]))
    alone, whole = vibrident.identify(low), table(1)
    assert "weakly_determined" in alone.warning_codes
    joint, _ = vibrident.identify_together([low, whole])
    best = vibrident.identify(whole)
    for name, truth in (MECHANICS | SENSITIVITY).items():
        parameter = joint.parameters[name]
        assert parameter.identifiable
        u, known = parameter.standard_uncertainty or 0.0, best.parameters[name].standard_uncertainty or 0.0
        assert u < 1.001 * known
        assert abs(parameter.value - truth) < 4.0 * u
    assert joint.parameters["sensitivity"].standard_uncertainty < 0.95 * (
        best.parameters["sensitivity"].standard_uncertainty or 0.0
    )
