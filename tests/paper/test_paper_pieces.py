"""The pieces of the reproduction: data, metrics, windows, networks, least squares and the bound, each on its own."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrident.base.backend import jax
from vibrident.base.errors import InputError, NotConverged
from vibrident.paper import published
from vibrident.paper.black_box import Recurrent
from vibrident.paper.bound import cramer_rao
from vibrident.paper.dataset import (
    RUN_OUT,
    SCORED,
    SENSOR,
    WARM_UP_STEPS,
    Dataset,
    cut,
    outliers,
    prepare,
    simulate_section_4,
)
from vibrident.paper.experiment import MSV_3000, VIBROMETER, interferometer, seismometer
from vibrident.paper.least_squares import from_sine_fits
from vibrident.paper.metrics import Metrics, curve_deviation
from vibrident.paper.studies import optimum
from vibrident.paper.training import Schedule, train
from vibrident.paper.unrolled import START, unrolled
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.models.state_space import realise
from vibrident.physics.network.cell import Cell, run
from vibrident.physics.simulation import simulate

TRUTH = dict(SENSOR.parameters)


@pytest.fixture(scope="module")
def data() -> Dataset:
    return simulate_section_4(seed=3, samples=4000)


def test_the_dataset_is_the_papers(data: Dataset):
    records = data.calibration.records
    assert len(records) == 21
    assert (records[0].frequency_hz, records[-1].frequency_hz) == pytest.approx((10.0, 1000.0))
    assert (len(data.training), len(data.test)) == (17, 4)
    assert not set(data.training) & set(data.test)
    for record, motion in zip(records, data.motions, strict=True):
        sine, noise = (part.tones for part in motion.terms)  # type: ignore[attr-defined]
        ratio = np.sum(np.abs(sine.phasor) ** 2) / np.sum(np.abs(noise.phasor) ** 2)
        assert 10.0 * np.log10(ratio) == pytest.approx(20.0, abs=0.6)
        assert record.response[0] == 0.0  # at rest


def test_one_scale_a_channel_fills_the_range_and_keeps_zero_and_the_sensitivity(data: Dataset):
    training = [data.calibration.records[i] for i in data.training]
    for unit, signals in (
        (data.reference.unit, [np.asarray(r.reference) for r in training]),
        (data.response.unit, [r.response for r in training]),
    ):
        assert max(np.abs(signal).max() for signal in signals) / unit == pytest.approx(1.0, rel=1e-15)


def test_the_same_seed_gives_the_same_bytes_and_another_gives_others(data: Dataset):
    assert simulate_section_4(seed=3, samples=4000).sha256 == data.sha256
    assert simulate_section_4(seed=4, samples=4000).sha256 != data.sha256


def test_records_of_the_full_range_cover_their_periods_and_runge_kutta_meets_the_exact_sensor():
    whole = simulate_section_4(seed=3, samples=800, full_range=True)
    assert len(whole.calibration.records) == 41
    assert whole.calibration.records[0].sampling_rate_hz == pytest.approx(512.0)
    for record in whole.calibration.records[:21]:
        assert record.duration_s * (record.frequency_hz or 0.0) == pytest.approx(800 / 5120)  # 3.1 periods of 16 000
    index = 5  # 0.316 Hz, sampled far too slowly for one step of RK4 a sample
    record, motion = whole.calibration.records[index], whole.motions[index]
    exact = simulate(SENSOR, motion, sampling_rate_hz=record.sampling_rate_hz, samples=800).records[0]
    assert np.max(np.abs(record.response - exact.response)) < 1e-3 * np.std(exact.response)


def test_clean_records_have_no_outliers_and_spikes_are_found_and_mended(data: Dataset):
    assert data.outliers == 0
    records = list(data.calibration.records)
    spoilt = np.array(records[18].reference)
    for sample in (100, 2000, 3500):
        spoilt[sample] += 15.0
    records[18] = replace(records[18], reference=spoilt)
    assert np.flatnonzero(outliers(spoilt)).tolist() == [100, 2000, 3500]
    mended = prepare(replace(data.calibration, records=tuple(records)), seed=3)
    assert mended.outliers == 3
    fixed = mended.calibration.records[18]
    assert not fixed.mask[[100, 2000, 3500]].any()
    usual = np.std(np.diff(np.asarray(data.calibration.records[18].reference)))
    assert np.abs(np.asarray(fixed.reference) - data.calibration.records[18].reference).max() < 4.0 * usual


def test_records_that_cannot_be_split_are_refused(data: Dataset):
    with pytest.raises(InputError, match="split"):
        prepare(replace(data.calibration, records=data.calibration.records[:1]), seed=0)


@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e3))
def test_metrics_obey_their_laws(seed: int, size: float):
    rng = np.random.default_rng(seed)
    measured = rng.standard_normal(50)
    m = Metrics.from_samples(measured, measured + size * rng.standard_normal(50))
    assert m.mae <= m.rmse
    assert m.mse == pytest.approx(m.rmse**2)
    assert m.r2 == pytest.approx(1.0 - 1.0 / m.rpd**2)


def test_the_papers_own_tables_break_them():
    rows = [*published.TABLE_4.values(), *published.TABLE_5.values()]
    broken = [row for row in rows if row.mae > row.rmse or abs(row.mse - row.rmse**2) > 1e-4]
    assert len(broken) == 6


def test_scored_samples_of_the_windows_meet_without_gap_or_overlap(data: Dataset):
    training, held_back = cut(data)
    per_record = (4000 - WARM_UP_STEPS - RUN_OUT) // SCORED
    assert len(training.targets) + len(held_back.targets) == 17 * per_record
    assert np.all(training.score[:, :WARM_UP_STEPS] == 0.0)
    assert np.all(training.score[:, WARM_UP_STEPS:] == 1.0)
    first = data.calibration.records[data.training[0]].response / data.response.unit
    assert np.array_equal(training.targets[0], first[: WARM_UP_STEPS + SCORED])
    assert np.array_equal(training.targets[1], first[SCORED : WARM_UP_STEPS + 2 * SCORED])


@pytest.mark.parametrize("name", ["euler", "bandlimited"])
def test_the_batched_network_is_the_cell(name: str, rng: np.random.Generator):
    step = method(name).weights(realise(parse("accelerometer").rational(TRUTH)), 1e-5, 0.0, 1 if name == "euler" else 3)
    inputs = rng.standard_normal((60, step.drive.shape[1], 4))
    batched = np.asarray(unrolled(step.table(), jnp.asarray(inputs)))
    for column in range(4):
        alone = np.asarray(run(Cell.from_weights(step), jnp.asarray(inputs[:, :, column])))
        assert np.allclose(batched[:, column], alone, rtol=1e-10, atol=1e-14)
    bent = Cell.from_weights(step)._replace(activation=jnp.tanh)
    alone = np.asarray(run(bent, jnp.asarray(inputs[:, :, 0])))
    assert np.allclose(np.asarray(unrolled(step.table(), jnp.asarray(inputs), "tanh"))[:, 0], alone, rtol=1e-10)


@pytest.mark.parametrize(("kind", "weights"), [("gru", 832), ("lstm", 1104)])
def test_recurrent_networks_have_no_bias(kind, weights: int):
    network = Recurrent(kind, seed=1)
    assert network.weights == weights
    answer = jax.jit(lambda inputs: network(inputs))
    assert np.all(np.asarray(answer(np.zeros((20, 3)))) == 0.0)  # a bias would show
    assert answer(np.ones((20, 3))).shape == (20, 3)


def test_training_stops_by_its_rule_and_keeps_the_best(rng: np.random.Generator):
    inputs = rng.standard_normal((72, 4))
    windows = (inputs, inputs @ np.array([0.1, -0.2, 0.05, 0.0]))
    schedule = Schedule(learning_rate=0.001, batch=72, patience=60, most_epochs=4000)
    losses: list[list[float]] = [[], []]
    both = [
        train(
            jnp.zeros(4), lambda w, b: jnp.mean((b[0] @ w - b[1]) ** 2), windows, windows, schedule,
            rng=np.random.default_rng(1), few=few, progress=lambda _, __, loss, few=few: losses[few].append(loss),
        )
        for few in (False, True)
    ]  # fmt: skip
    for trained, held_back in zip(both, losses, strict=True):
        assert trained.converged
        best_epoch = len(trained.training) - schedule.patience
        assert min(held_back[best_epoch:]) > 0.99 * held_back[best_epoch - 1]
        lowest = np.mean((windows[0] @ np.asarray(trained.model) - windows[1]) ** 2)
        assert lowest == pytest.approx(held_back[best_epoch - 1], rel=1e-6)  # the best epoch's weights
        assert trained.model == pytest.approx([0.1, -0.2, 0.05, 0.0], abs=1e-4)
    assert np.allclose(both[0].model, both[1].model, atol=1e-9)  # forwards and backwards are one derivative


def test_plain_least_squares_finds_a_clean_sensor_and_says_where_it_cannot():
    clean = simulate(SENSOR, "sine", samples=4000, start="steady")
    assert from_sine_fits(clean) == pytest.approx(TRUTH, rel=1e-6)
    with pytest.raises(NotConverged, match="no stable oscillator"):
        from_sine_fits(simulate("inverted", "sine", samples=600, response_noise=3.0, frequencies_hz=[900.0, 1000.0]))


def test_the_optimum_of_the_plain_loss_under_euler_errs_in_proportion_to_the_step():
    near = {key: TRUTH[key] * START[key] for key in TRUTH}
    errors = []
    for rate in (51200.0, 102400.0):
        calibration = simulate(
            SENSOR,
            "sine",
            frequencies_hz=[100.0, 500.0, 630.0, 800.0],
            sampling_rate_hz=rate,
            samples=round(0.02 * rate),
        )
        errors.append(
            curve_deviation(parse("accelerometer"), optimum(calibration, "euler", near), TRUTH, (10.0, 1e3)).mean
        )
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.2)


def test_the_bound_scales_with_noise_and_falls_with_the_root_of_the_data(data: Dataset):
    records, motions = data.calibration.records[10:20:3], data.motions[10:20:3]
    once = cramer_rao(SENSOR, records, motions).deviations(0.01)
    twice = cramer_rao(SENSOR, [*records, *records], [*motions, *motions]).deviations(0.01)
    for name, value in once.items():
        assert twice[name] == pytest.approx(value / np.sqrt(2.0), rel=1e-9)
        assert cramer_rao(SENSOR, records, motions).deviations(0.02)[name] == pytest.approx(2.0 * value)


def test_the_interferometer_is_noisy_quantised_late_and_differentiated_right():
    made = interferometer(seed=5, samples=3000)
    assert made.simulated
    velocity, acceleration = made.recorded.calibration, made.published.calibration
    assert velocity.quantity == "velocity"
    assert velocity.records[0].reference_full_scale == pytest.approx(10.0 * VIBROMETER)
    step = 2.0 * 10.0 * VIBROMETER / 2**24
    counts = np.asarray(velocity.records[3].reference) / step
    assert np.allclose(counts, np.rint(counts), atol=1e-6)
    record = acceleration.records[13]
    tone = 2.0 * np.pi * (record.frequency_hz or 0.0) * record.time_s
    basis = np.stack([np.cos(tone), np.sin(tone)], axis=1)
    fitted = np.linalg.lstsq(basis, np.asarray(record.reference), rcond=None)[0]
    assert np.hypot(*fitted) == pytest.approx(9.80665, rel=2e-3)
    assert MSV_3000.parameters["delay"] < 0.0


def test_without_measured_records_there_is_no_measured_section(tmp_path):
    assert seismometer(tmp_path, seed=1) is None
