"""The paper's discussion (II): a learned part fitted to the residual of the physics, which stays readable.

The paper's network has no such part. The package's (``ResidualIpnn``) is trained here on sensors of known truth: with a
second mode, with a hardening spring, and without any further effect.
"""

from __future__ import annotations

from dataclasses import dataclass

from vibrident.estimators import Ipnn
from vibrident.estimators.optimise import Progress, silent
from vibrident.estimators.residual_network import ResidualIpnn
from vibrident.identification import identify
from vibrident.prediction import predict
from vibrident.simulation import SENSORS, simulate

RATE_HZ = 12800.0
SAMPLES = 800
#: Of the responses that are trained on, over their rms.
NOISE = 1e-3
#: Frequencies trained on, and others that are predicted.
TRAINED_HZ = (60.0, 125.0, 250.0, 315.0, 400.0, 500.0, 630.0, 800.0, 1000.0)
OTHER_HZ = (80.0, 200.0, 280.0, 450.0, 560.0, 700.0, 900.0, 100.0, 160.0)
PHYSICS = ("sensitivity", "natural_frequency", "damping_ratio")
SHOWN = ("two-mode", "cubic", "paper")


@dataclass(frozen=True)
class Residual:
    """One sensor, without and with the learned part.

    Attributes:
        sensor: its name among the simulated sensors.
        alone: RMSE on records not trained on, noise-free, by the physics alone, response unit.
        together: the same with the learned part.
        share: of the learned part in the output, in the training records.
        errors_alone: relative error by parameter, physics alone.
        errors: relative error by parameter, with the learned part.
        moved: largest relative difference of a parameter between the two.
    """

    sensor: str
    alone: float
    together: float
    share: float
    errors_alone: dict[str, float]
    errors: dict[str, float]
    moved: float


def learned_residuals(*, seed: int, progress: Progress = silent) -> list[Residual]:
    """Every sensor of ``SHOWN``, 0.1 % noise on the responses trained on."""
    found = []
    for number, name in enumerate(SHOWN, start=1):
        found.append(_of(name, seed))
        progress(number, len(SHOWN), found[-1].together)
    return found


def _of(name: str, seed: int) -> Residual:
    common = {"sampling_rate_hz": RATE_HZ, "samples": SAMPLES, "seed": seed}
    trained = simulate(name, frequencies_hz=TRAINED_HZ, response_noise=NOISE, **common)
    others = simulate(name, frequencies_hz=OTHER_HZ, **common)
    plain, whole = (
        identify(trained, "accelerometer", estimator, uncertainty="noise") for estimator in (Ipnn(), ResidualIpnn())
    )
    truth = SENSORS[name].parameters
    values = [{p: float(result.parameters[p].value) for p in PHYSICS} for result in (plain, whole)]
    errors = [{p: found[p] / truth[p] - 1.0 for p in PHYSICS} for found in values]
    return Residual(
        name,
        float(predict(plain, others).rmse or 0.0),
        float(predict(whole, others).rmse or 0.0),
        float(whole.settings["residual_network"]["share"]),
        errors[0],
        errors[1],
        max(abs(values[1][p] / values[0][p] - 1.0) for p in PHYSICS),
    )
