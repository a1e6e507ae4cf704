"""Make two sets of data for the paper's section 5, whose own data are private.

``interferometer`` is simulated: a sensor of the MSV 3000 type on a shaker, whose motion a laser
vibrometer of 50 (mm/s)/V measures with noise and delay; 24-bit converters of ±10 V on both
channels.

``seismometer`` is measured: the sine steps of an SM-3 seismometer with a laser on its mass.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vibrident.data.io import read
from vibrident.data.records import Calibration, FloatArray, Record
from vibrident.data.screening import screen
from vibrident.paper.dataset import SENSOR, Dataset, prepare, reference_signal
from vibrident.physics.simulation import ChannelNoise, Sensor, simulate

#: Scale of the vibrometer (OFV-552 with its controller), (m/s)/V, as the paper states it.
VIBROMETER = 0.050
#: Full scale and resolution of the converter.
FULL_SCALE_V = 10.0
BITS = 24
#: Noise of the velocity, (m/s)/√Hz. This and the next four are assumed, because the paper does not
#: state them.
VELOCITY_NOISE = 1e-7
#: Noise of the sensor's channel, V rms.
RESPONSE_NOISE_V = 1e-4
#: Delay of the vibrometer behind the sensor's channel, s.
VIBROMETER_DELAY_S = 5e-6
#: Sine over the vibration of the shaker itself, dB, and the band of that vibration, Hz.
SHAKER_DB = 40.0
SHAKER_BAND_HZ = (5.0, 4000.0)
#: The vibrometer is later than the response, so the response's delay relative to it is negative.
MSV_3000 = Sensor(
    "msv3000",
    "MSV 3000 type, simulated",
    "accelerometer+delay",
    {**SENSOR.parameters, "delay": -VIBROMETER_DELAY_S},
)
#: Filter from velocity to acceleration: half its length in samples, upper edge in Hz, Kaiser's β.
_HALF_LENGTH = 80
_EDGE_HZ = 5000.0
_KAISER_BETA = 9.0


@dataclass(frozen=True, eq=False)
class Experiment:
    """A set of data for section 5, prepared in two ways.

    Attributes:
        title: name of the data, stating whether measured or simulated.
        simulated: True for simulated data.
        recorded: reference as recorded, for the methods that model its quantity.
        published: reference as acceleration (or drive), for the methods that need it so.
        truth: true parameters, if known.
    """

    title: str
    simulated: bool
    recorded: Dataset
    published: Dataset
    truth: dict[str, float] | None


def interferometer(*, seed: int, rate_hz: float = 51200.0, samples: int = 16000) -> Experiment:
    """Return a calibration by a simulated vibrometer, 21 sines of 1 g from 10 to 1000 Hz."""
    white = VELOCITY_NOISE * np.sqrt(rate_hz / 2.0)
    limit = FULL_SCALE_V * VIBROMETER
    calibration = simulate(
        MSV_3000,
        "sine",
        sampling_rate_hz=rate_hz,
        samples=samples + 2 * _HALF_LENGTH,
        quantity="velocity",
        start="steady",
        excitation_snr_db=SHAKER_DB,
        excitation_noise_band_hz=SHAKER_BAND_HZ,
        reference_noise=ChannelNoise(white=white, unit="channel", full_scale=limit, bits=BITS),
        response_noise=ChannelNoise(
            white=RESPONSE_NOISE_V, unit="channel", full_scale=FULL_SCALE_V, bits=BITS
        ),
        seed=seed,
    )
    recorded = replace(calibration, records=tuple(map(_crop, calibration.records)))
    published = replace(
        calibration,
        records=tuple(map(_differentiate, calibration.records)),
        quantity="acceleration",
        reference_unit="m/s^2",
    )
    return Experiment(
        "simulated interferometer calibration of an MSV 3000 type sensor",
        True,
        prepare(recorded, seed=seed),
        prepare(published, seed=seed),
        dict(MSV_3000.parameters),
    )


def _crop(record: Record) -> Record:
    """Remove the samples at both ends that the differentiator needs."""
    span = slice(_HALF_LENGTH, record.samples - _HALF_LENGTH)
    return replace(
        record,
        reference=reference_signal(record)[span],
        response=record.response[span],
        valid=record.mask[span],
    )


def _differentiate(record: Record) -> Record:
    """Convert velocity to acceleration by a band-limited differentiator up to ``_EDGE_HZ``."""
    acceleration = np.convolve(
        reference_signal(record), _differentiator(record.sampling_rate_hz), mode="valid"
    )
    return replace(_crop(record), reference=acceleration)


def _differentiator(rate_hz: float) -> FloatArray:
    """Return the impulse response of jω below the edge, in 1/s; shape (2 · half + 1,)."""
    n = np.arange(-_HALF_LENGTH, _HALF_LENGTH + 1)
    x = 2.0 * _EDGE_HZ / rate_hz * n
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(n == 0, 0.0, (np.cos(np.pi * x) - np.sinc(x)) / np.where(n == 0, 1.0, x))
    return (2.0 * _EDGE_HZ) ** 2 / rate_hz * slope * np.kaiser(2 * _HALF_LENGTH + 1, _KAISER_BETA)


#: Meaning of the columns of the SM-3's files, which their header states wrongly.
_SEISMOMETER = """
[sensor]
manufacturer = "SM-3"
type = "electrodynamic seismometer, vertical; pickup: laser on the mass"
serial_number = "SN001"
model = "accelerometer+delay"
[reference]
column = 3
quantity = "drive"
scale = 0.9425e-6
unit = "V"
[response]
column = 5
scale = 0.95066e-9
unit = "m"
full_scale = 8.255e6
[sampling]
time_column = "Seconds"
[[records]]
file = "*Hz.csv"
excitation = "sine"
"""


def seismometer(data: Path, *, seed: int) -> Experiment | None:
    """Return the sine steps of an SM-3 seismometer, drive to laser.

    None if the folder ``data`` holds no ``sm3``.
    """
    folder = data / "sm3"
    if not any(folder.glob("*Hz.csv")):
        return None
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(temporary) / "sm3-laser.toml"
        file.write_text(
            _SEISMOMETER.replace("*Hz.csv", f"{folder.resolve().as_posix()}/*Hz.csv"),
            encoding="utf-8",
        )
        calibration = read(file)
    records, _ = screen(calibration.records)
    records = [replace(record, name=Path(record.name).stem.replace("_", ".")) for record in records]
    dataset = prepare(_centre(replace(calibration, records=tuple(records))), seed=seed)
    return Experiment(
        "measured: SM-3 seismometer, laser on its mass", False, dataset, dataset, None
    )


def _centre(calibration: Calibration) -> Calibration:
    """Subtract the mean of each channel: networks without bias cannot represent an offset."""
    records = []
    for record in calibration.records:
        reference = reference_signal(record) - reference_signal(record)[record.mask].mean()
        response = record.response - record.response[record.mask].mean()
        provenance = record.provenance.then("means taken off")
        records.append(
            replace(record, reference=reference, response=response, provenance=provenance)
        )
    return replace(calibration, records=tuple(records))
