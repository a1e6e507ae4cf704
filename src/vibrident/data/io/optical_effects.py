"""Systematic effects of an interferometer's signals: stated ones, and cyclic errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.effects import SystematicEffect
from vibrident.data.interferometer.demodulation import Demodulated
from vibrident.data.interferometer.effects import CyclicError, PhaseErrorResponse, significant
from vibrident.data.interferometer.setting import FloatArray, Interferometer


def cyclic_errors(
    demodulated: Sequence[Demodulated], setting: Interferometer
) -> list[CyclicError | None]:
    """Return the significant cyclic error of each record.

    Quadrature signals share the error of their set-up. The phase of a carrier begins anew in each
    record, so that each heterodyne record has an error of its own.
    """
    measured = [light.answer.cyclic for light in demodulated]
    if setting.kind == "quadrature":
        return [significant(measured)] * len(demodulated)
    return [significant([error]) for error in measured]


def remaining_covariances(
    errors: Sequence[CyclicError | None],
    answers: Sequence[PhaseErrorResponse],
    setting: Interferometer,
) -> list[tuple[Sequence[PhaseErrorResponse], FloatArray]]:
    """Return the covariances of what remains of cyclic errors.

    For errors that were removed, it is that of their estimates. Heterodyne records whose error is
    not significant get an error of unknown phase and of the size of the others'.
    """
    estimated = [error for error in errors if error is not None]
    if not estimated:
        return []
    if setting.kind == "quadrature":
        return [(answers, estimated[0].covariance)]
    # zero where not significant
    all_waves = np.array([error.waves for error in estimated]).reshape(len(estimated), -1, 2)
    power = np.sum(all_waves**2, axis=(0, 2)) / np.maximum(
        np.sum(np.any(all_waves != 0.0, axis=2), axis=0), 1
    )
    remaining: list[tuple[Sequence[PhaseErrorResponse], FloatArray]] = []
    for error, answer in zip(errors, answers, strict=True):
        waves = np.zeros(all_waves[0].size) if error is None else error.waves
        unknown = np.diag(np.where(waves == 0.0, np.repeat(0.5 * power, 2), 0.0))
        remaining.append(([answer], unknown if error is None else unknown + error.covariance))
    return remaining


def stated_effects(setting: Interferometer) -> list[SystematicEffect]:
    """Return the effects that the calibration file states."""
    wavelength = setting.wavelength_relative_uncertainty
    delay_s = setting.delay_standard_uncertainty_s
    effects = [
        SystematicEffect("wavelength of the interferometer", "gain", wavelength),
        SystematicEffect("delay of the interferometer", "timing", delay_s),
    ]
    return [effect for effect in effects if effect.standard_uncertainty > 0]
