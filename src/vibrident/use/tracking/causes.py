"""What a change comes from that no parameter is: the samples that follow it, fitted and examined as a record is.

A spring that bends moves the parameters with the motion, and a second mode is noise to a model of one. Both show in the
samples behind the alarm: `identify` names the departure and what the parameters would be without it, or the model of
two modes explains what that of one does not. A parameter that is then as before has not changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.errors import VibridentError
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import Calibration, FloatArray, Quantity
from vibrident.physics.models import AddOn, SensorModel, parse
from vibrident.result import Result
from vibrident.use.identification import identify
from vibrident.use.tracking.state import CERTAIN, INNOVATION, Alarm

#: Samples behind an alarm that are examined: as a calibration record has, in the time of a second of arithmetic.
LENGTH = 8192
#: Findings that name no cause: of a model that is wrong somewhere, and of a change in time, which an alarm is.
UNNAMED = ("band_sensitive", "regimes")


@dataclass(frozen=True)
class Cause:
    """What departs from the model: code of its warning, in words, and the values of the parameters beside it.

    Without a code nothing does.
    """

    code: WarningCode | None
    words: str
    values: dict[str, float]

    def explains(self, alarm: Alarm, before: Cause) -> bool:
        """Whether the parameter is beside this nearer to what it was ``before`` than to what it seems to be."""
        if alarm.parameter == INNOVATION:
            return True
        value = self.values.get(alarm.parameter)  # another model may not have it
        return value is not None and abs(value - before.values[alarm.parameter]) < abs(value - alarm.after)

    def left_by(self, alarm: Alarm) -> bool:
        """Return whether the parameter moves towards what it is without this, as in a smaller motion."""
        value = self.values.get(alarm.parameter)
        if self.code is None or value is None:
            return False
        low, high = sorted((alarm.before, value))
        return bool(abs(alarm.after - np.clip(alarm.after, low, high)) < CERTAIN * alarm.u)


def cause(
    model: SensorModel, reference: FloatArray, response: FloatArray, rate_hz: float, quantity: Quantity
) -> Cause | None:
    """What departs from the model in these samples; None where nothing does, or they do not tell.

    ``reference``: shape (samples,), in the SI unit of its quantity; ``response``: shape (samples,).
    """
    try:
        data = Calibration.from_arrays(reference, response, rate_hz, quantity=quantity, excitation="random")
        found = identify(data, model.name)
        named = next((each for each in found.findings if each.code not in UNNAMED), None)
        if other := found.settings.get("explained_by"):
            further = parse(other)
            added = [part for part in further.add_ons if part not in model.add_ons]
            values = _values(identify(data, other))
            at = ", ".join(f"{part.title} at {_first(part, values)}" for part in added)
            return Cause("lack_of_fit", at or f"the model {other} explains the response", values)
    except VibridentError:
        return None
    if named is None:
        return None
    values = {name: value - named.impact.get(name, 0.0) for name, value in _values(found).items()}
    said = named.message.removeprefix(f"{named.record}: ").split(". ")[0]
    return Cause(named.code, f"{named.code.replace('_', ' ')}: {said[:1].lower()}{said[1:]}", values)


def _values(result: Result) -> dict[str, float]:
    return {name: each.value for name, each in result.parameters.items() if not each.derived}


def _first(part: AddOn, values: dict[str, float]) -> str:
    """Its first parameter, which tells where it is."""
    spec = part.parameters[0]
    return amount(values[spec.name], spec.unit, 4)
