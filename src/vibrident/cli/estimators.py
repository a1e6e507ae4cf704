"""From options to an estimator with its settings."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from vibrident.errors import InputError

if TYPE_CHECKING:
    from vibrident.estimators import Estimator
    from vibrident.identification import EstimatorName


@dataclass(frozen=True)
class EstimatorOptions:
    """Options of one estimator alone; None where not given."""

    discretisation: str | None = None
    optimiser: str | None = None
    steps: int | None = None
    learning_rate: float | None = None
    weighting: str | None = None
    residual: bool | None = None

    def given(self) -> dict[str, Any]:
        """Name and value of those given."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


_OWNER = {
    "discretisation": "ipnn",
    "optimiser": "ipnn",
    "steps": "ipnn",
    "learning_rate": "ipnn",
    "weighting": "lsm",
    "residual": "ipnn",
}


def checked(estimator: str, options: EstimatorOptions, *, weights: bool = False) -> None:
    """Refuse options that do not fit the estimator; quick, no library is loaded.

    Raises:
        InputError: an option belongs to another estimator, or to another optimiser.
    """
    given = options.given()
    foreign = [name for name in given if _OWNER[name] != estimator]
    if foreign:
        raise _misfit(_option(foreign[0]), f"--estimator {_OWNER[foreign[0]]}", f"--estimator {estimator}")
    adams = [name for name in ("steps", "learning_rate") if name in given]
    if adams and options.optimiser != "adam":
        raise _misfit(_option(adams[0]), "--optimiser adam", f"--optimiser {options.optimiser or 'lm'}")
    if options.learning_rate is not None and not 0.0 < options.learning_rate < 1.0:
        raise InputError(
            "The learning rate is not usable.",
            expected="a number between 0 and 1",
            found=repr(options.learning_rate),
            where="--learning-rate",
            remedy="try 0.001",
        )
    if weights and estimator in ("ml", "lsm"):
        raise _misfit("--weights", "--estimator ipnn", f"--estimator {estimator}")


def estimator(name: str, options: EstimatorOptions) -> EstimatorName | Estimator:
    """What ``identify`` takes: a name, or settings where options were given."""
    from vibrident.estimators import Ipnn, LeastSquares

    given = options.given()
    if not given:
        return name  # type: ignore[return-value]
    if given.pop("residual", False):
        from vibrident.estimators.residual_network import ResidualIpnn

        return ResidualIpnn(physics=Ipnn(**given))
    return Ipnn(**given) if name == "ipnn" else LeastSquares(**given)


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _misfit(option: str, wanted: str, found: str) -> InputError:
    return InputError(
        f"The option {option} does not fit.",
        expected=f"{option} with {wanted}",
        found=f"{option} with {found}",
        where="command line",
        remedy=f"add {wanted}, or leave {option} out",
    )
