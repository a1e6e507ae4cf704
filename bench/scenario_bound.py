"""The Cramér–Rao bound of a cell with known noise spectra: what no unbiased estimate can beat.

The sensitivities are differences of the exact simulated response. Initial states, offsets, drift
and hum are unknown, so what they could imitate is taken out. With noise of both channels of known
spectra, and the true motion unknown, Y − H X is stationary noise of spectrum S_y + |H|² S_x
(Pintelon & Schoukens 2012, sec. 9.11); its covariance over the samples is a Toeplitz matrix,
inverted exactly. (Line by line the edges of a record would seem to tell of a steep spectrum what
they do not: the bound came out up to 14 times too small.)
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.linalg import solve_toeplitz

from bench.scenario_cells import NOISES, truth
from vibrident.data.records import Record
from vibrident.physics.models import parse
from vibrident.physics.simulation import ChannelNoise, sensor_named

STEP = 1e-5


@functools.lru_cache(maxsize=64)
def bound(sensor_name: str, excitation: str, noise: str) -> np.ndarray | None:
    """Return the least relative standard deviation of each parameter.

    None if the noise is felt by the sensor, and nothing bounds.
    """
    if noise == "a":
        return None
    sensor = sensor_named(sensor_name)
    model = parse(sensor.model)
    names = model.parameter_names
    base = truth(sensor_name, excitation)
    ends = {
        key: [truth(sensor_name, excitation, moved=(key, s * STEP)) for s in (1.0, -1.0)]
        for key in names
    }
    information = np.zeros((len(names), len(names)))
    poles = np.roots(
        np.array(model.rational(dict(sensor.parameters)).denominator[::-1], dtype=float)
    ).astype(complex)
    for index, record in enumerate(base.records):
        columns = np.stack(
            [
                (ends[k][0].records[index].response - ends[k][1].records[index].response)
                / (2.0 * STEP)
                for k in names
            ],
            1,
        )
        level = _level(
            record, NOISES[noise][1], lambda f: model.frequency_response(dict(sensor.parameters), f)
        )
        both = np.column_stack([columns, _nuisance(record, poles, NOISES[noise][1])])
        size = np.sqrt(np.sum(both**2, axis=0))
        inner = (both / size).T @ solve_toeplitz(np.fft.irfft(level)[: record.samples], both / size)
        p = len(names)
        inner = inner[:p, :p] - inner[:p, p:] @ np.linalg.solve(inner[p:, p:], inner[p:, :p])
        information += inner * np.outer(size[:p], size[:p])
    scale = np.sqrt(np.diag(information))
    return np.sqrt(np.diag(np.linalg.inv(information / np.outer(scale, scale)))) / scale


def _nuisance(record: Record, poles: np.ndarray, noise: dict) -> np.ndarray:
    times = record.time_s
    columns = [np.ones_like(times)]
    for pole in poles[np.imag(poles) > 0]:
        decay = np.exp(pole * times)
        columns += [decay.real, decay.imag]
    response = noise.get("response_noise")
    if isinstance(response, ChannelNoise):
        if response.drift:
            columns.append(times / times[-1])
        if response.hum:
            for order in range(1, len(response.hum_harmonics) + 1):
                angle = 2.0 * np.pi * order * response.hum_frequency_hz * times
                if order * response.hum_frequency_hz < 0.5 * record.sampling_rate_hz:
                    columns += [np.cos(angle), np.sin(angle)]
    return np.column_stack(columns)


def _level(record: Record, noise: dict, response) -> np.ndarray:
    """Return the variance of Y − H X a sample, at the lines of twice the record's length."""
    n = record.samples
    lines = np.fft.rfftfreq(2 * n, record.sampling_interval_s)
    lines[0] = lines[1]
    level = np.zeros(len(lines))
    size_x, size_y = (
        np.sqrt(np.mean(np.square(v))) for v in (np.asarray(record.reference), record.response)
    )
    x = noise.get("reference_noise", 0.0)
    y = noise.get("response_noise", 0.0)
    if isinstance(y, ChannelNoise):
        level += (y.white * size_y) ** 2
        if y.flicker:
            order = np.arange(1.0, len(lines))
            level[1:] += (y.flicker * size_y) ** 2 * n / order / np.sum(1.0 / order)
    else:
        level += (y * size_y) ** 2
    return level + (x * size_x) ** 2 * np.abs(response(lines)) ** 2
