"""The sensitivity: magnitude and phase of model and measurement over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vibrident.plots import curves, style
from vibrident.plots.style import CROWD
from vibrident.plots.units import reference_unit, sensitivity_unit
from vibrident.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CONVENTION = "Phase = φ(response) − φ(reference), lag negative."


def figure(result: Result) -> Figure:
    """Draw magnitude and phase of the model and of the measured points, both with U (k = 2)."""
    with style.styled():
        picture = style.new_figure(6.7, 5.2)
        curves.panels(
            picture,
            result.response,
            result.measured,
            unit=sensitivity_unit(result.response_unit, reference_unit(result)),
            quantity=result.reference.get("quantity", "acceleration"),
            measured_label="measured",
        )
        style.head(picture, "Sensitivity", result)
        codes = ", ".join(code.replace("_", " ") for code in result.warning_codes)
        doubts = f"Warnings: {codes}." if codes else ""
        style.note(picture, _small_print(result), doubts)
        return picture


def _small_print(result: Result) -> str:
    drawn = []
    if len(result.measured.frequency_hz) <= CROWD and _any(result.measured.magnitude_uncertainty):
        drawn.append("bars")
    if _any(result.response.magnitude_uncertainty):
        drawn.append("band")
    parts = [f"{' and '.join(drawn).capitalize()}: expanded uncertainty U, k = 2."] if drawn else []
    if _any(result.response.phase_deg) or _any(result.measured.phase_deg):
        parts.append(CONVENTION)
    return " ".join(parts)


def _any(values: tuple[float | None, ...]) -> bool:
    return any(value is not None for value in values)
