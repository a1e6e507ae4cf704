"""Choices for an identification, also as a command for a shell."""

from __future__ import annotations

from dataclasses import dataclass

from vibrident.workflow.estimators import AUTO, estimators_with


@dataclass(frozen=True)
class Choices:
    """Of one identification.

    Attributes:
        calibration: name of the calibration file, in the folder of the data.
        estimator: its name.
        discretisation: of an estimator that has one; ignored for others.
        uncertainty: what the uncertainties cover.
    """

    calibration: str
    estimator: str = AUTO
    discretisation: str = "bandlimited"
    uncertainty: str = "auto"

    @property
    def options(self) -> dict[str, str]:
        """Every applicable option, including those at their default."""
        own = {"discretisation": self.discretisation} if self.estimator in estimators_with("discretisation") else {}
        return {"estimator": self.estimator, **own, "uncertainty": self.uncertainty}

    @property
    def command(self) -> str:
        """For a shell, in the folder of the data; file names are safe within double quotes."""
        file = f'"{self.calibration}"' if " " in self.calibration else self.calibration
        return " ".join(("vibrident identify", file, *(f"--{key} {value}" for key, value in self.options.items())))
