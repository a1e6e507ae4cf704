"""Fit by the course of the reference between its samples: held, joined by lines, band-limited.

A converter holds what it is commanded to; a simulation joins the samples by lines (``lsim`` of
MATLAB and SciPy). The instants of the edges are a nuisance parameter. Of the fits that explain the
data the likeliest is taken: each would be far off if another were true.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.errors import ModelError, VibridentError
from vibrident.base.tails import chi2_tail, f_tail
from vibrident.data.records import FloatArray, Record, SystematicEffect
from vibrident.data.screening.held import has_stairs
from vibrident.fit.bins.transfer import horner, transfer_of
from vibrident.fit.descent.likelihoods import compared_where_all_excited, spread_of_gain
from vibrident.fit.descent.train import MIN_EXPLAINED_SHARE
from vibrident.fit.estimators import AUTO, Estimator
from vibrident.fit.estimators.kinds.ipnn import Ipnn
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.clocks import at_one_clock
from vibrident.fit.judge.departure_report import departure_names
from vibrident.fit.optimise import Progress
from vibrident.fit.problem import Evidence
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.verdict import REJECTION
from vibrident.fit.uncertainty.parameters import standard_uncertainties
from vibrident.physics.discretisation import Method
from vibrident.physics.models import ADD_ONS, installed
from vibrident.physics.models.state_space import realise

DELAY = "delay"
ALIASING = "aliasing"  # of motion; a commanded step has any frequency
WITHOUT_REFERENCE = "no band-limited reference is known beside them"
#: A fit is far likelier than another by this fall of −2 log of the likelihood, …
MIN_FAR_GAIN = -2.0 * math.log(REJECTION)
#: … and by this many standard deviations of what chance makes it: REJECTION of either sign.
MIN_FAR_SIGMA = 3.3
#: Course of a reference between its samples, by the discretisation that is exact for it.
REASONS = {
    "zoh": "the reference is held between its samples, as stairs: zero-order hold",
    "foh": "the reference is joined by lines between its samples: first-order hold",
}


def fit_between_samples(
    evidence: Evidence, chosen: Estimator, requested: str | Estimator, progress: Progress
) -> Fitted:
    """Estimate a linear model, the reference held, joined by lines or band-limited.

    Args:
        evidence: the data.
        chosen: the estimator that suits.
        requested: the estimator that was requested.
        progress: called after each iteration.

    Raises:
        NotConverged: no start leads to a finite fit.
    """
    if requested != AUTO:
        fitted = Fitted.from_evidence(evidence, chosen, progress)
        is_held = isinstance(chosen, Ipnn) and chosen.discretisation in REASONS
        may_have_edges = _is_drive(evidence) or has_stairs(evidence.records)
        return _at_edges(_named(fitted)) if is_held and may_have_edges else fitted
    plain = Fitted.at_first(evidence, chosen, progress)
    by_points = plain.estimate.in_noise is None
    networks = [Ipnn(discretisation=name) for name in REASONS]
    is_likely_held = has_stairs(evidence.records)
    if by_points or not is_likely_held:
        plain = plain.tried_again()
    if by_points and not plain.adequate:
        plain = at_one_clock(plain)
    if not is_likely_held:
        is_likely_held = _is_drive(evidence) and not (plain.adequate or by_points)
        explains_most = plain.judgement.explained > MIN_EXPLAINED_SHARE
        if explains_most or not is_likely_held:
            networks = [network for network in networks if _is_worth_a_fit(plain, network)]
    if not networks:
        return plain
    band_limited: Fitted | None = plain
    if by_points:
        # Points and samples are weighed differently: like is compared with like.
        band_limited = _fit_near(plain, Ipnn(), plain.values)
        if band_limited is None or band_limited.adequate:
            return plain
    compare = _likeliest_of_all if is_likely_held else _likeliest_by_far
    likeliest = compare(band_limited, networks)
    return plain if by_points and likeliest.estimator == band_limited.estimator else likeliest


def _of_samples_in_common(band_limited: Fitted) -> Fitted:
    """Return a band-limited fit whose responses are not valid where it cannot use them.

    Other courses lose no samples at the ends of a record.
    """
    problem = band_limited.estimate.problem
    records = band_limited.evidence.records
    used = [np.zeros(record.samples, dtype=bool) for record in records]
    for segment in problem.segments if isinstance(problem, BinProblem) else ():
        used[segment.record][segment.span] = True
    records = tuple(
        record.without_response(~of_record, WITHOUT_REFERENCE) if of_record.any() else record
        for record, of_record in zip(records, used, strict=True)
    )
    return replace(band_limited, evidence=replace(band_limited.evidence, records=records))


def _of_all_samples(fitted: Fitted, records: tuple[Record, ...]) -> Fitted:
    """Return a fit with the samples that were left out to compare it.

    It is the fit itself where that with all samples does not converge.
    """
    fitted = replace(fitted, evidence=replace(fitted.evidence, records=records))
    refit = _fit_near(fitted, fitted.estimator, fitted.values)
    return fitted if refit is None else replace(refit, reason=fitted.reason)


def _likeliest_by_far(band_limited: Fitted, networks: Sequence[Ipnn]) -> Fitted:
    """Return a band-limited fit, or one by a network that explains the data and is far likelier.

    They are compared by the same samples: noise differs by chance from that of some samples more,
    by as much as likelihoods do.
    """
    fits = _fits(_of_samples_in_common(band_limited), networks, band_limited.values)
    adequate = [fitted for fitted in fits if fitted.adequate]
    likeliest = _likeliest([band_limited, *adequate], by_far=True)
    if likeliest is band_limited:
        return band_limited
    return _of_all_samples(likeliest, band_limited.evidence.records)


def _likeliest_of_all(band_limited: Fitted, networks: Sequence[Ipnn]) -> Fitted:
    """Return the likeliest of a band-limited fit and the fits by networks that explain the data.

    Where none does, edges are put beside the samples, and then all are tried again.
    """
    # The hold turns the phase by half a sample: what explains most of the motion is near.
    explains_most = band_limited.judgement.explained > MIN_EXPLAINED_SHARE
    near = band_limited.values if explains_most else None
    fits = [band_limited, *_fits(band_limited, networks, near)]
    if not any(fitted.adequate for fitted in fits):
        fits = [band_limited, *map(_at_edges, fits[1:])]
    if not any(fitted.adequate for fitted in fits):
        fits = [band_limited, *_fits(band_limited, networks, None)]
        fits = [fitted.tried_again() for fitted in fits]
    adequate = [fitted for fitted in fits if fitted.adequate]
    if not adequate:
        return _closest(fits)
    likeliest = _likeliest_by_common_samples(adequate)
    if likeliest is fits[0]:
        return likeliest
    evidence = band_limited.evidence
    if not evidence.model.has_delay or has_stairs(evidence.records):
        return _at_edges(likeliest)
    # A hold is half a sample of delay: where no stairs are seen, none explains as well.
    from_delayed = _fit_near(band_limited, band_limited.estimator, likeliest.values)
    return from_delayed if from_delayed is not None and from_delayed.adequate else likeliest


def _likeliest_by_common_samples(fits: Sequence[Fitted]) -> Fitted:
    """Return the likeliest fit by the samples that all can use, where a band-limited one is first.

    A drive in stairs is held, if no other course is far likelier: noise may hide which is true. A
    fit by another course that does not converge with these samples is no likelier.
    """
    first = fits[0]
    evidence = first.evidence
    is_band_limited = first.estimate.findings.method.is_band_limited
    compared = [(fitted, fitted) for fitted in fits]
    if len(fits) > 1 and first.estimate.in_noise is not None and is_band_limited:
        in_common = _of_samples_in_common(first)
        refits = [_fit_near(in_common, fitted.estimator, fitted.values) for fitted in fits[1:]]
        compared = [(first, first)]
        compared += [
            (fitted, refit)
            for fitted, refit in zip(fits[1:], refits, strict=True)
            if refit is not None
        ]
    by_far = False
    if _is_drive(evidence) and has_stairs(evidence.records):
        compared.sort(key=lambda pair: not _is_held(pair[0]))
        by_far = _is_held(compared[0][0])
    likeliest = _likeliest([refit for _, refit in compared], by_far=by_far)
    return next(fitted for fitted, refit in compared if refit is likeliest)


def _is_held(fitted: Fitted) -> bool:
    """Return whether a fit supposes a reference that is held between its samples."""
    return isinstance(fitted.estimator, Ipnn) and fitted.estimator.discretisation == "zoh"


def _is_drive(evidence: Evidence) -> bool:
    """Return whether the reference is what was commanded, not what was measured."""
    return evidence.calibration.quantity == "drive"


def _is_worth_a_fit(fitted: Fitted, network: Ipnn) -> bool:
    """Return whether the reference may be as a network has it between the samples.

    The fit must have been tested, and explain most of the response. It leaves more than noise, or
    what the network adds, estimated beside the parameters to first order, is significant. A hold is
    half a sample of delay: a model with a delay that explains the data needs none.
    """
    judgement = fitted.judgement
    if fitted.evidence.model.has_delay and fitted.adequate:
        return False
    is_tested = judgement.adequacy.degrees_of_freedom > 0
    rates_hz = {record.sampling_rate_hz for record in fitted.evidence.records}
    if not is_tested or judgement.explained < MIN_EXPLAINED_SHARE or len(rates_hz) > 1:
        return False
    if fitted.chance < REJECTION:
        return True
    linear = fitted.linear
    try:
        change = _relative_change(fitted, network.method, linear.frequency_hz, *rates_hz)
    except ModelError:  # this discretisation does not represent the sensor
        return False
    (row,) = linear.rows_of(change[:, None]).T
    beside_parameters = row - linear.matrix @ linear.shift(row)
    score = float(beside_parameters @ linear.residual)
    information = float(beside_parameters @ row)
    if not information > 0.0:
        return False
    return chi2_tail(1.0, score**2 / information) < REJECTION


def _relative_change(
    fitted: Fitted, method: Method, frequency_hz: FloatArray, rate_hz: float
) -> ComplexArray:
    """Return by which share a discretisation changes the response at frequencies, shape (n,)."""
    evidence = fitted.evidence
    rational = evidence.model.rational(fitted.values, evidence.quantity)
    terms = method.fixed_terms or 1
    transfer = transfer_of(method.weights(realise(rational), 1.0 / rate_hz, 0.0, terms))
    shifted = np.expm1(2j * np.pi * frequency_hz / rate_hz)
    # Of a line in Legendre's terms: mean of its ends, and half their difference.
    inputs = (1.0 + 0.5 * shifted, 0.5 * shifted)[:terms] if terms > 1 else (1.0,)
    driven = sum(
        horner(column, shifted) * of_reference
        for column, of_reference in zip(transfer.numerator.T, inputs, strict=True)
    )
    s = np.asarray(2j * np.pi * frequency_hz, dtype=complex)
    numerator, denominator = (
        horner(np.asarray(coefficients, dtype=float), s)
        for coefficients in (rational.numerator, rational.denominator)
    )
    continuous = rational.gain * numerator / denominator
    return driven / horner(transfer.denominator, shifted) / continuous - 1.0


def _fits(
    plain: Fitted, networks: Sequence[Ipnn], start: Mapping[str, float] | None
) -> list[Fitted]:
    """Return the first fits by networks that converge.

    Args:
        plain: a fit of the same data.
        networks: what fits them.
        start: parameters to start from; None where they are not known.
    """
    fits = [_fit_near(plain, network, start) for network in networks]
    return [_named(fitted) for fitted in fits if fitted is not None]


def _fit_near(
    plain: Fitted, estimator: Estimator, start: Mapping[str, float] | None
) -> Fitted | None:
    """Return the first fit by an estimator, or None where it does not converge."""
    try:
        fitted = Fitted.at_first(replace(plain.evidence, start=start), estimator, plain.progress)
    except VibridentError:
        return None
    return replace(fitted, evidence=plain.evidence)


def _named(fitted: Fitted) -> Fitted:
    """Return the fit by a network with what the reference does between its samples as reason.

    Motion up to half the sampling rate is no fault of it.
    """
    estimator = fitted.estimator
    assert isinstance(estimator, Ipnn)
    findings = tuple(f for f in fitted.evidence.findings if f.code != ALIASING)
    evidence = replace(fitted.evidence, findings=findings)
    return replace(fitted, evidence=evidence, reason=REASONS[estimator.discretisation])


def _likeliest(fits: Sequence[Fitted], *, by_far: bool) -> Fitted:
    """Return the fit in whose noise the data are likeliest, in the band that all have.

    It is the first one if that is alone, by points, or no other is likelier; if ``by_far``, no
    other is far likelier.
    """
    if len(fits) == 1:
        return fits[0]
    places = []
    for fitted in fits:
        estimate = fitted.estimate
        if estimate.in_noise is None:
            return fits[0]
        places.append(tuple(estimate.in_noise.places(estimate.z, estimate.coordinates)))
    scores = compared_where_all_excited(places)
    best = int(np.argmin(scores))
    min_gain = 0.0
    if by_far:
        min_gain = max(MIN_FAR_GAIN, MIN_FAR_SIGMA * spread_of_gain(places[0], places[best]))
    return fits[best] if scores[0] - scores[best] > min_gain else fits[0]


def _closest(fits: Sequence[Fitted]) -> Fitted:
    """Return the first fit, or the one of least χ²/ν if that is less than chance allows."""
    first = fits[0]
    best = min(fits, key=_reduced_chi2)
    freedom, freedom_of_best = (
        fitted.judgement.adequacy.degrees_of_freedom for fitted in (first, best)
    )
    if min(freedom, freedom_of_best) < 1:
        return first
    ratio = _reduced_chi2(first) / max(_reduced_chi2(best), np.finfo(float).tiny)
    return best if f_tail(freedom, freedom_of_best, ratio) < REJECTION else first


def _reduced_chi2(fitted: Fitted) -> float:
    """Return χ²/ν of the adequacy test, infinite without one."""
    chi2 = fitted.judgement.adequacy.chi2_reduced
    return math.inf if chi2 is None else float(chi2)


def _at_edges(fitted: Fitted) -> Fitted:
    """Return the fit of a drive with its edges where the data show them.

    The converters of drive and response have no common instant. Where the data show that the edges
    lie beside the samples, by less than a step, the fit puts them there, and the budget has their
    uncertainty. A model with a delay contains this shift already.
    """
    delay_s = _edge_delay(fitted)
    if delay_s is None:
        return fitted
    estimator = fitted.estimator
    assert isinstance(estimator, Ipnn)
    rate_hz = fitted.evidence.records[0].sampling_rate_hz
    value, u = delay_s
    pattern = tuple((hz, 0.0, -2.0 * math.pi * hz) for hz in (0.0, 0.5 * rate_hz))
    effect = SystematicEffect("the instants of the drive's edges", "edges", u, pattern=pattern)
    delayed = replace(estimator, late_samples=value * rate_hz)
    with_effect = replace(fitted.evidence, effects=(effect,))
    shifted = Fitted.from_evidence(with_effect, delayed, fitted.progress)
    when = "after" if value > 0.0 else "before"
    edges = f"edges {amount(abs(value), 's', 3)} ± {amount(u, 's', 1)} {when} the samples"
    return replace(shifted, reason=f"{fitted.reason}, {edges}")


def _edge_delay(fitted: Fitted) -> tuple[float, float] | None:
    """Return the time, and its u, by which the edges come after the samples, s.

    None where the data do not show it.
    """
    evidence = fitted.evidence
    if evidence.model.has_delay or (fitted.adequate and DELAY not in departure_names(fitted)):
        return None
    if fitted.judgement.explained < MIN_EXPLAINED_SHARE:
        return None
    if len({record.sampling_rate_hz for record in evidence.records}) > 1:
        return None
    model = installed(f"{evidence.model.name}+{ADD_ONS[DELAY].name}")
    if model is None:
        return None
    # A fit that was rejected is no start: its parameters stand in for the delay.
    start = {**fitted.values, DELAY: 0.0} if fitted.adequate else None
    try:
        delayed = fitted.once(replace(evidence, model=model, start=start))
    except VibridentError:
        return None
    estimate = delayed.estimate
    delay_s = delayed.values[DELAY]
    if not delayed.adequate or abs(delay_s) >= evidence.records[0].sampling_interval_s:
        return None
    u = standard_uncertainties(estimate.coordinates, estimate.z, estimate.covariance)
    return delay_s, u[DELAY]
