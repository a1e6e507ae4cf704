"""Plain words: what each metric is, what phase and coverage mean."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from vibrident.base.warning_kinds import explain as explain
from vibrident.result import Parameter

#: Remarks on what the data determine little of, and nothing of.
WEAK = "weakly determined"
UNKNOWN = "not identifiable"


def remark(parameter: Parameter) -> str:
    """Return the remarks on a parameter, separated by commas; empty for none.

    A parameter of which u is stated is known, if weakly: ``not identifiable`` is one without u.
    """
    u = parameter.standard_uncertainty
    has_u = u is not None and math.isfinite(u)
    marks = (
        ("derived", parameter.derived),
        (WEAK, has_u and not parameter.identifiable),
        (UNKNOWN, not has_u and not parameter.identifiable),
        ("u not stated", not has_u),
    )
    return ", ".join(mark for mark, applies in marks if applies)


@dataclass(frozen=True)
class Metric:
    """A fit metric: its short label, its definition, and its unit."""

    label: str
    definition: str
    in_response_unit: int = 0


#: Field of ``Fit`` to what it is; e is the residual (measured minus predicted), y the measured
#: response.
METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        "rmse": Metric("RMSE", "√mean(|e|²), root mean square of the residual", 1),
        "mae": Metric("MAE", "mean|e|, mean absolute residual", 1),
        "mse": Metric("MSE", "mean(|e|²) = RMSE²", 2),
        "r2": Metric("R²", "1 − MSE / var(y); 1 is perfect"),
        "rpd": Metric("RPD", "sd(y) / RMSE, population standard deviation; large is good"),
        "nrmse": Metric("NRMSE", "RMSE / sd(y); small is good"),
        "explained": Metric(
            "explained", "share of the response's power in the band that the model explains"
        ),
        "coherent": Metric(
            "coherent", "share of that power that some linear sensor, or this model, explains"
        ),
        "chi2_reduced": Metric(
            "χ²/ν",
            "mean squared deviation at the excited frequencies over its squared uncertainty; about "
            "1 is adequate",
        ),
        "degrees_of_freedom": Metric("ν", "degrees of freedom of χ²"),
    }
)

COVERAGE = (
    "u is the standard uncertainty (GUM), k the coverage factor and U = k·u the expanded "
    "uncertainty, with k = 2 unless another is stated, which for a normal distribution has a "
    "coverage probability of about 95 %. The 95 % interval is stated as computed and need not be "
    "symmetric. Uncertainties are rounded to two significant digits, values to the place of u (GUM "
    "7.2.6)."
)
