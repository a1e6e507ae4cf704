"""Causes of an alarm beyond the parameters, from a fit to the samples that follow it.

A nonlinear spring moves the parameters with the motion, and a second mode is noise to a model with
one. Both show in the samples after the alarm: `identify` names the departure and the parameters
without it, or a model with two modes explains the response and one with one mode does not. A
parameter that is then as before has not changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.errors import VibridentError
from vibrident.base.fields import NamedNumbers
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import Calibration, FloatArray, Quantity
from vibrident.physics.models import AddOn, SensorModel, parse
from vibrident.result import Result
from vibrident.use.identification import identify
from vibrident.use.tracking.state import CERTAIN_IN_U, INNOVATION, Alarm

#: Samples after an alarm that are examined: as many as a calibration record has; the fit takes
#: about a second.
CAUSE_SAMPLES = 8192
#: Findings that name no cause: that the model is wrong somewhere, and that something changes in
#: time, as the alarm says.
UNSPECIFIC_FINDINGS = ("band_sensitive", "regimes")


@dataclass(frozen=True)
class Cause:
    """A departure from the model: code of its warning, its words, and the parameters without it.

    Without a code there is no departure.
    """

    code: WarningCode | None
    words: str
    values: dict[str, float]

    def explains(self, alarm: Alarm, before: Cause) -> bool:
        """Return whether this departure explains an alarm.

        It does where the parameter without the departure is nearer to its value ``before`` than to
        its apparent value.
        """
        if alarm.parameter == INNOVATION:
            return True
        value = self.values.get(alarm.parameter)  # another model may not have it
        if value is None:
            return False
        return abs(value - before.values[alarm.parameter]) < abs(value - alarm.after)

    def ends_with(self, alarm: Alarm) -> bool:
        """Return whether the parameter moves towards its value without this departure.

        So it does in a smaller motion.
        """
        value = self.values.get(alarm.parameter)
        if self.code is None or value is None:
            return False
        low, high = sorted((alarm.before, value))
        return bool(abs(alarm.after - np.clip(alarm.after, low, high)) < CERTAIN_IN_U * alarm.u)


def find_cause(
    model: SensorModel,
    reference: FloatArray,
    response: FloatArray,
    rate_hz: float,
    quantity: Quantity,
) -> Cause | None:
    """Return what departs from the model in these samples, or None if nothing certain does.

    ``reference``: shape (samples,), in the SI unit of its quantity; ``response``: shape (samples,).
    """
    try:
        data = Calibration.from_arrays(
            reference, response, rate_hz, quantity=quantity, excitation="random"
        )
        result = identify(data, model.name)
        finding = next(
            (
                candidate
                for candidate in result.findings
                if candidate.code not in UNSPECIFIC_FINDINGS
            ),
            None,
        )
        if better_model := result.settings.get("explained_by"):
            extended = parse(better_model)
            added = [add_on for add_on in extended.add_ons if add_on not in model.add_ons]
            values = _values(identify(data, better_model))
            instants = ", ".join(
                f"{add_on.title} at {_first_value(add_on, values)}" for add_on in added
            )
            return Cause(
                "lack_of_fit", instants or f"the model {better_model} explains the response", values
            )
    except VibridentError:
        return None
    if finding is None:
        return None
    values = {
        name: value - finding.impact.get(name, 0.0) for name, value in _values(result).items()
    }
    summary = finding.message.removeprefix(f"{finding.record}: ").split(". ")[0]
    return Cause(
        finding.code,
        f"{finding.code.replace('_', ' ')}: {summary[:1].lower()}{summary[1:]}",
        values,
    )


def _values(result: Result) -> dict[str, float]:
    return {
        name: parameter.value
        for name, parameter in result.parameters.items()
        if not parameter.derived
    }


def _first_value(add_on: AddOn, values: NamedNumbers) -> str:
    """Return the value of an add-on's first parameter, which tells where it is."""
    spec = add_on.parameters[0]
    return amount(values[spec.name], spec.unit, 4)
