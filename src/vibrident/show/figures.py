"""The pictures of a result as view models, from its values alone."""

from __future__ import annotations

from collections.abc import Callable

from vibrident.result import Result
from vibrident.show.fit_figures import residuals, signals, training
from vibrident.show.response_figures import deviation, sensitivity
from vibrident.show.views import Figure

#: Name of each picture of a result (its file name without suffix) and its function, in the order of
#: a report.
PICTURES: dict[str, Callable[[Result], Figure | None]] = {
    "sensitivity": sensitivity,
    "deviation": deviation,
    "signals": signals,
    "residuals": residuals,
    "training": training,
}
