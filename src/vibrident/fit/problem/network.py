"""Choice of the network of a model over its records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from vibrident.data.records import Quantity, Record
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.problem.network_problem import NetworkProblem
from vibrident.physics.discretisation import Method
from vibrident.physics.models import SensorModel


def network_of(
    records: Sequence[Record],
    model: SensorModel,
    method: Method,
    quantity: Quantity,
    start: Mapping[str, float],
) -> NetworkProblem:
    """Return the network over records, at the bins of their transforms or, if nonlinear, in time.

    Raises:
        InputError: no record is long enough.
    """
    if model.is_linear:
        return BinProblem.build(records, model, method, quantity, start)
    from vibrident.fit.problem.time_domain import TimeProblem

    return TimeProblem.build(records, model, method, quantity, start)
