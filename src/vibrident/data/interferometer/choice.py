"""The ellipse for each record of a set-up: its own, a common one, or that of a larger motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from vibrident.data.interferometer.ellipse import Ellipse
from vibrident.data.interferometer.setting import FloatArray
from vibrident.data.interferometer.summary import OpticalFinding
from vibrident.data.interferometer.survey import Survey, sound

CHANCE = 1e-3  # records share one ellipse unless their differences are less probable than this
UNSTABLE = 0.02  # a change of centre, ratio or quadrature by this part of the amplitude is reported


@dataclass(frozen=True, eq=False)
class Choice:
    """An ellipse for a record."""

    ellipse: Ellipse  # to be used, with its covariance
    # sample index and ellipse, where it changes within the record; else empty
    knots: tuple[tuple[float, Ellipse], ...]
    origin: str  # its origin, in words
    group: int  # records of one group share the error of the ellipse
    changes: float = 0.0  # change of the shape within the record
    findings: tuple[OpticalFinding, ...] = ()  # doubts
    # amplitudes of a cyclic error to be taken out, rad, shape (6,); None if there is none
    error: FloatArray | None = None


def choose(surveys: Sequence[Survey], names: Sequence[str]) -> list[Choice]:
    """Choose an ellipse for each record of a set-up."""
    steady = [i for i, s in enumerate(surveys) if s.whole and not s.knots]
    others = [s for s in surveys if s.whole]
    # On an arc, light that fades looks like an ellipse that moves: it is believed if larger motions
    # show it, too.
    drifts = not others or max(s.change for s in others) > UNSTABLE
    common, scatter = _common([surveys[i].ellipse for i in steady])
    choices = []
    for index, (found, name) in enumerate(zip(surveys, names, strict=True)):
        if found.knots and (found.whole or drifts):
            choices.append(_moving(found, name, index))
        elif found.whole and common is None:
            choices.append(Choice(found.ellipse, (), "of this record", index))
        elif found.whole and common is not None:
            choices.append(
                Choice(common.of(found.ellipse), (), f"common to {len(steady)} records", -1)
            )
        elif steady:
            choices.append(_borrowed(found, name, index, surveys, steady, common, scatter))
        else:
            choices.append(_of_a_moving_one(found, name, index, surveys))
    return [
        replace(choice, findings=(*choice.findings, *_clipped(found, name)))
        for choice, found, name in zip(choices, surveys, names, strict=True)
    ]


def _clipped(found: Survey, name: str) -> list[OpticalFinding]:
    return [
        OpticalFinding(
            "clipped",
            f"{name}: photodetector signal {number} has its extreme value in {100 * part:.2g} % of "
            "its samples: the detector or its converter is at a limit, and the phase is wrong "
            "there.",
        )
        for number, part in enumerate(found.at_limit, 1)
        if part > 0.0
    ]


def of_carrier(found: Survey, index: int) -> Choice:
    """Return the circle about zero of a heterodyne signal: it needs no ellipse."""
    radius = np.hypot(found.points[0], found.points[1])
    size = float(np.median(radius))
    noise = np.full(2, max(float(np.median(np.abs(radius - size))) / 0.6745, 1e-9 * size) ** 2)
    circle = Ellipse(np.zeros(2), size * np.eye(2), np.zeros((5, 5)), noise)
    return Choice(circle, (), "none: a carrier", index)


@dataclass(frozen=True, eq=False)
class _Common:
    first: Ellipse
    mean: FloatArray
    covariance: FloatArray

    def of(self, ellipse: Ellipse) -> Ellipse:
        """Return the ellipse with the common shape and its own size."""
        return ellipse.reshaped(self.mean - self.first.shape_of(ellipse)).known_to(self.covariance)


def _common(found: Sequence[Ellipse]) -> tuple[_Common | None, FloatArray]:
    """Return the common shape of consistent ellipses, and their scatter, shape (4,)."""
    if len(found) < 2:
        return None, np.zeros(4)
    shapes = np.array([found[0].shape_of(ellipse) for ellipse in found])
    weights = [np.linalg.inv(ellipse.shape_covariance) for ellipse in found]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    mean = covariance @ np.sum([w @ s for w, s in zip(weights, shapes, strict=True)], axis=0)
    total = sum(float((s - mean) @ w @ (s - mean)) for w, s in zip(weights, shapes, strict=True))
    same = chdtrc(4 * (len(found) - 1), total) > CHANCE
    return (_Common(found[0], mean, covariance) if same else None), np.std(shapes, axis=0, ddof=1)


def _moving(found: Survey, name: str, index: int) -> Choice:
    change = found.change
    said: tuple[OpticalFinding, ...] = ()
    if change > UNSTABLE:
        text = (
            f"{name}: the ellipse of the interferometer changes by {100 * change:.2g} % of its "
            f"amplitude within the record. It is followed in {len(found.knots)} pieces of time; "
            "what changes faster is a cyclic error."
        )
        said = (OpticalFinding("ellipse_unstable", text),)
    covariance = (
        np.mean([piece.covariance for _, piece in found.knots], axis=0) / len(found.knots) * 1.5
    )
    ellipse = replace(found.ellipse, covariance=covariance)
    return Choice(ellipse, found.knots, "of this record, followed in time", index, change, said)


def _borrowed(
    found: Survey,
    name: str,
    index: int,
    surveys: Sequence[Survey],
    steady: Sequence[int],
    common: _Common | None,
    scatter: FloatArray,
) -> Choice:
    """Return the ellipse of a larger motion."""
    source = min(steady, key=lambda i: (abs(i - index), i))
    ellipse = surveys[source].ellipse if common is None else common.of(surveys[source].ellipse)
    group, origin = (source, "of a larger motion") if common is None else (-1, "of larger motions")
    said = []
    if common is None and len(steady) > 1:
        ellipse = ellipse.known_to(ellipse.shape_covariance + np.diag(scatter**2))
        group = index
        if float(np.max(scatter)) > UNSTABLE:
            text = (
                f"{name}: its ellipse is that of larger motions, whose ellipses differ by "
                f"{100 * float(np.max(scatter)):.2g} % of the amplitude; that is in the "
                "uncertainty."
            )
            said.append(OpticalFinding("ellipse_unstable", text))
    return _checked(found, name, index, Choice(ellipse, (), origin, group, 0.0, tuple(said)))


def _of_a_moving_one(found: Survey, name: str, index: int, surveys: Sequence[Survey]) -> Choice:
    """Return the mean ellipse of a larger motion whose ellipse changes, with these changes in its covariance."""
    moving = [i for i, other in enumerate(surveys) if other.whole]
    if not moving:
        return _alone(found, name, index)
    source = surveys[min(moving, key=lambda i: (abs(i - index), i))]
    shapes = np.array([source.ellipse.shape_of(piece) for _, piece in source.knots])
    ellipse = source.ellipse.known_to(
        source.ellipse.shape_covariance + np.diag(np.var(shapes, axis=0))
    )
    return _checked(found, name, index, Choice(ellipse, (), "of a larger motion, its mean", index))


def _alone(found: Survey, name: str, index: int) -> Choice:
    """Return the arc's own ellipse or a circle, with a warning."""
    kind = (
        "an ellipse through this arc"
        if found.fitted
        else "a circle, as the arc does not determine an ellipse"
    )
    text = (
        f"{name}: the motion covers {100 * found.covered_rad / (2 * np.pi):.2g} % of a fringe, and "
        f"no record of this calibration covers one. The phase is taken from {kind}; its "
        "uncertainty is in the budget. A record of larger motion in the same set-up gives the "
        "ellipse."
    )
    return Choice(found.ellipse, (), kind, index, 0.0, (OpticalFinding("few_fringes", text),))


def _checked(found: Survey, name: str, index: int, choice: Choice) -> Choice:
    """Return the choice, unless the record's samples lie beside the ellipse of the larger motion: with a warning then."""
    ellipse = choice.ellipse
    points = found.points[:, sound(ellipse, found.points)]
    off = float(np.mean(np.hypot(*ellipse.round(points)))) - 1.0 if points.shape[1] else 1.0
    if (
        abs(off)
        <= UNSTABLE
        + 5.0 * ellipse.radial_noise / np.sqrt(max(points.shape[1], 1))
        + ellipse.radial_noise**2
    ):
        return choice
    text = (
        f"{name}: its samples lie {100 * off:+.2g} % beside the ellipse of the larger motion that "
        "it is taken from: offsets or amplitudes have changed between the records."
    )
    wider = ellipse.known_to(ellipse.shape_covariance + off**2 * np.eye(4))
    said = (*choice.findings, OpticalFinding("ellipse_unstable", text))
    return replace(choice, ellipse=wider, group=index, findings=said)
