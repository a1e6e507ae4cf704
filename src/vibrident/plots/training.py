"""How the estimator went: loss and parameters by iteration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.naming import in_words
from vibrident.plots import style
from vibrident.result import Result, Training

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure(result: Result) -> Figure:
    """Draw the loss, and below it each parameter relative to its final value."""
    training = result.training
    with style.styled():
        if training is None or not (training.loss or training.parameters):
            picture = style.new_figure(6.7, 2.6)
            axes = picture.add_subplot()
            axes.set_xlabel("Iteration")
            axes.set_ylabel("Loss")
            style.empty(axes, "the result holds no trace of the optimiser")
        else:
            rows = 2 if training.parameters else 1
            picture = style.new_figure(6.7, 1.4 + 1.8 * rows)
            axes = picture.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
            _loss(axes[0], training)
            if training.parameters:
                _parameters(axes[1], training)
            axes[-1].set_xlabel("Iteration")
            axes[-1].locator_params(axis="x", integer=True)
            style.note(picture, f"Optimiser {training.optimiser}: {training.status}, {training.iterations} iterations.")
        style.head(picture, "Training", result)
        return picture


def _loss(axes: Axes, training: Training) -> None:
    loss = style.numbers(training.loss)
    axes.set_ylabel("Loss (mean squared\nweighted residual)")
    if not np.isfinite(loss).any():
        style.empty(axes, "no loss recorded")
        return
    axes.plot(np.arange(loss.size), loss, color=style.BLUE, **_marker("o", loss.size))
    if np.nanmin(loss) > 0:
        style.size_axis(axes, loss)


def _parameters(axes: Axes, training: Training) -> None:
    axes.set_ylabel("Parameter / final value\n(dimensionless)")
    axes.axhline(1.0, color=style.GREY, lw=0.8)
    ratios = []
    for i, (name, trace) in enumerate(training.parameters.items()):
        values = style.numbers(trace)
        usable = values[np.isfinite(values)]
        if usable.size == 0:
            continue
        color, line, marker = style.LINES[i % len(style.LINES)]
        label = style.printable(in_words(name))
        final = usable[-1]
        if final == 0:  # nothing to relate to: show where it went, on top of 1
            values, label = 1 + values / (float(np.abs(usable).max()) or 1.0), f"1 + {label} / its largest"
        else:
            values = values / final
        ratios.append(values[np.isfinite(values)])
        axes.plot(np.arange(values.size), values, color=color, ls=line, label=label, **_marker(marker, values.size))
    if not ratios:
        style.empty(axes, "no parameters recorded")
        return
    pooled = np.concatenate(ratios)
    if pooled.min() > 0 and pooled.max() / pooled.min() > 30:
        style.size_axis(axes, pooled)
    axes.legend(loc="best", ncols=1 if len(ratios) < 4 else 2)


def _marker(marker: str, points: int) -> dict[str, Any]:
    return {"marker": marker, "markersize": 3.2} if points <= 40 else {}
