"""Tables that leave little to judge by: what is stated must cover, and where nothing can be stated nothing is."""

from __future__ import annotations

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, ResponseTable
from vibrident.fit.problem import Coordinates
from vibrident.fit.uncertainty import parameter_table, weakly_determined
from vibrident.fit.uncertainty.parameters import fields_of_units
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate

TRUTH = {"sensitivity": 0.1, "natural_frequency": 630.0, "damping_ratio": 0.2}


def table(points: int, seed: int = 1, *, phase: bool = True, noise: float = 0.003) -> Calibration:
    rng = np.random.default_rng(seed)
    frequency = np.geomspace(100.0, 1200.0, points) if points > 1 else np.array([160.0])
    response = parse("accelerometer").frequency_response(TRUTH, frequency)
    magnitude = np.abs(response) * (1.0 + noise * rng.standard_normal(points))
    angle = np.angle(response) + noise * rng.standard_normal(points)
    return Calibration(table=ResponseTable(frequency, magnitude, angle if phase else None))


@pytest.mark.parametrize(("points", "phase"), [(1, True), (2, False), (3, False)])
def test_no_more_values_than_parameters_leave_nothing_to_state(points: int, phase: bool) -> None:
    result = vibrident.identify(table(points, phase=phase))
    assert not result.fit.adequate
    assert set(result.warning_codes) == {"lack_of_fit", "weakly_determined"}
    assert result.warnings[0].message.startswith("It cannot be tested whether the model explains the table")
    for parameter in result.parameters.values():
        assert parameter.standard_uncertainty is None
        assert parameter.interval_95 == (None, None)
        assert not parameter.identifiable
    assert np.isnan(result.response.magnitude_uncertainty).all()
    assert np.isnan(result.measured.magnitude_uncertainty).all()


@pytest.mark.parametrize(("points", "phase"), [(2, True), (3, True), (4, False)])
@pytest.mark.slow
def test_the_intervals_of_few_points_cover(points: int, phase: bool) -> None:
    runs = 120
    inside = np.zeros(3)
    for seed in range(runs):
        found = vibrident.identify(table(points, seed, phase=phase)).parameters
        inside += [found[name].interval_95[0] <= true <= found[name].interval_95[1] for name, true in TRUTH.items()]
    assert np.all(inside / runs > 0.95 - 3.0 * np.sqrt(0.05 * 0.95 / runs)), inside / runs


@pytest.mark.parametrize(("points", "phase"), [(1, True), (2, False)])
def test_such_a_table_does_not_spoil_a_joint_fit(points: int, phase: bool) -> None:
    shape = {"frequencies_hz": np.geomspace(60.0, 1500.0, 15), "samples": 3000, "sampling_rate_hz": 2e4}
    sines = simulate(("accelerometer", TRUTH), "sine", response_noise=1e-3, seed=1, **shape)
    alone = vibrident.identify(sines)
    joint, beside = vibrident.identify_together([sines, table(points, phase=phase, noise=0.02)])
    assert joint.warning_codes == ()
    for name in TRUTH:
        known, found = alone.parameters[name], joint.parameters[name]
        assert found.value == pytest.approx(known.value, abs=1e-3 * known.standard_uncertainty)
        assert found.standard_uncertainty == pytest.approx(known.standard_uncertainty, rel=1e-3)
        assert beside.parameters[name].standard_uncertainty == pytest.approx(known.standard_uncertainty, rel=1e-3)


def test_a_single_sine_leaves_nothing_to_judge_by_either() -> None:
    shape = {"frequencies_hz": [200.0], "samples": 3000, "sampling_rate_hz": 2e4, "response_noise": 1e-3}
    result = vibrident.identify(simulate(("accelerometer", TRUTH), "sine", seed=1, **shape))
    assert not result.fit.adequate
    assert result.fit.degrees_of_freedom < 0
    assert "lack_of_fit" in result.warning_codes


def test_a_parameter_at_the_end_of_its_range_has_no_uncertainty() -> None:
    """Beyond the end of the range the data are not asked, so a slope of zero there is no knowledge."""
    model = parse("accelerometer")
    coordinates = Coordinates.at(model, TRUTH, (100.0, 1200.0))
    z = coordinates.first
    z[1] = coordinates.edges[1][1] + 0.1
    covariance = np.diag([1e-3, 1e-2, 1e-2]) ** 2
    weak, warnings = weakly_determined(coordinates, z, covariance)
    assert [w.code for w in warnings] == ["at_bound"]
    table = parameter_table(coordinates, z, covariance, np.inf, fields_of_units("V", "m/s^2", drive=False), weak)
    for name in ("natural_frequency", "natural_angular_frequency", "resonance_frequency"):
        found = table[name]
        assert (found.standard_uncertainty, found.interval_95, found.identifiable) == (None, (None, None), False)
    assert table["sensitivity"].standard_uncertainty == pytest.approx(1e-4)


@pytest.mark.parametrize(("phase_noise", "delay_s"), [(0.1, 3e-5), (5.0, 1e-5)])
def test_a_phase_without_uncertainty_is_weighed_by_its_scatter(phase_noise: float, delay_s: float) -> None:
    """A certificate that states that of the magnitude alone: it was taken for that of the phase, in rad."""
    outside, noise = [], 0.003
    for seed in range(12):
        rng, exact = np.random.default_rng(seed), table(40, noise=0.0).table
        assert exact is not None
        assert exact.phase_rad is not None
        magnitude = exact.magnitude * (1.0 + noise * rng.standard_normal(40))
        phase = exact.phase_rad + phase_noise * noise * rng.standard_normal(40)
        made = ResponseTable(exact.frequency_hz, magnitude, phase, noise * magnitude)
        result = vibrident.identify(Calibration(table=made))
        assert result.warning_codes == ()
        assert result.settings["uncertainty_covers"].endswith("by its scatter")
        found = result.parameters
        outside += [(found[name].value - true) / found[name].standard_uncertainty for name, true in TRUTH.items()]
    assert np.max(np.abs(outside)) < 4.0
    assert 0.6 < np.std(outside) < 1.5
    late = ResponseTable(
        made.frequency_hz, made.magnitude, made.phase_rad - delay_s * made.frequency_hz, noise * magnitude
    )  # type: ignore[operator]
    rejected = vibrident.identify(Calibration(table=late))  # where a lag shows beyond the scatter, and where not
    assert ("lack_of_fit" in rejected.warning_codes) == (phase_noise == 0.1)
