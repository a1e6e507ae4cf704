"""Laws of the noise that is read from residuals of a group, against noise of known size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from vibrident.fit.noise.reading import GroupNoise, read_noise
from vibrident.fit.noise.residuals import Residuals
from vibrident.fit.noise.surroundings import level_of_noise, with_resonances

Rows = NDArray[np.complex128]
Curve = NDArray[np.float64]

COLOURS = ("white", "pink", "brown", "ar2")
RECORDS = 21
SAMPLES = 8000
BINS = 700
#: Bins of motion.
MOVED = slice(1, 480)
PLACE = np.maximum(np.arange(BINS), 1.0)


class Drawn(NamedTuple):
    """Records, their noise, and g |H|²."""

    residual: Rows
    predicted: Rows
    reference: Rows
    through: Curve
    noise: Curve

    def read(self) -> GroupNoise:
        records, bins = self.residual.shape
        count = np.full(records, float(SAMPLES))
        through = np.atleast_2d(self.through)
        own = self.residual, self.predicted, count, np.zeros(records), through, self.reference
        return read_noise(Residuals(*own), bins - 1)

    def power(self) -> Curve:
        return np.asarray(np.abs(self.residual) ** 2 / SAMPLES)


def transfer(natural: float, damping: float = 0.2) -> Rows:
    """Response of a sensor whose natural frequency lies at this bin."""
    over = PLACE / natural
    return np.asarray(1.0 / (1.0 - over**2 + 2j * damping * over))


def colour(kind: str) -> Curve:
    """Spectrum of noise whose mean over the motion's bins is one."""
    turn = np.exp(-2j * np.pi * PLACE / SAMPLES)
    spectra = {
        "white": np.ones(BINS),
        "pink": 1.0 / PLACE,
        "brown": 1.0 / PLACE**2,
        "ar2": np.abs(1.0 - 1.9 * np.cos(0.2) * turn + 0.9025 * turn**2) ** -2.0,
    }
    return np.asarray(spectra[kind] / np.mean(spectra[kind][MOVED]))


def gaussian(rng: np.random.Generator, records: int = RECORDS) -> Rows:
    """Transforms of white noise of unit variance."""
    parts = rng.standard_normal((2, records, BINS))
    return np.asarray(np.sqrt(SAMPLES / 2.0) * (parts[0] + 1j * parts[1]))


def draw(
    seed: int, through: Rows, of_response: Curve, of_reference: Curve, every: int = 1, moved: slice = MOVED
) -> Drawn:
    """Records of random motion in a part of the bins, at every so many of these."""
    rng = np.random.default_rng(seed)
    motion = np.zeros((RECORDS, BINS), complex)
    motion[:, moved][:, ::every] = gaussian(rng)[:, moved][:, ::every] * np.sqrt(every)
    reference = motion + gaussian(rng) * np.sqrt(of_reference)
    response = through * motion + gaussian(rng) * np.sqrt(of_response)
    predicted = through * reference
    power = np.abs(through) ** 2
    noise = of_response + of_reference * power
    return Drawn(response - predicted, predicted, reference, power, noise)


def octaves(values: Curve) -> tuple[Curve, Curve]:
    """Mean over octaves of bins and records, and the number of bins in each."""
    edges = 2 ** np.arange(int(np.log2(BINS)) + 1)
    counts = np.diff(np.append(edges, BINS - 1)).astype(float)
    sums = np.add.reduceat(np.mean(values[:, : BINS - 1], axis=0), edges)
    return sums / counts, counts


NONE = np.zeros(BINS)
#: A sensor whose natural frequency lies in, above and below the motion's band.
NATURAL = (160.0, 2000.0, 4.0)


@pytest.mark.parametrize("natural", NATURAL)
@pytest.mark.parametrize("kind", COLOURS)
def test_whitened_residual_has_power_one_in_every_octave(kind: str, natural: float) -> None:
    """Noise of the response, 1 % of it: χ²/ν within four sampling errors and 6 %."""
    through = transfer(natural)
    size = np.mean(np.abs(through[MOVED]) ** 2)
    drawn = draw(1, through, 1e-4 * size * colour(kind), NONE)
    ratio, counts = octaves(drawn.power() / drawn.read().psd)
    assert np.all(np.abs(ratio - 1.0) < 4.0 / np.sqrt(counts * RECORDS) + 0.06)


@pytest.mark.parametrize("natural", NATURAL[:2])
@pytest.mark.parametrize("kind", COLOURS)
def test_so_it_has_beside_noise_of_the_reference(kind: str, natural: float) -> None:
    """Noise of 3 % of the reference: χ²/ν within four sampling errors and 10 %."""
    through = transfer(natural)
    drawn = draw(2, through, np.full(BINS, 1e-5), 9e-4 * colour(kind))
    ratio, counts = octaves(drawn.power() / drawn.read().psd)
    assert np.all(np.abs(ratio - 1.0) < 4.0 / np.sqrt(counts * RECORDS) + 0.1)


@pytest.mark.parametrize("kind", COLOURS)
def test_spectrum_is_unbiased_and_scatters_as_its_bins_say(kind: str) -> None:
    """A mean over 2 · 22 bins, of which the projection takes a quarter, scatters by 17 %.

    It smooths the steep side of AR(2) noise by a few per cent.
    """
    drawn = draw(3, transfer(160.0), 1e-4 * colour(kind), NONE)
    ratio = (drawn.read().psd / drawn.noise)[:, 100:-50]
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.08)
    assert np.std(ratio) < 0.25


@pytest.mark.parametrize("natural", [60.0, 400.0])
def test_noise_of_the_reference_is_found_where_nothing_moves(natural: float) -> None:
    """σx² within 10 % on average, within 60 % of each record, and its doubt covers what is left."""
    drawn = [draw(seed, transfer(natural), np.full(BINS, 1e-5), np.full(BINS, 9e-4)) for seed in (4, 5)]
    noises = [each.read() for each in drawn]
    ratio = np.concatenate([noise.input_noise for noise in noises]) / 9e-4
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.1)
    assert np.all(np.abs(ratio - 1.0) < 0.6)
    assert all(np.all(noise.free) for noise in noises)
    beyond = [np.abs(each.input_noise - 9e-4) > each.doubt[:, 100] for each in noises]
    assert np.mean(beyond) < 0.15


@pytest.mark.parametrize("kind", COLOURS[:3])
def test_noise_of_the_reference_has_its_colour_where_it_is_hidden(kind: str) -> None:
    """Motion hides it in a fifth of the bins; read as white, 1/f noise would be a tenth of itself in the lowest."""
    true = 9e-4 * colour(kind)
    noise = draw(9, transfer(300.0), np.full(BINS, 1e-7), true, moved=slice(1, 140)).read()
    ratio = np.median(noise.input_noise_at / true, axis=0)
    assert np.all(np.abs(np.log(ratio[2:140])) < np.log(2.0))


@pytest.mark.parametrize("natural", NATURAL)
@pytest.mark.parametrize("kind", COLOURS)
def test_noise_of_the_response_is_none_of_the_reference(kind: str, natural: float) -> None:
    """Whatever its colour: at most one in 21 records, and never much."""
    through = transfer(natural)
    drawn = draw(6, through, 1e-4 * np.mean(np.abs(through[MOVED]) ** 2) * colour(kind), NONE)
    noise = drawn.read()
    assert np.sum(noise.input_noise > 0.0) <= 1


def test_misfit_that_is_smooth_does_not_count() -> None:
    """A gain and a delay that are 30 % off leave the noise as it is."""
    drawn = draw(7, transfer(160.0), np.full(BINS, 1e-6), NONE)
    turn = 0.3 * np.exp(2e-3j * PLACE)
    wrong = drawn._replace(residual=drawn.residual + turn * drawn.predicted, predicted=drawn.predicted * (1.0 - turn))
    ratio = wrong.read().psd / drawn.read().psd
    assert np.median(ratio) == pytest.approx(1.0, abs=0.03)
    assert np.mean(np.abs(ratio - 1.0) > 0.3) < 0.03


def test_wrong_model_does_not_make_its_own_noise() -> None:
    """One mode for a sensor of two: weighted by what is read, the misfit stands far above one."""
    one, two = transfer(160.0), transfer(300.0, 0.05)
    drawn = draw(8, one + 0.5 * two, np.full(BINS, 1e-5), NONE)
    predicted = one * drawn.reference
    wrong = drawn._replace(
        residual=drawn.residual + drawn.predicted - predicted,
        predicted=predicted,
        through=np.abs(one) ** 2,
    )
    noise = wrong.read()
    weight = noise.excited[:, MOVED] / noise.psd[:, MOVED]
    assert np.mean(wrong.power()[:, MOVED] * weight) > 10.0


def test_noise_has_resonances_narrower_than_the_mean_around() -> None:
    """A peak of AR(2) noise 13 bins wide: on its top noise is at most 1.8 of the level, not 3.4."""
    bins = 500
    turn = np.exp(-1j * np.pi * np.arange(bins) / bins)
    radius = 0.96
    pole = radius * np.exp(0.9j)
    spectrum = np.abs((1.0 - pole * turn) * (1.0 - pole.conjugate() * turn)) ** -2.0
    rng = np.random.default_rng(15)
    power = spectrum * rng.exponential(size=(400, bins))
    freedom = np.ones(power.shape)
    wide = level_of_noise(power, freedom)
    level = with_resonances(wide, power, freedom)
    top = np.abs(np.arange(bins) - np.argmax(spectrum)) < 3
    assert np.mean((power / wide)[:, top]) > 3.0
    assert 1.0 < np.mean((power / level)[:, top]) < 1.8


def test_white_noise_has_no_resonances() -> None:
    """Of the bins of white noise a hundredth lies in one by chance, and the mean level stays."""
    power = np.random.default_rng(16).exponential(size=(2000, 500))
    wide = level_of_noise(power, np.ones(power.shape))
    level = with_resonances(wide, power, np.ones(power.shape))
    assert np.mean(level != wide) < 0.02
    assert np.mean(level) == pytest.approx(np.mean(wide), rel=0.01)


def test_resonance_narrower_than_a_block_is_followed_with_noise_of_the_reference() -> None:
    """Noise of the reference behind a resonance three bins wide: χ²/ν is one on its top too."""
    drawn = draw(9, transfer(300.0, 0.005), np.full(BINS, 1e-5), np.full(BINS, 9e-4))
    top = slice(298, 303)
    ratio = np.mean((drawn.power() / drawn.read().psd)[:, top])
    assert ratio == pytest.approx(1.0, abs=0.4)


def test_lines_of_a_multisine_that_are_fitted_whole_leave_weights_finite() -> None:
    """Three lines in a block are explained whole: they say nothing of the noise, the others all."""
    drawn = draw(10, transfer(160.0), np.full(BINS, 1e-4), NONE, every=8)
    ratio, counts = octaves(drawn.power() / drawn.read().psd)
    assert np.all(np.abs(ratio - 1.0) < 4.0 / np.sqrt(counts * RECORDS) + 0.06)


def test_hum_is_found_at_its_place_and_nothing_where_there_is_none() -> None:
    """A tone between two bins: its place within a fiftieth of a bin; of 20 others no tone."""
    drawn = draw(11, transfer(160.0), np.full(BINS, 1e-4), NONE)
    place = 571.3
    turns = place - np.arange(BINS)
    tone = 0.1 * SAMPLES * np.exp(1j * np.pi * turns) * np.sinc(turns)
    residual = drawn.residual.copy()
    residual[3] += tone
    noise = drawn._replace(residual=residual).read()
    assert [len(tones) for number, tones in enumerate(noise.tones) if number != 3] == [0] * 20
    assert noise.tones[3][0] == pytest.approx(place, abs=0.02)


def test_records_do_not_know_each_other() -> None:
    """Read together, by themselves, and in parts that stay in the cache: the same."""
    drawn = draw(12, transfer(160.0), 1e-4 * colour("pink"), np.full(BINS, 1e-4))
    residual, predicted, reference = (np.concatenate([rows] * 3) for rows in drawn[:3])
    many = Drawn(residual, predicted, reference, drawn.through, drawn.noise)
    together, alone, parts = (
        drawn.read(),
        drawn._replace(**{name: getattr(drawn, name)[4:5] for name in ("residual", "predicted", "reference")}).read(),
        many.read(),
    )
    for name in ("psd", "input_noise", "input_noise_at", "doubt", "excited", "free"):
        rows = getattr(together, name)
        np.testing.assert_allclose(getattr(alone, name)[0], rows[4], rtol=1e-9)
        np.testing.assert_allclose(getattr(parts, name)[:RECORDS], rows, rtol=1e-9)
    each = drawn._replace(through=np.broadcast_to(drawn.through, (RECORDS, BINS))).read()
    np.testing.assert_allclose(each.psd, together.psd, rtol=1e-9)


def test_noise_scales_with_the_square_of_the_response() -> None:
    """In another unit of the response: levels by its square, weights and places as they are."""
    drawn = draw(13, transfer(160.0), 1e-4 * colour("pink"), np.full(BINS, 9e-4))
    unit = 2.0**20
    scaled = drawn._replace(
        residual=drawn.residual * unit,
        predicted=drawn.predicted * unit,
        through=drawn.through * unit**2,
    ).read()
    noise = drawn.read()
    np.testing.assert_allclose(scaled.psd, noise.psd * unit**2, rtol=1e-5)
    np.testing.assert_allclose(scaled.input_noise, noise.input_noise, rtol=1e-5)
    np.testing.assert_allclose(scaled.excited, noise.excited, atol=1e-5)


def test_few_samples_have_one_level() -> None:
    """Of 100 samples no spectrum is read."""
    rng = np.random.default_rng(14)
    residual = np.fft.rfft(rng.standard_normal((2, 100)))
    known = np.full(2, 100.0), np.array([0.0, 9.0]), np.ones((1, 51))
    noise = read_noise(Residuals(residual, 10.0 * residual, *known, residual), 40)
    level = np.mean(np.abs(residual[:, 1:40]) ** 2, axis=1) / 100.0
    assert np.ptp(noise.psd, axis=1) == pytest.approx(0.0)
    assert noise.psd[0, 0] == pytest.approx(level[0], rel=0.1)
    assert noise.psd[1, 0] == 9.0


def test_noiseless_records_get_their_floor() -> None:
    """No residual at all: the level is the floor, and nothing is infinite."""
    drawn = draw(15, transfer(160.0), NONE, NONE)
    records = np.full(RECORDS, float(SAMPLES)), np.full(RECORDS, 1e-12)
    known = *records, drawn.through[None], drawn.reference
    rows = Residuals(np.zeros_like(drawn.residual), drawn.predicted, *known)
    noise = read_noise(rows, BINS - 1)
    np.testing.assert_allclose(noise.psd, 1e-12)
    assert np.all(np.isfinite(noise.doubt))
    assert np.all(noise.input_noise == 0.0)


def test_noise_is_no_less_in_fewer_bins_than_numbers_were_fitted() -> None:
    """Noise behind a displacement rises by f⁴: a fit followed the lowest two bins, read as noiseless."""
    rng = np.random.default_rng(16)
    steep = PLACE**4 / BINS**4
    drawn = rng.standard_normal((2, 3, BINS))
    residual = np.sqrt(0.5 * SAMPLES * steep) * (drawn[0] + 1j * drawn[1])
    motion = np.exp(2j * np.pi * rng.random((3, BINS))) * np.sqrt(SAMPLES)
    known = np.full(3, float(SAMPLES)), np.zeros(3), steep[None], motion
    fitted = np.array([0.0, 6.0, 12.0])
    psd = read_noise(Residuals(residual, 10.0 * motion, *known, fitted=fitted), BINS - 1).psd
    for row, count in enumerate(fitted.astype(int)):
        rising = np.sort(psd[row, 1:])
        assert np.count_nonzero(rising == rising[0]) == count + 1
        assert rising[0] == pytest.approx(steep[count + 1], rel=1.0)
