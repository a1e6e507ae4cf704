"""The pictures of a result as view models, from its values alone."""

from __future__ import annotations

from collections.abc import Callable

from vibrident.present.fit_figures import residuals, signals, training
from vibrident.present.response_figures import deviation, sensitivity
from vibrident.present.views import Figure
from vibrident.result import Result

#: Name of each picture of a result (its file name without suffix) and its function, in the order of a report.
PICTURES: dict[str, Callable[[Result], Figure | None]] = {
    "sensitivity": sensitivity,
    "deviation": deviation,
    "signals": signals,
    "residuals": residuals,
    "training": training,
}
