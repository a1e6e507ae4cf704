"""Choose the ellipse for each record of a set-up: its own, a common one, or a larger motion's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from vibrident.data.interferometer.ellipse import Ellipse, weighted_mean
from vibrident.data.interferometer.setting import FloatArray
from vibrident.data.interferometer.summary import OpticalFinding
from vibrident.data.interferometer.survey import Survey, usable_samples

MEDIAN_OF_NORMAL = 0.6745  # median size of a standard normal variable
COMMON_CHANCE = 1e-3  # records share an ellipse unless their differences are less probable
MAX_STABLE_CHANGE = 0.02  # of centre, ratio or quadrature over the amplitude; more is reported


@dataclass(frozen=True, eq=False)
class EllipseChoice:
    """Ellipse chosen for a record."""

    ellipse: Ellipse  # to be used, with its covariance
    # sample index and ellipse, where it changes within the record; else empty
    knots: tuple[tuple[float, Ellipse], ...]
    origin: str  # its origin, in words
    group: int  # records of one group share the error of the ellipse
    changes: float = 0.0  # change of the shape within the record
    findings: tuple[OpticalFinding, ...] = ()  # doubts
    # amplitudes of a cyclic error to be taken out, rad, shape (6,); None if there is none
    error: FloatArray | None = None


def choose(surveys: Sequence[Survey], names: Sequence[str]) -> list[EllipseChoice]:
    """Choose an ellipse for each record of a set-up."""
    steady = [i for i, survey in enumerate(surveys) if survey.covers_fringe and not survey.knots]
    with_fringe = [survey for survey in surveys if survey.covers_fringe]
    # On an arc, light that fades looks like an ellipse that moves: it is believed if larger motions
    # show it, too.
    drifts = not with_fringe or max(survey.change for survey in with_fringe) > MAX_STABLE_CHANGE
    common, scatter = _common_ellipse_shape([surveys[i].ellipse for i in steady])
    choices = []
    for index, (record_survey, name) in enumerate(zip(surveys, names, strict=True)):
        ellipse = record_survey.ellipse
        if record_survey.knots and (record_survey.covers_fringe or drifts):
            choice = _unsteady_choice(record_survey, index)
        elif record_survey.covers_fringe and common is None:
            choice = EllipseChoice(ellipse, (), "of this record", index)
        elif record_survey.covers_fringe and common is not None:
            origin = f"common to {len(steady)} records"
            choice = EllipseChoice(common.with_size_of(ellipse), (), origin, -1)
        else:
            choice = _borrowed_choice(record_survey, index, surveys, steady, common, scatter)
        doubts = [
            replace(doubt, message=f"{name}: {doubt.message}")
            for doubt in (*choice.findings, *_clipping_findings(record_survey))
        ]
        choices.append(replace(choice, findings=tuple(doubts)))
    return choices


def _clipping_findings(record_survey: Survey) -> list[OpticalFinding]:
    return [
        OpticalFinding(
            "clipped",
            f"photodetector signal {number} has its extreme value in {100 * share:.2g} % "
            "of its samples: the detector or its converter is at a limit, and the phase is wrong "
            "there.",
        )
        for number, share in enumerate(record_survey.at_limit, 1)
        if share > 0.0
    ]


def carrier_choice(record_survey: Survey, index: int) -> EllipseChoice:
    """Return the circle about zero of a heterodyne signal, which needs no ellipse."""
    radius = np.hypot(record_survey.points[0], record_survey.points[1])
    size = float(np.median(radius))
    deviation = float(np.median(np.abs(radius - size))) / MEDIAN_OF_NORMAL
    noise = np.full(2, max(deviation, 1e-9 * size) ** 2)
    circle = Ellipse(np.zeros(2), size * np.eye(2), np.zeros((5, 5)), noise)
    return EllipseChoice(circle, (), "none: a carrier", index)


@dataclass(frozen=True, eq=False)
class _CommonShape:
    first: Ellipse
    mean: FloatArray
    covariance: FloatArray

    def with_size_of(self, ellipse: Ellipse) -> Ellipse:
        """Return the ellipse of the common shape with the size of the given one."""
        return ellipse.reshaped(self.mean - self.first.shape_of(ellipse)).with_shape_covariance(
            self.covariance
        )


def _common_ellipse_shape(ellipses: Sequence[Ellipse]) -> tuple[_CommonShape | None, FloatArray]:
    """Return the common shape of consistent ellipses, and their scatter, shape (4,).

    None for the shape if the ellipses are too few or inconsistent.
    """
    if len(ellipses) < 2:
        return None, np.zeros(4)
    shapes = [ellipses[0].shape_of(ellipse) for ellipse in ellipses]
    mean, covariance, total = weighted_mean(
        shapes, [ellipse.shape_covariance for ellipse in ellipses]
    )
    same = chdtrc(4 * (len(ellipses) - 1), total) > COMMON_CHANCE
    common = _CommonShape(ellipses[0], mean, covariance) if same else None
    return common, np.std(shapes, axis=0, ddof=1)


def _unsteady_choice(record_survey: Survey, index: int) -> EllipseChoice:
    change = record_survey.change
    findings: tuple[OpticalFinding, ...] = ()
    if change > MAX_STABLE_CHANGE:
        text = (
            f"the ellipse of the interferometer changes by {100 * change:.2g} % of its "
            f"amplitude within the record. It is followed in {len(record_survey.knots)} pieces of "
            "time; what changes faster is a cyclic error."
        )
        findings = (OpticalFinding("ellipse_unstable", text),)
    covariance = (
        np.mean([piece.covariance for _, piece in record_survey.knots], axis=0)
        / len(record_survey.knots)
        * 1.5
    )
    ellipse = replace(record_survey.ellipse, covariance=covariance)
    return EllipseChoice(
        ellipse, record_survey.knots, "of this record, followed in time", index, change, findings
    )


def _borrowed_choice(
    record_survey: Survey,
    index: int,
    surveys: Sequence[Survey],
    steady: Sequence[int],
    common: _CommonShape | None,
    scatter: FloatArray,
) -> EllipseChoice:
    """Return the ellipse of a larger motion: of one whose ellipse changes, the mean.

    What it changes by, or larger motions differ by, is in the covariance.
    """
    lenders = steady or [i for i, survey in enumerate(surveys) if survey.covers_fringe]
    if not lenders:
        return _arc_choice(record_survey, index)
    source = min(lenders, key=lambda i: (abs(i - index), i))
    ellipse = surveys[source].ellipse
    spread = None
    group = source
    origin = "of a larger motion"
    findings: tuple[OpticalFinding, ...] = ()
    if surveys[source].knots:
        shapes = [ellipse.shape_of(piece) for _, piece in surveys[source].knots]
        spread = np.var(shapes, axis=0)
        group = index
        origin = "of a larger motion, its mean"
    elif common is not None:
        ellipse = common.with_size_of(ellipse)
        group = -1
        origin = "of larger motions"
    elif len(steady) > 1:
        spread = scatter**2
        group = index
        if float(np.max(scatter)) > MAX_STABLE_CHANGE:
            text = (
                "its ellipse is that of larger motions, whose ellipses differ by "
                f"{100 * float(np.max(scatter)):.2g} % of the amplitude; that is in the "
                "uncertainty."
            )
            findings = (OpticalFinding("ellipse_unstable", text),)
    if spread is not None:
        ellipse = ellipse.with_shape_covariance(ellipse.shape_covariance + np.diag(spread))
    choice = EllipseChoice(ellipse, (), origin, group, 0.0, findings)
    return _check_choice(record_survey, index, choice)


def _arc_choice(record_survey: Survey, index: int) -> EllipseChoice:
    """Return the arc's own ellipse or a circle, with a finding."""
    kind = (
        "an ellipse through this arc"
        if record_survey.fitted
        else "a circle, as the arc does not determine an ellipse"
    )
    text = (
        f"the motion covers {100 * record_survey.covered_rad / (2 * np.pi):.2g} % of a "
        f"fringe, and no record of this calibration covers one. The phase is taken from {kind}; "
        "its uncertainty is in the budget. A record of larger motion in the same set-up gives the "
        "ellipse."
    )
    return EllipseChoice(
        record_survey.ellipse, (), kind, index, 0.0, (OpticalFinding("few_fringes", text),)
    )


def _check_choice(record_survey: Survey, index: int, choice: EllipseChoice) -> EllipseChoice:
    """Return the choice, widened and with a finding if the samples lie off the borrowed ellipse."""
    ellipse = choice.ellipse
    points = record_survey.points[:, usable_samples(ellipse, record_survey.points)]
    off = (
        float(np.mean(np.hypot(*ellipse.to_unit_circle(points)))) - 1.0 if points.shape[1] else 1.0
    )
    if (
        abs(off)
        <= MAX_STABLE_CHANGE
        + 5.0 * ellipse.radial_noise / np.sqrt(max(points.shape[1], 1))
        + ellipse.radial_noise**2
    ):
        return choice
    text = (
        f"its samples lie {100 * off:+.2g} % beside the ellipse of the larger motion that "
        "it is taken from: offsets or amplitudes have changed between the records."
    )
    wider = ellipse.with_shape_covariance(ellipse.shape_covariance + off**2 * np.eye(4))
    findings = (*choice.findings, OpticalFinding("ellipse_unstable", text))
    return replace(choice, ellipse=wider, group=index, findings=findings)
