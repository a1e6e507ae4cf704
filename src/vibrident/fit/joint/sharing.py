"""The parameters that calibrations share, and each calibration's coordinates in the joint fit.

A sensor's mechanics are common to all outputs: natural frequency, damping ratio and those of a
second mode. Parameters of an output (gain, a second mode's share, cubic stiffness, high-pass,
averaging) are shared if core model, unit of the response and kind of reference are the same. The
delay belongs to the channels of a calibration.

Calibrations are consistent if their separate estimates differ no more than the covariance of these
allows. With y the separate estimates, one below the other, and V their covariance, the hypothesis y
= A θ leaves contrasts t = Tᵀ y, Tᵀ A = 0, that are zero but for noise: tᵀ (Tᵀ V T)⁻¹ t is χ² with
as many degrees of freedom as there are contrasts (GUM, JCGM 102, 8; the test of a key comparison,
Cox 2002). Systematic effects common to two calibrations are correlated in V.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, null_space
from scipy.special import chdtrc, fdtrc

from vibrident.base.errors import InputError, unknown
from vibrident.data.records import Calibration, FloatArray, is_motion
from vibrident.fit.information import inverse_normal
from vibrident.fit.problem import Coordinates
from vibrident.fit.response.verdict import REJECTION
from vibrident.physics.models import ParameterSpec, SensorModel


@dataclass(frozen=True)
class JointParameter:
    """A parameter of the joint fit: one of a calibration, or shared by several."""

    name: str  # of the parameter
    #: Calibration, and index in its model, of each parameter that this one stands for.
    members: tuple[tuple[int, int], ...]


def joined(
    calibrations: Sequence[Calibration], models: Sequence[SensorModel], share: Sequence[str] | None
) -> tuple[JointParameter, ...]:
    """Return the parameters of the joint fit, each shared one once.

    Args:
        calibrations: of one sensor.
        models: of each calibration.
        share: names of the parameters to share, and no others; None: the mechanics, and the
            parameters of equal outputs.

    Raises:
        InputError: a name is not a parameter, or not one that two calibrations can share.
    """
    if share is not None:
        _check_names(share, models)
    members_by_key: dict[tuple[object, ...], list[tuple[int, int]]] = {}
    for number, (calibration, model) in enumerate(zip(calibrations, models, strict=True)):
        for index, spec in enumerate(model.parameters):
            name = spec.name
            key = _key(spec, calibration, model)
            is_own = spec.describes == "channel" if share is None else name not in share
            members_by_key.setdefault((number, name) if is_own else key, []).append((number, index))
    numbers = tuple(
        JointParameter(models[members[0][0]].parameter_names[members[0][1]], tuple(members))
        for members in members_by_key.values()
    )
    if len(calibrations) > 1:
        _check_common(numbers, share, calibrations)
    return numbers


def _key(spec: ParameterSpec, calibration: Calibration, model: SensorModel) -> tuple[object, ...]:
    """Return the attributes that two parameters of this name must share to be one."""
    if spec.describes != "output":
        return (spec.name,)
    drive = None if is_motion(calibration.quantity) else calibration.reference_unit
    return (spec.name, model.core.name, calibration.response_unit, drive)


def _check_names(share: Sequence[str], models: Sequence[SensorModel]) -> None:
    """Refuse names to share that are no parameters.

    Raises:
        InputError: a name is not a parameter of the models.
    """
    known = list(dict.fromkeys(name for model in models for name in model.parameter_names))
    for name in share:
        if name not in known:
            raise unknown(f"{name!r} is not a parameter of these models.", name, known, "share")


def _check_common(
    numbers: Sequence[JointParameter],
    share: Sequence[str] | None,
    calibrations: Sequence[Calibration],
) -> None:
    """Refuse calibrations that have nothing, or not the names asked for, in common.

    Raises:
        InputError: nothing, or a name in ``share``, is common to two calibrations.
    """
    common = {number.name for number in numbers if len(number.members) > 1}
    lacking = [name for name in share or () if name not in common]
    if lacking or not common:
        raise InputError(
            f"The calibrations have no {lacking[0]} in common."
            if lacking
            else "The calibrations share nothing.",
            expected="a parameter of two or more calibrations; "
            "a gain: of the same model, response unit and reference",
            found="; ".join(
                f"{calibration.model}, response in {calibration.response_unit}, "
                f"reference {calibration.quantity}"
                for calibration in calibrations
            ),
            where="⟦identify.share⟧",
            remedy="share other parameters, or identify these calibrations one by one",
        )


@dataclass(frozen=True, eq=False)
class JointPlace:
    """The map from the joint coordinates to a calibration's: z = offset + matrix @ theta."""

    offset: FloatArray  # shape (p,)
    matrix: FloatArray  # one entry a row, shape (p, q)

    def z(self, theta: FloatArray) -> FloatArray:
        """Return the calibration's coordinates, shape (p,), at joint ones, shape (q,)."""
        return self.offset + self.matrix @ theta


def places(
    numbers: Sequence[JointParameter], coordinates: Sequence[Coordinates]
) -> tuple[JointPlace, ...]:
    """Return the map to each calibration; a joint coordinate is that of its first member."""
    sizes = [len(of_calibration.model.parameters) for of_calibration in coordinates]
    maps = tuple(JointPlace(np.zeros(size), np.zeros((size, len(numbers)))) for size in sizes)
    for column, number in enumerate(numbers):
        first, first_index = number.members[0]
        for owner, index in number.members:
            maps[owner].offset[index], maps[owner].matrix[index, column] = _offset_and_scale(
                coordinates[first], first_index, coordinates[owner], index
            )
    return maps


def _offset_and_scale(
    first: Coordinates, first_index: int, second: Coordinates, second_index: int
) -> tuple[float, float]:
    """Return offset and scale of a coordinate as a linear function of another of the same value."""
    name = first.model.parameters[first_index].name
    other_values = second.values(np.zeros(len(second.model.parameters)))
    begin, end = (
        float(second.place(other_values | {name: first.values(z)[name]})[second_index])
        for z in (np.zeros(len(first.model.parameters)), np.ones(len(first.model.parameters)))
    )
    return begin, end - begin


@dataclass(frozen=True)
class Verdict:
    """A test of consistency: χ² of a difference, and the probability that it is as large.

    The probability holds for consistent data.
    """

    chi2: float
    degrees_of_freedom: int
    probability: float

    @property
    def consistent(self) -> bool:
        """Return whether consistency is not rejected."""
        return self.probability >= REJECTION


@dataclass(frozen=True)
class Consistency:
    """The comparison of separate estimates."""

    overall: Verdict  # of all shared parameters together
    by_name: dict[str, Verdict]  # of each shared parameter by itself

    @property
    def worst(self) -> str:
        """Return the parameter that differs most."""
        return min(
            self.by_name,
            key=lambda name: (self.by_name[name].probability, -self.by_name[name].chi2),
        )


def compare(
    numbers: Sequence[JointParameter],
    places: Sequence[JointPlace],
    estimates: Sequence[FloatArray],
    covariances: Sequence[FloatArray],
    effects: Sequence[FloatArray],
    degrees_of_freedom: float,
) -> Consistency | None:
    """Compare separate estimates; None if nothing is shared.

    Args:
        numbers: parameters of the joint fit.
        places: maps from the joint coordinates to each calibration's.
        estimates: separate estimates of each calibration's coordinates, shapes (p,).
        covariances: of these, from the data alone, shapes (p, p).
        effects: shift of all of these by one standard uncertainty of each systematic effect, shapes
            (Σp,).
        degrees_of_freedom: the least of any covariance.
    """
    matrix = np.concatenate([place.matrix for place in places])
    residual = np.concatenate(
        [z - place.offset for z, place in zip(estimates, places, strict=True)]
    )
    covariance = np.asarray(block_diag(*covariances), dtype=float)
    covariance = covariance + sum(
        (np.outer(shift, shift) for shift in effects), np.zeros_like(covariance)
    )
    begin = np.concatenate([[0], np.cumsum([len(place.offset) for place in places])])

    def verdict(rows: FloatArray, values: FloatArray, row_covariance: FloatArray) -> Verdict:
        contrasts = null_space(rows.T)
        difference = contrasts.T @ values
        chi2 = float(
            difference @ inverse_normal(contrasts.T @ row_covariance @ contrasts) @ difference
        )
        return Verdict(
            chi2, len(difference), _probability(chi2, len(difference), degrees_of_freedom)
        )

    verdicts = {}
    for column, number in enumerate(numbers):
        if len(number.members) > 1:
            index = [int(begin[owner]) + position for owner, position in number.members]
            rows = matrix[index][:, [column]]
            verdict_of_parameter = verdict(rows, residual[index], covariance[np.ix_(index, index)])
            if (
                number.name not in verdicts
                or verdict_of_parameter.probability < verdicts[number.name].probability
            ):
                verdicts[number.name] = verdict_of_parameter
    return Consistency(verdict(matrix, residual, covariance), verdicts) if verdicts else None


def _probability(chi2: float, contrasts: int, freedom: float) -> float:
    """Return the chance of at least this χ²; that of Fisher's F if the scale of V is estimated."""
    if np.isfinite(freedom):
        return float(fdtrc(contrasts, max(freedom, 1.0), chi2 / contrasts))
    return float(chdtrc(contrasts, chi2))
