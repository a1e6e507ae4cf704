"""Systematic effects of an interferometer's signals: stated ones, and cyclic errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.effects import SystematicEffect
from vibrident.data.interferometer.demodulation import Demodulated
from vibrident.data.interferometer.effects import Answer, Cyclic, significant
from vibrident.data.interferometer.setting import FloatArray, Interferometer


def cyclic_errors(made: Sequence[Demodulated], setting: Interferometer) -> list[Cyclic | None]:
    """Return the significant cyclic error of each record.

    It is one of the set-up; beside a carrier, whose phase begins anew, each record has its own.
    """
    measured = [found.answer.cyclic for found in made]
    if setting.kind == "quadrature":
        return [significant(measured)] * len(made)
    return [significant([one]) for one in measured]


def left_of(
    errors: Sequence[Cyclic | None], answers: Sequence[Answer], setting: Interferometer
) -> list[tuple[Sequence[Answer], FloatArray]]:
    """Return the covariances of what remains of cyclic errors.

    That is the uncertainty of those taken out, and beside a carrier those that a record does not
    show, of the size of the others' and of unknown phase.
    """
    known = [error for error in errors if error is not None]
    if not known:
        return []
    if setting.kind == "quadrature":
        return [(answers, known[0].covariance)]
    # zero where not significant
    shown = np.array([error.waves for error in known]).reshape(len(known), -1, 2)
    power = np.sum(shown**2, axis=(0, 2)) / np.maximum(
        np.sum(np.any(shown != 0.0, axis=2), axis=0), 1
    )
    found: list[tuple[Sequence[Answer], FloatArray]] = []
    for error, answer in zip(errors, answers, strict=True):
        waves = np.zeros(shown[0].size) if error is None else error.waves
        unknown = np.diag(np.where(waves == 0.0, np.repeat(0.5 * power, 2), 0.0))
        found.append(([answer], unknown if error is None else unknown + error.covariance))
    return found


def stated_effects(setting: Interferometer) -> list[SystematicEffect]:
    """Return the effects that the calibration file states."""
    wavelength = setting.wavelength_relative_uncertainty
    delay_s = setting.delay_standard_uncertainty_s
    found = [
        SystematicEffect("wavelength of the interferometer", "gain", wavelength),
        SystematicEffect("delay of the interferometer", "timing", delay_s),
    ]
    return [effect for effect in found if effect.standard_uncertainty > 0]
