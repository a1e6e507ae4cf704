"""Free decays alone in a joint fit: they tell natural frequency and damping ratio, and share these."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import Calibration, FloatArray, Record
from vibrident.fit.decay.document import NAMES, Known, document, from_data, parameters, require_one_oscillator
from vibrident.fit.decay.examine import Decays, at_values, examine
from vibrident.fit.joint.sharing import Joint, Place
from vibrident.fit.problem import Coordinates, Local
from vibrident.fit.screening import Finding, screen
from vibrident.fit.uncertainty.budget import DATA, BudgetRow
from vibrident.physics.models import SensorModel, model_of
from vibrident.result import Parameter, Result, ResultWarning


@dataclass(frozen=True, eq=False)
class FreeDecays:
    """A calibration of decays alone."""

    calibration: Calibration  # as read
    model: SensorModel  # one oscillator
    records: tuple[Record, ...]  # that passed the screening
    findings: tuple[Finding, ...]  # on them
    decays: Decays  # what they say by themselves
    inflate: bool  # whether the misfit of one oscillator is in the uncertainties

    @classmethod
    def of(cls, calibration: Calibration, model: str | None, *, inflate: bool) -> FreeDecays:
        """The decays fitted by themselves."""
        sensor = model_of(calibration, model)
        require_one_oscillator(sensor)
        records, findings = screen(calibration.records, calibration.units)
        return cls(calibration, sensor, tuple(records), tuple(findings), examine(records), inflate)

    @functools.cached_property
    def known(self) -> Known:
        """How well they tell (ln fn, δ) by themselves."""
        return from_data(self.decays, inflate=self.inflate)

    @property
    def row(self) -> BudgetRow:
        """The same, for a budget."""
        data = self.known
        return BudgetRow(f"decays: {data.covers}", DATA, None, "", data.degrees_of_freedom, data.covariance)

    @functools.cached_property
    def information(self) -> FloatArray:
        """Of (ln fn, δ), shape (2, 2)."""
        return np.asarray(np.linalg.inv(self.known.covariance), dtype=float)

    def estimate(self, sign: float) -> FloatArray:
        """(ln fn, δ), shape (2,); δ with a sign, as its coordinate has one."""
        found = self.decays.fit
        return np.array([np.log(found.natural_frequency_hz), np.copysign(found.damping_ratio, sign)])

    def local(self, z: FloatArray) -> Local:
        """Cost, gradient and normal matrix of the separate estimate at (ln fn, ±δ)."""
        root = np.asarray(np.linalg.cholesky(self.information).T, dtype=float)
        return Local.of(root @ (z - self.estimate(float(z[1]))), root)

    def place(self, numbers: Sequence[Joint], places: Sequence[Place], coordinates: Sequence[Coordinates]) -> Place:
        """Where (ln fn, δ) lie in the coordinates of the joint fit.

        Raises:
            InputError: the others do not share natural frequency and damping ratio.
        """
        offset, matrix = np.zeros(2), np.zeros((2, len(numbers)))
        for row, column in enumerate(self.columns(numbers)):
            owner, index = numbers[column].members[0]
            near = coordinates[owner]
            begin = float(np.log(np.asarray(near.start)[index])) if near.model.parameters[index].kind == "log" else 0.0
            offset[row] = begin + places[owner].offset[index]
            matrix[row] = places[owner].matrix[index]
        return Place(offset, matrix)

    def columns(self, numbers: Sequence[Joint]) -> tuple[int, ...]:
        """Which numbers of the joint fit natural frequency and damping ratio are."""
        found: list[int] = []
        for name in NAMES:
            of_name = [column for column, number in enumerate(numbers) if number.name == name]
            if len(of_name) != 1:
                raise InputError(
                    "Free decays alone share natural frequency and damping ratio, and here others do not.",
                    expected=f"one {name} of all other calibrations",
                    found=f"{len(of_name)} of them",
                    where=self.calibration.source or "calibrations",
                    remedy="share natural_frequency and damping_ratio, or identify the decays by themselves",
                )
            found += of_name
        return tuple(found)

    def result(self, z: FloatArray, rows: Sequence[BudgetRow], told: Sequence[ResultWarning], begin: float) -> Result:
        """Their result at the joint values.

        ``z``: (ln fn, ±δ), shape (2,); ``rows``: of the budget, with covariances of (ln fn, ±δ); ``told``: warnings of
        the joint fit; ``begin``: when that began, by ``time.perf_counter``.
        """
        turn = np.diag([1.0, np.copysign(1.0, z[1])])
        covariance = turn @ np.sum([row.covariance for row in rows], axis=0) @ turn
        here = at_values(self.decays, float(np.exp(z[0])), float(abs(z[1])))
        stated = replace(self.known, covariance=covariance)
        found = document(self.calibration, self.model, self.records, self.findings, here, stated, begin)
        return replace(found, warnings=(*found.warnings, *told))

    def alone(self) -> dict[str, Parameter]:
        """Natural frequency and damping ratio by themselves."""
        fit, stated = self.decays.fit, self.known
        return parameters(
            self.model, fit.natural_frequency_hz, fit.damping_ratio, stated.covariance, stated.degrees_of_freedom
        )


def with_decays(numbers: Sequence[Joint], decays: Sequence[FreeDecays], first: int) -> tuple[Joint, ...]:
    """The numbers with the decays among their members; ``first``: number of calibrations with a reference."""
    found = list(numbers)
    for owner, one in enumerate(decays, first):
        for index, column in enumerate(one.columns(numbers)):
            found[column] = replace(found[column], members=(*found[column].members, (owner, index)))
    return tuple(found)
