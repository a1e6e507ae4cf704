"""Result of a record whose sensor changed: that of its longest regime, with all regimes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.base.errors import VibridentError
from vibrident.base.fields import Fields
from vibrident.data.records import STATIONARY_EXCITATIONS, Calibration
from vibrident.fit.descent.train import MIN_EXPLAINED_SHARE
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.document import Uncertainty, budget_of, document
from vibrident.fit.uncertainty.explained import Shares
from vibrident.fit.uncertainty.parameters import parameter_units
from vibrident.physics.models import model_of
from vibrident.physics.naming import in_words
from vibrident.result import Finding, Result, ResultWarning
from vibrident.use.regimes.change_time import change_sample
from vibrident.use.regimes.pieces import (
    PieceEstimate,
    cut,
    find_regimes,
    is_alike_throughout,
    joined,
    piece_samples,
)
from vibrident.use.regimes.shared import share

#: Motion that may be alike throughout, as a train of pulses or of short sweeps.
TRAINS = ("shock", "sweep")
#: Warnings of a fit that may be of a sensor that changed.
DOUBTS = {"lack_of_fit", "regimes"}
#: Digits of values in words.
DIGITS = 6


def with_regimes(
    calibration: Calibration,
    name: str | None,
    result: Result,
    fit: Callable[[Calibration], Fitted],
    scope: Uncertainty,
) -> Result:
    """Return the result of the longest regime, and the others, where a sensor changed in a record.

    Args:
        calibration: as identified.
        name: of the model; None: the calibration's.
        result: of the calibration as a whole; it stands where there are no regimes.
        fit: estimates and judges a calibration.
        scope: as ``uncertainty`` of ``identify``.
    """
    model = model_of(calibration, name)
    if not (model.is_linear and _may_have_changed(calibration, result)):
        return result
    near = {}
    if not result.fit.explained < MIN_EXPLAINED_SHARE:
        near = {name: result.parameters[name].value for name in model.parameter_names}
    offset = result.settings.get("clock_offset", 0.0)
    regimes = find_regimes(calibration, model, near, offset)
    shortest = piece_samples(calibration.records[0].samples) // 2
    while len(regimes) >= 2:
        edges = _edges(calibration, regimes)
        lengths = np.diff(edges)
        if np.min(lengths) < shortest:  # a piece that holds a change may be explained by chance
            del regimes[int(np.argmin(lengths))]
            regimes = list(joined(regimes))
            continue
        try:
            fitted_regimes = _Regimes.fitted(calibration, regimes, edges, fit)
        except VibridentError:
            return result
        regimes = list(joined(fitted_regimes.pieces))
        if len(regimes) == len(fitted_regimes.fits):
            return _result(fitted_regimes, scope) if fitted_regimes.explain_the_record else result
    return result


def _edges(calibration: Calibration, regimes: Sequence[PieceEstimate]) -> list[int]:
    """Return the first sample of each regime, and the number of samples."""
    record = calibration.records[0]
    changes = [
        change_sample(record, calibration.quantity, *pair) for pair in itertools.pairwise(regimes)
    ]
    return [0, *changes, record.samples]


@dataclass(frozen=True, eq=False)
class _Regimes:
    """Regimes of a record, each fitted by itself.

    Attributes:
        spans: samples of each, without those next to a change.
        fits: of each.
        edges: first sample of each, and the number of samples.
    """

    spans: Sequence[slice]
    fits: Sequence[Fitted]
    edges: Sequence[int]

    @classmethod
    def fitted(
        cls,
        calibration: Calibration,
        regimes: Sequence[PieceEstimate],
        edges: Sequence[int],
        fit: Callable[[Calibration], Fitted],
    ) -> _Regimes:
        """Fit regimes between their edges, a period away from each change.

        Raises:
            VibridentError: one of them cannot be fitted.
        """
        record = calibration.records[0]
        period = max(_period(regime, record.sampling_rate_hz) for regime in regimes)
        spans = [
            slice(first + period * (first > 0), last - period * (last < record.samples))
            for first, last in itertools.pairwise(edges)
        ]
        return cls(spans, [fit(cut(calibration, span)) for span in spans], edges)

    @property
    def pieces(self) -> list[PieceEstimate]:
        """Return the parameters of each."""
        return [PieceEstimate.from_fit(*pair) for pair in zip(self.spans, self.fits, strict=True)]

    @property
    def explain_the_record(self) -> bool:
        """Return whether the model explains each of them."""
        return all(fit.adequate for fit in self.fits)


def _period(regime: PieceEstimate, rate_hz: float) -> int:
    """Return the longest period of free motion in samples; one of a sensor that has none."""
    poles = np.abs(regime.model.poles(regime.parameters))
    return int(np.ceil(2.0 * np.pi * rate_hz / np.min(poles))) if poles.size else 1


def _may_have_changed(calibration: Calibration, result: Result) -> bool:
    """Return whether a fit is doubtful, and of one record whose motion is alike throughout.

    It is not where another model explains the record.
    """
    records = calibration.records
    if len(records) != 1 or records[0].optical is not None:
        return False
    if not DOUBTS & set(result.warning_codes) or "explained_by" in result.settings:
        return False
    if Shares(result.fit.explained, result.fit.coherent).is_of_steady_sensor:
        return False
    excitation = records[0].excitation
    return excitation in STATIONARY_EXCITATIONS or (
        excitation in TRAINS and is_alike_throughout(records[0])
    )


def _result(fitted_regimes: _Regimes, scope: Uncertainty) -> Result:
    """Return the result of the longest regime, and the others beside it."""
    fits = fitted_regimes.fits
    edges = fitted_regimes.edges
    shared = share(fitted_regimes.pieces)
    longest = int(np.argmax(np.diff(edges)))
    fitted = fits[longest]
    names = fitted.evidence.model.parameter_names
    coordinates = fitted.estimate.coordinates
    z = coordinates.place(dict(zip(names, shared.values[longest].tolist(), strict=True)))
    slopes = coordinates.slopes(z)
    inverse_slopes = np.divide(1.0, slopes, out=np.zeros_like(slopes), where=slopes != 0.0)
    covariance = shared.covariances[longest] * np.outer(inverse_slopes, inverse_slopes)
    fitted = fitted.at(replace(fitted.estimate, z=z, covariance=covariance, predicted=None))
    result = document(fitted, budget_of(fitted, scope))
    record = fitted.evidence.calibration.records[0]
    times = (np.array(edges) / record.sampling_rate_hz).tolist()
    regimes = [
        {
            "from_s": times[number],
            "to_s": times[number + 1],
            "parameters": {
                name: {"value": float(value), "standard_uncertainty": float(np.sqrt(variance))}
                for name, value, variance in zip(
                    names, shared.values[number], np.diag(shared.covariances[number]), strict=True
                )
            },
        }
        for number in range(len(fits))
    ]
    common = [name for name, is_one in zip(names, shared.is_shared, strict=True) if is_one]
    text = _describe_regimes(fitted, regimes, common, longest)
    changes = tuple(
        Finding(
            "regimes",
            record.name,
            regime["from_s"],
            before.chance_of_equality(behind),
            dict.fromkeys(names, 0.0),  # what is stated is that of one regime
            f"{record.name}: The sensor changed at {plain(regime['from_s'], 5)} s.",
        )
        for regime, (before, behind) in zip(
            regimes[1:], itertools.pairwise(fitted_regimes.pieces), strict=True
        )
    )
    return replace(
        result,
        settings={**result.settings, "regimes": regimes},
        findings=(*changes, *result.findings),
        warnings=(ResultWarning("regimes", text), *result.warnings),
    )


def _describe_regimes(
    fitted: Fitted, regimes: Sequence[Fields], common: Sequence[str], longest: int
) -> str:
    """Return what changed and when, what did not, and which regime the result is of."""
    units = parameter_units(fitted.evidence.model, fitted.evidence.calibration)
    spans = []
    for regime in regimes:
        values = ", ".join(
            f"{in_words(name)} {amount(parameter['value'], units[name], DIGITS)}"
            for name, parameter in regime["parameters"].items()
            if name not in common
        )
        spans.append(f"{plain(regime['from_s'], 5)} to {plain(regime['to_s'], 5)} s: {values}")
    record = fitted.evidence.calibration.records[0].name
    regime_used = regimes[longest]
    text = f"{record}: The sensor changed; it has {len(regimes)} regimes. {'; '.join(spans)}. "
    if common:
        text += f"The same in all: {', '.join(in_words(name) for name in common)}. "
    span_s = " to ".join(plain(regime_used[key], 5) for key in ("from_s", "to_s"))
    return f"{text}The result is that of {span_s} s, the longest."
