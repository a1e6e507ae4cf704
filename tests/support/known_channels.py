"""Motion that goes on beyond both ends of a record, and channels of known response that see it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vibrident import Calibration, KnownResponse

Response = Callable[[np.ndarray], np.ndarray]
RATE_HZ = 51200.0
#: The sensor under test, and the reference with a resonance of its own in the band.
SENSOR, REFERENCE = (0.01, 4000.0, 0.02), (0.1, 9000.0, 0.03)
POLES = np.roots([1.0, 2.0 * REFERENCE[2] * 2.0 * np.pi * REFERENCE[1], (2.0 * np.pi * REFERENCE[1]) ** 2])


def accelerometer(gain: float, natural_hz: float, damping: float) -> Response:
    """Response per acceleration of an oscillator."""
    return lambda hz: gain / (1.0 - (hz / natural_hz) ** 2 + 2j * damping * hz / natural_hz)


def seismometer(gain: float, natural_hz: float, damping: float) -> Response:
    """Response per velocity of an oscillator that is read by a coil."""
    return lambda hz: gain / (1.0 - (natural_hz / hz) ** 2 - 2j * damping * natural_hz / hz)


class Motion:
    """A motion over four records' length, of which channels show the second quarter."""

    def __init__(self, kind: str, samples: int, rate_hz: float, band_hz: tuple[float, float], seed: int = 1) -> None:
        self.rng, self.rate_hz, self.samples, self.kind = np.random.default_rng(seed), rate_hz, samples, kind
        self.hz = np.fft.rfftfreq(4 * samples, 1.0 / rate_hz)
        self.hz[0] = 1e-9
        self.spectrum = getattr(self, f"_{kind}")(*band_hz)
        self.spectrum[0] = 0.0

    def _random(self, low: float, high: float) -> np.ndarray:
        size = self.hz.size
        noise = self.rng.normal(size=size) + 1j * self.rng.normal(size=size)
        above = np.exp(-0.5 * (np.maximum(self.hz - high, 0.0) / (0.05 * high)) ** 2)
        return noise * above * (1.0 - np.exp(-((self.hz / low) ** 4)))

    def _multisine(self, low: float, high: float) -> np.ndarray:
        lines = np.arange(self.hz.size) % 32 == 0
        phases = np.exp(2j * np.pi * self.rng.uniform(size=self.hz.size))
        return np.where(lines & (self.hz >= low) & (self.hz <= high), phases, 0.0)

    def _sweep(self, low: float, high: float) -> np.ndarray:
        length_s = self.samples / self.rate_hz
        time_s = np.arange(4 * self.samples) / self.rate_hz - length_s
        growth = np.log(high / low) / length_s
        during = (time_s >= 0.0) & (time_s < length_s)
        phase = 2.0 * np.pi * low * np.expm1(growth * np.clip(time_s, 0.0, length_s)) / growth
        above = np.exp(-0.5 * (np.maximum(self.hz - 0.4 * self.rate_hz, 0.0) / (0.02 * self.rate_hz)) ** 2)
        return np.fft.rfft(np.sin(phase) * during) * above

    def _shock(self, _: float, high: float) -> np.ndarray:
        time_s = np.arange(4 * self.samples) / self.rate_hz
        return np.fft.rfft(np.exp(-0.5 * ((time_s - 1.3 * self.samples / self.rate_hz) * high / 0.75) ** 2))

    def channel(self, *responses: Response, noise: float = 0.0) -> np.ndarray:
        """What a channel records behind responses, with white noise relative to its rms."""
        spectrum = self.spectrum.copy()
        for response in responses:
            spectrum *= response(self.hz)
        signal = np.fft.irfft(spectrum)[self.samples : 2 * self.samples]
        return signal + noise * np.std(signal) * self.rng.normal(size=self.samples)


def known_reference(**more: float) -> KnownResponse:
    """What poles and zeros state of the reference."""
    return KnownResponse.from_poles(POLES, (), REFERENCE[0] * (2.0 * np.pi * REFERENCE[1]) ** 2, **more)


def back_to_back(kind: str = "random", *, seed: int = 1, **known: KnownResponse) -> Calibration:
    """The sensor beside the reference, 8192 samples; without ``known`` beside a laser."""
    motion = Motion(kind, 8192, RATE_HZ, (50.0, 9000.0 if kind == "sweep" else 12000.0), seed)
    through = (accelerometer(*REFERENCE),) if "reference_known_response" in known else ()
    response = motion.channel(accelerometer(*SENSOR), noise=1e-3)
    return Calibration.from_arrays([motion.channel(*through)], [response], RATE_HZ, excitation=kind, **known)
