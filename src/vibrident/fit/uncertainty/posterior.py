"""The posterior distribution of the parameters, by Markov chain Monte Carlo.

It serves where the linearised distribution may mislead. The likelihood is that of the measured
complex responses, not linearised. Maximum likelihood of tones has Student's t in two dimensions,
with the degrees of freedom of the noise estimated beside the tone; a table has normal
distributions with its stated uncertainties. For every other estimator the response's change from
the estimate, at the measured points, is split in two: the part that the parameters make to first
order has the estimate's covariance, the remainder that of the points. To first order the posterior
is then the stated covariance.

The prior is flat in the optimiser's coordinates (``problem.coordinates``) within the range that a
fit searches. An ensemble of chains samples with steps of differential evolution (ter Braak 2006)
from emcee (Foreman-Mackey et al. 2013), the extra ``bayes``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.base import extras
from vibrident.base.errors import InputError
from vibrident.base.participants import takes_part
from vibrident.data.records import FloatArray
from vibrident.fit.estimators import Estimate
from vibrident.fit.estimators.kinds.ml import solved_problem
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.fit.uncertainty.parameters import COVERAGE

PRIOR = (
    "flat in the logarithm of frequencies and of a boxcar's length, within the range that a fit "
    "searches; flat in gain, delay, the share of a second mode and asinh of damping ratios"
)
#: Fewest autocorrelation times of a chain that determines them (emcee's documentation).
MIN_AUTOCORRELATION_TIMES = 50.0
#: Share of steps by differential evolution (ter Braak 2006); the others jump between modes, as
#: emcee's documentation proposes.
DIFFERENTIAL_SHARE = 0.8
#: The range ends a distribution with more than ``MIN_END_SHARE`` of its draws within this part of
#: the range at its ends.
END_MARGIN = 0.05
MIN_END_SHARE = 0.01

#: Residual of a likelihood at coordinates z, shape (m,).
Residual = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Sampling:
    """Settings of the sampler.

    Attributes:
        chains: walkers of the ensemble; at least twice as many as parameters.
        warm_up: steps of each walker that are discarded.
        draws: steps of each walker that make the sample.
        seed: of the random numbers of all walkers.

    Examples:
        >>> import vibrident
        >>> vibrident.Sampling(draws=1000)
        Sampling(chains=32, warm_up=500, draws=1000, seed=0)
    """

    chains: int = 32
    warm_up: int = 500
    draws: int = 3000
    seed: int = 0


def sampler() -> Any:
    """Load the sampler's library.

    Raises:
        InputError: it is not installed; the remedy installs it.
    """
    takes_part("emcee")
    return extras.library(
        "emcee",
        "bayes",
        "Sampling the posterior needs a library that is not installed.",
        "⟦identify.posterior⟧",
    )


def sample_posterior(
    evidence: Evidence, estimate: Estimate, linear: Linearised, scale: float, sampling: Sampling
) -> dict[str, Any]:
    """Draw from the posterior and summarise it as plain values for a result.

    Args:
        evidence: the data.
        estimate: the fit.
        linear: the fit at the measured points.
        scale: factor on the data's standard deviations that the result's uncertainties carry too.
        sampling: settings.

    Returns:
        Settings and diagnostics, the parameters that the prior bounds in place of the data
        (``ends_by_prior``), and for every parameter mean, standard deviation, 95 % credible
        interval (equal tails), autocorrelation time and effective sample size, in the units of the
        result's parameters.

    Raises:
        InputError: the model has no transfer function, or emcee is not installed.
    """
    emcee = sampler()
    coordinates = estimate.coordinates
    centre = estimate.z
    low, high = _search_range(coordinates)
    density = log_density(*likelihood(evidence, estimate, linear), scale, low, high)
    random = np.random.RandomState(sampling.seed)
    covariance_root = _covariance_root(estimate.covariance * scale**2)
    starts = centre + random.standard_normal((sampling.chains, len(centre))) @ covariance_root.T
    starts = np.clip(starts, np.maximum(low, centre - 3.0), np.minimum(high, centre + 3.0))
    moves = [
        (emcee.moves.DEMove(), DIFFERENTIAL_SHARE),
        (emcee.moves.DESnookerMove(), 1.0 - DIFFERENTIAL_SHARE),
    ]
    ensemble = emcee.EnsembleSampler(sampling.chains, len(centre), density, moves=moves)
    state = emcee.State(starts, random_state=random.get_state())
    state = ensemble.run_mcmc(state, sampling.warm_up, skip_initial_state_check=True)
    ensemble.reset()
    ensemble.run_mcmc(state, sampling.draws, skip_initial_state_check=True)
    samples = ensemble.get_chain()
    summaries = {
        name: _summarise(values, emcee)
        for name, values in _physical_values(coordinates, samples).items()
    }
    longest_time = max(row["autocorrelation_time"] for row in summaries.values())
    return {
        "sampler": f"differential evolution (emcee {emcee.__version__})",
        "chains": sampling.chains,
        "warm_up": sampling.warm_up,
        "draws": sampling.draws,
        "seed": sampling.seed,
        "prior": PRIOR,
        "covers": "the data's noise or stated uncertainties; "
        "systematic contributions are in the parameters alone",
        "accepted": float(np.mean(ensemble.acceptance_fraction)),
        "converged": bool(sampling.draws > MIN_AUTOCORRELATION_TIMES * longest_time),
        "ends_by_prior": ended_by_prior(samples, low, high, coordinates.model.parameter_names),
        "parameters": summaries,
    }


def likelihood(
    evidence: Evidence, estimate: Estimate, linear: Linearised
) -> tuple[Residual, FloatArray | None]:
    """Return the residual whose squares make the likelihood, and the tones' degrees of freedom.

    The latter are None where the deviations are known, as stated or from the misfit.

    Raises:
        InputError: the model has no transfer function.
    """
    coordinates = estimate.coordinates
    if estimate.criterion == "likelihood":
        problem = solved_problem(estimate, evidence)
        freedom = None
        if estimate.tones is not None and estimate.findings.model_error is None:
            freedom = estimate.tones.degrees_of_freedom
        return (lambda z: problem.residual(z, coordinates)), freedom
    if not coordinates.model.is_linear or not len(linear.residual):
        raise InputError(
            "The posterior is sampled from the responses in frequency.",
            expected="a linear model, and records with a reference or a table",
            found=f"the model {coordinates.model.name!r} with {len(linear.residual) // 2} points",
            where="⟦identify.posterior⟧",
            remedy="leave ⟦identify.posterior⟧ out",
        )

    def response(z: FloatArray) -> FloatArray:
        values = coordinates.values(z)
        return coordinates.model.frequency_response(values, linear.frequency_hz, linear.quantity)

    pseudo_inverse = np.linalg.pinv(linear.matrix)
    response_at_estimate = response(linear.z)
    whitening = np.linalg.pinv(_covariance_root(estimate.covariance))

    def residual(z: FloatArray) -> FloatArray:
        ratio = response(z) / response_at_estimate
        change = linear.weight * np.where(linear.is_phase, np.angle(ratio), np.log(np.abs(ratio)))
        first_order = pseudo_inverse @ change
        return np.concatenate([whitening @ first_order, change - linear.matrix @ first_order])

    return residual, None


def log_density(
    residual: Residual, freedom: FloatArray | None, scale: float, low: FloatArray, high: FloatArray
) -> Callable[[FloatArray], float]:
    """Return the log posterior density of the coordinates z, up to a constant.

    ``freedom``: degrees of freedom of Student's t at each point, shape (n,); None for a normal
    likelihood. ``low``, ``high``: ends of the flat prior, shape (p,).
    """

    def density(z: FloatArray) -> float:
        if np.any(z < low) or np.any(z > high):
            return -np.inf
        scaled = residual(z) / scale
        if freedom is None:
            value = -0.5 * float(scaled @ scaled)
        else:
            squares = np.sum(scaled.reshape(2, -1) ** 2, axis=0)
            value = -float(np.sum(0.5 * (freedom + 2.0) * np.log1p(squares / freedom)))
        return value if np.isfinite(value) else -np.inf

    return density


def ended_by_prior(
    z: FloatArray, low: FloatArray, high: FloatArray, names: Sequence[str]
) -> list[str]:
    """Return the names of parameters whose distribution ends at the prior's range.

    ``z``: the draws, shape (draws, chains, p).
    """
    bounded = np.isfinite(low) & np.isfinite(high)
    margin = END_MARGIN * np.where(bounded, high - low, 0.0)
    end_shares = np.mean(bounded & ((z < low + margin) | (z > high - margin)), axis=(0, 1))
    return [name for name, share in zip(names, end_shares, strict=True) if share > MIN_END_SHARE]


def _search_range(coordinates: Coordinates) -> tuple[FloatArray, FloatArray]:
    """Return lowest and highest coordinates; a damping ratio is the same for z and −z."""
    low, high = coordinates.edges
    mirrored = [spec.kind == "positive" for spec in coordinates.model.parameters]
    return np.where(mirrored, 0.0, low), high


def _covariance_root(covariance: FloatArray) -> FloatArray:
    """Return L with L Lᵀ the covariance."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _physical_values(coordinates: Coordinates, z: FloatArray) -> dict[str, FloatArray]:
    """Return every parameter of every draw, estimated and derived, by name.

    ``z``: of shape (draws, chains, p); the values have shape (draws, chains).
    """
    values = coordinates.physical(np.moveaxis(z, -1, 0))
    draws = [
        dict(zip(values, draw, strict=True))
        for draw in zip(*(v.ravel() for v in values.values()), strict=True)
    ]
    for quantity in coordinates.model.core.derived:
        if all(quantity.exists(draw) for draw in draws):
            values[quantity.name] = quantity.value(values)
    return values


def _summarise(values: FloatArray, emcee: Any) -> dict[str, Any]:
    """Return mean, deviation, interval and autocorrelation of one parameter's draws."""
    tail_percent = 50.0 * (1.0 - COVERAGE)
    low, high = np.percentile(values, [tail_percent, 100.0 - tail_percent])
    time = float(emcee.autocorr.integrated_time(values, tol=0)[0])
    time = time if np.isfinite(time) else float(len(values))  # draws that never moved
    return {
        "mean": float(np.mean(values)),
        "standard_deviation": float(np.std(values, ddof=1)),
        "interval_95": [float(low), float(high)],
        "autocorrelation_time": time,
        "effective_sample_size": float(values.size / max(time, 1.0)),
    }
