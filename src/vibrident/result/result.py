"""Result of an identification: values only, to and from JSON (``vibrident.result/1``)."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.base.binding import bound
from vibrident.base.errors import InputError
from vibrident.base.files import atomic_write
from vibrident.base.warning_kinds import WARNING_CODES
from vibrident.result.document import (
    SCHEMA,
    damaged,
    json_text,
    log_unknown,
    plain,
    read_document,
    separate_unknown,
    unknown_names,
)
from vibrident.result.earlier import in_current_form
from vibrident.result.parts import (
    Correlation,
    Curve,
    Finding,
    Fit,
    MeasuredCurve,
    Parameter,
    ResultPart,
    ResultWarning,
    Signal,
    Training,
    no_numbers,
    require_consistent,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from pydantic import TypeAdapter

    from vibrident.physics.models import Model
    from vibrident.result.sensor import IdentifiedSensor


#: Estimator of a result that follows a sensor after its calibration.
TRACKED = "tracked"


@dataclass(frozen=True)
class Result(ResultPart):
    """Result of an identification: the content of ``result.json``.

    Attributes:
        model: model name, such as "accelerometer+delay".
        estimator: estimator that produced the values.
        settings: choices of the user and of ``auto``, with their reasons.
        provenance: package and library versions, file names and SHA-256, seed, time.
        parameters: name to parameter.
        correlation: of the estimated parameters.
        fit: fit metrics.
        response: the model's curve.
        measured: the data's curve.
        warnings: empty for a clean calibration of an adequate model.
        sensor: free text of the calibration file.
        reference: quantity and unit of the reference.
        sensitivity_per: quantity and unit in the denominator of ``response`` and ``measured``: the
            sensor's own motion, whatever the reference measured, or the drive.
        response_unit: unit of the response channel.
        signals: quality of the fit of each record, with excerpts for pictures.
        training: trace of the optimiser.
        weights: the identified network weights W1…W4 as nested lists (paper's Table 1), where a
            network was trained.
        certificate: certificate data of the calibration file; empty if there are none.
        findings: significant departures from the fit, whether they matter or not.
        uncertainty: ``covers``: which of ``noise``, ``gain`` and ``phase`` the uncertainties cover.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration)
        >>> path = result.save("result.json")
        >>> again = vibrident.Result.load("result.json")
        >>> again.parameters["damping_ratio"] == result.parameters["damping_ratio"]
        True
    """

    model: str
    estimator: str
    settings: Mapping[str, Any]
    provenance: Mapping[str, Any]
    parameters: Mapping[str, Parameter]
    correlation: Correlation
    fit: Fit
    response: Curve
    measured: MeasuredCurve
    warnings: tuple[ResultWarning, ...] = ()
    sensor: Mapping[str, str] = field(default_factory=dict)
    reference: Mapping[str, str] = field(default_factory=dict)
    sensitivity_per: Mapping[str, str] = field(default_factory=dict)
    response_unit: str = "V"
    signals: tuple[Signal, ...] = ()
    training: Training | None = None
    weights: Mapping[str, Any] = field(default_factory=dict)
    certificate: Mapping[str, Any] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    uncertainty: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return one line: model, estimator, parameters with u, verdict and codes of warnings."""
        estimates = []
        for name, parameter in self.parameters.items():
            u = parameter.standard_uncertainty
            if not parameter.derived:
                uncertainty = "" if u is None else f" ± {u:.2g}"
                estimates.append(f"{name}={parameter.value:.8g}{uncertainty}")
        values = ", ".join(estimates)
        verdict = "adequate" if self.fit.adequate else "not adequate"
        if self.warnings:
            verdict += f", warnings: {', '.join(self.warning_codes)}"
        return f"<Result of {self.model} by {self.estimator}: {values}; {verdict}>"

    def summary(self) -> str:
        """Return what ``vibrident identify`` prints: parameters, fit, warnings; plain text."""
        return bound("summary")(self)

    def _repr_html_(self) -> str:
        """Show parameters, fit, warnings and the sensitivity over frequency in a notebook."""
        return bound("result_html")(self)

    def to_dataframe(self) -> DataFrame:
        """Return the parameters, a row each, by name.

        Columns: ``value``, ``unit``, ``standard_uncertainty``, ``interval_95_low``,
        ``interval_95_high`` (NaN where not stated), ``identifiable``, ``derived``.
        """
        import pandas as pd

        rows = [
            {
                "value": parameter.value,
                "unit": parameter.unit,
                "standard_uncertainty": parameter.standard_uncertainty,
                "interval_95_low": parameter.interval_95[0],
                "interval_95_high": parameter.interval_95[1],
                "identifiable": parameter.identifiable,
                "derived": parameter.derived,
            }
            for parameter in self.parameters.values()
        ]
        frame = pd.DataFrame(rows, index=pd.Index(list(self.parameters), name="parameter"))
        numbers = ("value", "standard_uncertainty", "interval_95_low", "interval_95_high")
        return frame.astype(dict.fromkeys(numbers, float))

    def plot(self, picture: str = "sensitivity") -> Figure:
        """Draw a picture of the result as a matplotlib figure, which a notebook shows.

        Args:
            picture: ``sensitivity``, ``deviation``, ``signals``, ``residuals`` or ``training``.

        Raises:
            InputError: there is no such picture.
        """
        return bound("plot")(picture, self)

    def to_sensor(self, use: str = "a computation") -> IdentifiedSensor:
        """Return the sensor to compute with: response and uncertainty at any frequency.

        Its covariance holds what the result's uncertainties cover.

        Args:
            use: purpose, in words, for the message of an error.

        Raises:
            InputError: the result has no gain, or lacks a parameter of its model.
        """
        from vibrident.result.estimates import sensor_of

        self.require_gain(use)
        return sensor_of(self)

    @property
    def warning_codes(self) -> tuple[str, ...]:
        """Return the codes of the warnings, in order, without repeats."""
        return tuple(dict.fromkeys(w.code for w in self.warnings))

    @property
    def quantity(self) -> str:
        """Return the quantity that sensitivities are per; acceleration where it is not stated."""
        return self.sensitivity_per.get("quantity", "acceleration")

    @property
    def is_tracked(self) -> bool:
        """Return whether the values follow a sensor after its calibration."""
        return self.estimator == TRACKED

    @property
    def has_gain(self) -> bool:
        """Return whether the gain is known; free decays alone do not determine it."""
        estimated = {name for name, parameter in self.parameters.items() if not parameter.derived}
        return estimated != {"natural_frequency", "damping_ratio"}

    def require_gain(self, use: str) -> None:
        """Refuse a result of free decays alone, whose gain is not known.

        Args:
            use: what needs the gain, for the message.

        Raises:
            InputError: the gain is not known.
        """
        if not self.has_gain:
            raise InputError(
                f"The result has no gain, which {use} needs: "
                "free decays alone tell natural frequency and damping.",
                expected="a result of records with a reference, or of a table",
                found=f"parameters {', '.join(self.parameters)}",
                where="result.json, parameters",
                remedy="identify records with a reference; decays may be among them, "
                "or in a calibration file beside",
            )

    def require_linear(self) -> None:
        """Refuse a result whose model has no linear inverse."""
        from vibrident.result.estimates import model_of_result

        if not model_of_result(self).is_linear:
            raise InputError(
                "A sensor with a cubic stiffness has no linear inverse.",
                expected="a result of a linear model",
                found=repr(self.model),
                where="result, model",
                remedy="identify with a model without 'cubic', "
                "at the level of the motion to be corrected",
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the result in plain types; numbers that are not finite become None."""
        return {"schema": SCHEMA, **plain(self)}

    def to_json(self) -> str:
        """Return the result as JSON text, RFC 8259: no NaN, no Infinity; floats are exact."""
        return json_text(self.to_dict())

    def save(self, path: str | os.PathLike[str], *, excerpts: bool = True) -> Path:
        """Write ``result.json`` at ``path``, whole or not at all; return the path.

        Args:
            path: of the file; its folder is created if missing.
            excerpts: whether to write the samples of records that pictures show, which are most of
                the file.
        """
        target = Path(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        result = self if excerpts else self.without_excerpts()
        with atomic_write(target) as partial:
            partial.write_text(result.to_json(), encoding="utf-8")
        return target

    def without_excerpts(self) -> Result:
        """Return the result without samples of records, but with the quality of their fit."""
        empty = no_numbers()
        signals = (replace(signal, measured=empty, residual=empty) for signal in self.signals)
        return replace(self, signals=tuple(signals))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Return the fields and codes that this version does not know, each by its place."""
        codes = [f"warnings: {w.code}" for w in self.warnings if w.code not in WARNING_CODES]
        codes += [f"findings: {f.code}" for f in self.findings if f.code not in WARNING_CODES]
        return (*unknown_names(self), *dict.fromkeys(codes))

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Result:
        """Build a result from ``to_dict``'s form.

        Raises:
            InputError: the document has another schema or lacks a field.
        """
        is_mapping = isinstance(document, Mapping)
        schema = document.get("schema") if is_mapping else type(document).__name__
        if schema != SCHEMA:
            raise InputError(
                "This is not a vibrident result.",
                expected=f'"schema": "{SCHEMA}"',
                found=repr(schema),
                remedy="give the result.json that ⟦command = identify⟧ wrote",
            )
        from pydantic import ValidationError

        try:
            content = {name: value for name, value in document.items() if name != "schema"}
            content = separate_unknown(cls, in_current_form(content))
            result = adapter().validate_python(content)
            result.require_consistent()
        except ValidationError as error:
            first = error.errors()[0]
            location = ".".join(map(str, first["loc"]))
            raise damaged(f"{location}: {first['msg']}") from None
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise damaged(f"{type(error).__name__}: {error}") from error
        return result

    def require_consistent(self) -> None:
        """Raise ValueError where the fields contradict each other."""
        require_consistent(self.response, self.measured, self.correlation, self.signals)

    @classmethod
    def load(cls, path: str | os.PathLike[str], model: Model | None = None) -> Result:
        """Read a result file.

        Args:
            path: of the file.
            model: the model, if it was made in Python and the result is to compute with it.

        Raises:
            InputError: the file cannot be read or is not a result.
        """
        if model is not None:
            from vibrident.physics.models import named

            named(model)
        document = read_document(path)
        result = cls.from_dict(document)
        log_unknown(str(path), result.unknown)
        return result


@functools.cache  # building it is the slowest part of reading a result
def adapter() -> TypeAdapter[Result]:
    """Return the adapter that checks a document and builds a result from it."""
    from pydantic import TypeAdapter

    return TypeAdapter(Result)
