"""What is known of a channel: one complex response, whatever states it, and one covariance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrident import InputError, KnownResponse
from vibrident.base import parcel

HZ = np.geomspace(1.0, 1000.0, 31)


def test_poles_and_zeros_are_their_product():
    known = KnownResponse.from_poles([-3.0 + 4.0j, -3.0 - 4.0j], [0.0, -1.0], 7.0)
    s = 2j * np.pi * HZ
    np.testing.assert_allclose(known.value(HZ), 7.0 * s * (s + 1.0) / (s**2 + 6.0 * s + 25.0), rtol=1e-13)


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=9), st.floats(-0.9, 0.9))
def test_a_digital_filter_is_exact_to_rounding(taps, pole):
    """Against the difference equation itself, driven by a long complex exponential."""
    taps = [1.5, *taps]
    known = KnownResponse.from_filter(taps, [1.0, -pole], rate_hz=1000.0)
    hz = 130.0
    driven = np.exp(2j * np.pi * hz / 1000.0 * np.arange(600))
    answer = np.zeros(600, complex)
    forced = np.convolve(driven, taps)[:600]
    for k in range(1, 600):
        answer[k] = forced[k] + pole * answer[k - 1]
    assert known.value(hz) == pytest.approx(answer[-1] / driven[-1], rel=1e-10, abs=1e-12)


def test_corners_are_first_order():
    known = KnownResponse.from_corners([2.0], [300.0], 10.0)
    wanted = 10.0 * (1j * HZ / 2.0) / (1.0 + 1j * HZ / 2.0) / (1.0 + 1j * HZ / 300.0)
    np.testing.assert_allclose(known.value(HZ), wanted, rtol=1e-13)


def test_the_spline_of_a_table_errs_by_the_fourth_power_of_its_steps():
    def worst(points: int) -> float:
        hz = np.geomspace(10.0, 4000.0, points)
        between = np.sqrt(hz[3:-4] * hz[4:-3])
        truth = [1.0 / (1.0 - (f / 2000.0) ** 2 + 0.2j * f / 2000.0) for f in (hz, between)]
        known = KnownResponse.from_table(hz, np.abs(truth[0]), np.angle(truth[0]))
        return float(np.max(np.abs(known.value(between) / truth[1] - 1.0)))

    errors = [worst(points) for points in (600, 1200, 2400)]
    slopes = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(slopes, 4.0, atol=0.1)


def test_what_a_spline_misses_between_points_is_in_the_uncertainty():
    hz = np.geomspace(10.0, 4000.0, 60)
    truth = [1.0 / (1.0 - (f / 2000.0) ** 2 + 0.2j * f / 2000.0) for f in (hz, np.sqrt(hz[1:] * hz[:-1]))]
    known = KnownResponse.from_table(hz, np.abs(truth[0]), np.angle(truth[0]))
    between = np.sqrt(hz[1:] * hz[:-1])
    missed = np.log(known.value(between) / truth[1])
    near = np.argmax(np.abs(missed))
    covariance = np.diag(known.covariance(between))
    u = np.sqrt(covariance[near] + covariance[between.size + near])
    assert np.abs(missed[near]) > 1e-3
    assert 0.3 * u < np.abs(missed[near]) < 3.0 * u


@pytest.mark.parametrize("highpass", [True, False])
def test_the_effect_of_a_corner_is_its_derivative(highpass):
    def made(corner: float) -> KnownResponse:
        corners = ([corner], []) if highpass else ([], [corner])
        return KnownResponse.from_corners(*corners, corner_uncertainty=0.01)

    change = np.log(made(30.0 * 1.001).value(HZ) / made(30.0 / 1.001).value(HZ)) / (2.0 * np.log(1.001)) * 0.01
    covariance = made(30.0).covariance(HZ)
    expected = np.concatenate([change.real, change.imag])
    np.testing.assert_allclose(covariance, np.outer(expected, expected), atol=2e-3 * np.max(covariance))


@pytest.mark.parametrize("octaves", [None, 0.3, 2.0])
def test_the_covariance_of_a_table_is_as_stated(octaves):
    relative, turn = np.linspace(0.001, 0.005, 31), np.full(31, 0.002)
    known = KnownResponse.from_table(
        HZ,
        np.full(31, 2.0),
        np.zeros(31),
        magnitude_uncertainty=2.0 * relative,
        phase_uncertainty_rad=turn,
        correlation_octaves=octaves,
    )
    distance = np.log2(np.divide.outer(HZ, HZ))
    alike = np.ones((31, 31)) if octaves is None else np.exp(-0.5 * (distance / octaves) ** 2)
    covariance = known.covariance(HZ)
    sizes = np.concatenate([relative, turn])
    correlation = covariance / np.outer(sizes, sizes)
    np.testing.assert_allclose(correlation[:31, :31], alike, atol=0.02)
    np.testing.assert_allclose(correlation[31:, 31:], alike, atol=0.02)
    np.testing.assert_allclose(correlation[:31, 31:], 0.0, atol=1e-12)


def test_a_chain_is_a_product_with_both_uncertainties_where_both_are_known():
    one = KnownResponse.from_table([1.0, 10.0, 100.0], [2.0, 2.0, 2.0], [0.0, 0.0, 0.0], magnitude_uncertainty=0.01)
    other = KnownResponse.from_filter([0.5, 0.5], rate_hz=50.0)
    both = one.times(other)
    at = np.array([2.0, 20.0])
    np.testing.assert_allclose(both.value(at), one.value(at) * other.value(at), rtol=1e-14)
    assert both.band_hz == (1.0, 25.0)
    np.testing.assert_allclose(both.covariance(at), one.covariance(at))


def test_it_travels_to_another_process(tmp_path):
    known = KnownResponse.from_table(HZ, HZ, 0.1 * HZ, magnitude_uncertainty=0.1).times(
        KnownResponse.from_poles([-1.0 + 1.0j, -1.0 - 1.0j])
    )
    with (tmp_path / "sent").open("wb") as stream:
        parcel.send(stream, known)
    with (tmp_path / "sent").open("rb") as stream:
        received = parcel.receive(stream, 10**7)
    np.testing.assert_array_equal(received.value(HZ), known.value(HZ))
    assert received.effects == known.effects


BAD = {
    "out of order": lambda: KnownResponse.from_table([1.0, 3.0, 2.0], [1.0] * 3, [0.0] * 3),
    "not positive": lambda: KnownResponse.from_table([1.0, 2.0], [1.0, -1.0], [0.0] * 2),
    "differ in length": lambda: KnownResponse.from_table([1.0, 2.0], [1.0, 1.0], [0.0]),
    "right half plane": lambda: KnownResponse.from_poles([0.1 + 2.0j, 0.1 - 2.0j]),
    "not those of a real channel": lambda: KnownResponse.from_poles([-0.1 + 2.0j]),
    "not stable": lambda: KnownResponse.from_filter([1.0], [1.0, -1.1], rate_hz=10.0),
    "needs the rate": lambda: KnownResponse.from_filter([1.0], rate_hz=0.0),
    "numerator of a known response cannot be used": lambda: KnownResponse.from_filter([0.0], rate_hz=1.0),
    "corners of a conditioner": lambda: KnownResponse.from_corners([-1.0]),
    "uncertainty of a known response": lambda: KnownResponse.from_poles([-1.0], standard_uncertainty=-0.1),
    "no band in common": lambda: KnownResponse.from_table([30.0, 40.0], [1.0, 1.0], [0.0, 0.0]).times(
        KnownResponse.from_filter([1.0], rate_hz=50.0)
    ),
}


@pytest.mark.parametrize("problem", BAD)
def test_a_bad_statement_gets_one_message(problem):
    with pytest.raises(InputError, match=problem):
        BAD[problem]()
