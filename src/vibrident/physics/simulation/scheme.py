"""Frequencies, random streams, motions and sampling rates of a calibration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.nominal import nominal_name
from vibrident.data.records import FloatArray
from vibrident.physics.simulation.checks import (
    require,
    require_choice,
    require_finite,
    require_positive,
    require_usable,
)
from vibrident.physics.simulation.excitation import (
    BandLimitedRandom,
    Decay,
    HalfSineShock,
    Multisine,
    Sine,
    Sweep,
    random_phases,
)
from vibrident.physics.simulation.motion import Motion, SampleGrid, Superposition, acceleration_on
from vibrident.physics.simulation.noise import excitation_noise

#: A limit may be a nominal value, up to 1.2 % (0.05 steps) from the exact one.
_LIMIT_TOLERANCE_STEPS = 0.1
#: Streams of one record. The numbers define what a seed means; never reuse one.
PURPOSES = {"excitation": 0, "excitation noise": 1, "reference": 2, "response": 3, "optics": 4}
Seed = int | np.random.SeedSequence
KINDS = ("sine", "multisine", "sweep", "random", "shock", "decay")
#: Period of a random excitation over the length of the record.
RANDOM_PERIOD_RATIO = 1.25
#: Fewest samples of a shock's pulse.
MIN_SHOCK_SAMPLES = 4


def one_third_octave(low_hz: float, high_hz: float) -> FloatArray:
    """Return the exact one-third-octave frequencies 10^(n/10) Hz within limits.

    Args:
        low_hz: lower limit, included, Hz, exact or nominal (12.5 means 12.589…).
        high_hz: upper limit, included, Hz, exact or nominal.

    Returns:
        Ascending, shape (points,): 21 for 10 to 1000 Hz, 41 for 0.1 to 1000 Hz.

    Raises:
        InputError: a limit is not positive, or no frequency lies between them.

    Examples:
        >>> import vibrident
        >>> vibrident.one_third_octave(100.0, 200.0).round(2).tolist()
        [100.0, 125.89, 158.49, 199.53]
    """
    require_positive("one_third_octave", low_hz=low_hz, high_hz=high_hz)
    first = math.ceil(10.0 * math.log10(low_hz) - _LIMIT_TOLERANCE_STEPS)
    last = math.floor(10.0 * math.log10(high_hz) + _LIMIT_TOLERANCE_STEPS)
    require(
        first <= last,
        "No one-third-octave frequency lies in this range.",
        expected="a lower and a higher limit, with a frequency 10^(n/10) Hz between them",
        found=f"{low_hz:g} to {high_hz:g} Hz",
        where="one_third_octave",
        remedy="widen the range",
    )
    return np.array([10.0 ** (n / 10.0) for n in range(first, last + 1)])


def nominal_frequency_name(frequency_hz: float) -> str:
    """Return the nominal name of an exact one-third-octave frequency, any other as it is."""
    return nominal_name(frequency_hz) or f"{frequency_hz:.6g}"


def stream(seed: int | np.random.SeedSequence, record: int, purpose: str) -> np.random.Generator:
    """Return the generator of a record's stream, as ``SeedSequence(seed).spawn`` would give it.

    Added records change no other.

    ``seed``: of the whole calibration; for Monte Carlo one seed (or spawned sequence) a run;
    ``record``: index of the record; ``purpose``: key of ``PURPOSES``.
    """
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    key = (*root.spawn_key, record, PURPOSES[purpose])
    return np.random.default_rng(
        np.random.SeedSequence(root.entropy, spawn_key=key, pool_size=root.pool_size)
    )


@dataclass(frozen=True)
class Take:
    """Record to be made: name, motion and sampling."""

    name: str
    motion: Motion
    sampling_rate_hz: float
    samples: int

    @property
    def duration_s(self) -> float:
        """Return the length of the record, s."""
        return self.samples / self.sampling_rate_hz

    def checked(self) -> Take:
        """Return the take itself, if its sampling resolves its motion."""
        where = f"record {self.name!r}"
        half = 0.5 * self.sampling_rate_hz
        require(
            self.motion.highest_hz < half,
            "The excitation has frequencies above half the sampling rate.",
            expected=f"below {half:g} Hz (half the sampling rate)",
            found=f"{self.motion.highest_hz:g} Hz",
            where=where,
            remedy="lower the frequency, or raise sampling_rate_hz",
        )
        last = max(self.motion.breaks_s, default=0.0)
        require(
            last <= self.duration_s * (1.0 + 1e-9),
            "The excitation does not fit into the record.",
            expected=f"an end within {self.duration_s:g} s",
            found=f"{self.motion.words}, to {last:g} s",
            where=where,
            remedy="raise samples, or shorten the excitation",
        )
        if isinstance(self.motion, HalfSineShock):
            across = self.motion.duration_s * self.sampling_rate_hz
            require(
                across >= MIN_SHOCK_SAMPLES,
                "The shock is too short for the sampling rate.",
                expected=f"at least {MIN_SHOCK_SAMPLES} samples a pulse",
                found=f"{across:.3g} samples in {self.motion.duration_s:g} s",
                where=where,
                remedy="lengthen the pulse, or raise sampling_rate_hz",
            )
        return self


@dataclass(frozen=True)
class SimulationSettings:
    """Common settings of a calibration's takes; named as in ``simulate``."""

    frequencies_hz: FloatArray
    sampling_rate_hz: float
    samples: int
    amplitude: float
    natural_frequency_hz: float
    seed: Seed

    def __post_init__(self) -> None:
        require_positive("simulate", sampling_rate_hz=self.sampling_rate_hz)
        require_finite("simulate", amplitude=self.amplitude)
        is_usable = isinstance(self.samples, int | np.integer) and self.samples >= 8
        require_usable(is_usable, "samples", self.samples, "a whole number from 8", "simulate")

    @property
    def duration_s(self) -> float:
        """Return the length of a record, s."""
        return self.samples / self.sampling_rate_hz

    def takes(self, excitation: str | Motion | Sequence[Motion], repeats: int) -> list[Take]:
        """Return the records to be made, each motion ``repeats`` times in turn."""
        require_usable(repeats >= 1, "repeats", repeats, "a whole number from 1", "simulate")
        if isinstance(excitation, str):
            require_choice("The excitation", excitation, KINDS)
            motions = [
                motion for turn in range(repeats) for motion in self._named(excitation, turn)
            ]
        else:
            motions = list(excitation) if isinstance(excitation, Sequence) else [excitation]
            motions = motions * repeats
        names = [
            f"{nominal_frequency_name(motion.frequency_hz)} Hz"
            if isinstance(motion, Sine)
            else motion.kind
            for motion in motions
        ]
        pairs = zip(_distinct(names), motions, strict=True)
        return [
            Take(name, motion, self.sampling_rate_hz, self.samples).checked()
            for name, motion in pairs
        ]

    def _named(self, kind: str, turn: int) -> list[Motion]:
        """Return the motions of a kind of excitation; ``turn``: which of the repeats."""
        low = float(np.min(self.frequencies_hz))
        high = float(np.max(self.frequencies_hz))
        rms = self.amplitude / np.sqrt(2.0)
        if kind == "sine":
            return [Sine(float(f), self.amplitude, -0.5 * np.pi) for f in self.frequencies_hz]
        if kind == "multisine":
            count = len(self.frequencies_hz)
            phases = random_phases(count, stream(self.seed, turn, "excitation"))
            share = self.amplitude / np.sqrt(count)
            return [Multisine(tuple(self.frequencies_hz), (share,) * count, phases)]
        if kind == "sweep":
            return [Sweep(low, high, self.duration_s, self.amplitude, law="log")]
        if kind == "random":
            phases_seed = int(stream(self.seed, turn, "excitation").integers(2**63))
            return [
                BandLimitedRandom(
                    low, high, rms, phases_seed, RANDOM_PERIOD_RATIO * self.duration_s
                )
            ]
        if kind == "shock":
            pulse = max(1.0 / self.natural_frequency_hz, 20.0 / self.sampling_rate_hz)
            return [HalfSineShock(self.amplitude, pulse, 0.1 * self.duration_s)]
        return [Decay(self.amplitude)]


def with_excitation_noise(
    take: Take, rng: np.random.Generator, snr_db: float, band_hz: tuple[float, float] | None
) -> Take:
    """Return the take with noise motion on top of its excitation; arguments as of ``simulate``.

    Raises:
        InputError: the record is a free decay, which has no reference, or the noise cannot be made.
    """
    require_finite("simulate", excitation_snr_db=snr_db)
    require(
        not isinstance(take.motion, Decay),
        "A free decay has no excitation to add noise to.",
        expected="an excitation that moves the base",
        found="decay",
        where=f"record {take.name!r}",
        remedy="leave excitation_snr_db out, or use response_noise",
    )
    rate = take.sampling_rate_hz
    samples = take.samples
    clean = acceleration_on(take.motion, SampleGrid(0.0, rate, samples))
    rms = float(np.sqrt(np.mean(np.square(clean)))) * 10.0 ** (-snr_db / 20.0)
    noise = excitation_noise(rms, sampling_rate_hz=rate, samples=samples, rng=rng, band_hz=band_hz)
    return replace(take, motion=Superposition((take.motion, noise)))


def _distinct(names: list[str]) -> list[str]:
    """Return the names, repeated ones with a number."""
    counts: dict[str, int] = {}
    distinct = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        distinct.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return distinct
