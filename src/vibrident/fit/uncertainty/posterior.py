"""The posterior distribution of the parameters, by Markov chain Monte Carlo, where the linearised one may mislead.

The likelihood is that of the measured complex responses, not linearised: for tones Student's t in two dimensions, whose
degrees of freedom are those of the noise estimated beside the tone; normal for the stated uncertainties of a table. The
priors are flat in the optimiser's coordinates (``problem.coordinates``) within the range that a fit searches, but for
damping ratios (half-Cauchy of scale one) and the share of a second mode (Cauchy of scale one): they are proper in every
direction that data may leave open. Sampled by the no-U-turn sampler (Hoffman & Gelman 2014) from NumPyro, the extra
``bayes``. It uses separate coordinates without bounds: a logarithm within its range goes through the logistic
function, and a core's damping is taken over the natural frequency, because that is what the phase below resonance shows
when it shows neither. The linearised covariance makes them round.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.base import extras
from vibrident.base.backend import jax, jnp
from vibrident.base.errors import InputError
from vibrident.base.participants import takes_part
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.estimators import Estimate
from vibrident.fit.estimators.kinds.ml import solved_problem
from vibrident.fit.problem import Coordinates, Evidence, FrequencyProblem
from vibrident.fit.uncertainty.parameters import COVERAGE

PRIOR = (
    "flat in the logarithm of frequencies and of a boxcar's length, within the range that a fit searches; flat in gain "
    "and delay; half-Cauchy of scale 1 for damping ratios; Cauchy of scale 1 for the share of a second mode"
)


@dataclass(frozen=True)
class Sampling:
    """Settings of the sampler.

    Attributes:
        chains: side by side, from starts spread by the linearised covariance.
        warm_up: steps of each that adapt the sampler and are thrown away.
        draws: steps of each that are kept.
        seed: of all of them.
    """

    chains: int = 4
    warm_up: int = 500
    draws: int = 1000
    seed: int = 0


def sampler(module: str = "numpyro") -> Any:
    """A module of the sampler's library.

    Raises:
        InputError: it is not installed; the remedy installs it.
    """
    takes_part("numpyro", "jax", "jaxlib")
    return extras.library(
        module, "bayes", "Sampling the posterior needs a library that is not installed.", "⟦identify.posterior⟧"
    )


def sample_posterior(evidence: Evidence, estimate: Estimate, scale: float, sampling: Sampling) -> dict[str, Any]:
    """Draw from the posterior and sum it up, as plain values for a result.

    Args:
        evidence: the data.
        estimate: of maximum likelihood.
        scale: factor on the data's standard deviations that the result's uncertainties carry too.
        sampling: settings.

    Returns:
        Settings and diagnostics, the parameters that the prior bounds in place of the data (``ends_by_prior``), and
        for every parameter mean, standard deviation, 95 % credible interval (equal tails), R̂ and effective sample
        size, in the units of the result's parameters.

    Raises:
        InputError: the estimator is another, or NumPyro is not installed.
    """
    if estimate.criterion != "likelihood":
        raise InputError(
            "The posterior is sampled from the likelihood of the responses in frequency.",
            expected="sine records or a table, with an estimator of maximum likelihood",
            found=f"estimator {estimate.estimator!r}",
            where="⟦identify.posterior⟧",
            remedy="add ⟦identify.estimator = 'ml'⟧, or leave ⟦identify.posterior⟧ out",
        )
    infer, diagnostics = sampler("numpyro.infer"), sampler("numpyro.diagnostics")
    coordinates, middle = estimate.coordinates, np.asarray(estimate.z)
    free = _Unbounded.of(coordinates, middle)
    first, root = free.round(middle, np.asarray(estimate.covariance) * scale**2)
    density = _log_density(coordinates, solved_problem(estimate, evidence), _freedom(estimate), scale)

    def potential(w: Any) -> Any:
        v = first + root @ w
        return -density(free.bounded(v)) - free.log_volume(v)

    key, spread = jax.random.split(jax.random.PRNGKey(sampling.seed))
    starts = jax.random.normal(spread, (sampling.chains, len(middle)))
    kernel = infer.NUTS(potential_fn=potential, dense_mass=True, target_accept_prob=0.98)
    chain = infer.MCMC(
        kernel,
        num_warmup=sampling.warm_up,
        num_samples=sampling.draws,
        num_chains=sampling.chains,
        chain_method="vectorized",
        progress_bar=False,
    )
    chain.run(key, init_params=starts, extra_fields=("diverging",))
    w = np.asarray(chain.get_samples(group_by_chain=True))
    diverging = float(np.mean(np.asarray(chain.get_extra_fields()["diverging"])))
    drawn = np.asarray(jax.vmap(free.bounded)(first + w.reshape(-1, len(middle)) @ root.T)).reshape(w.shape)
    table = {name: _summary(values, diagnostics) for name, values in _physical(coordinates, drawn).items()}
    worst = max(row["r_hat"] for row in table.values())
    return {
        "sampler": f"NUTS (numpyro {sampler('numpyro').__version__})",
        "chains": sampling.chains,
        "warm_up": sampling.warm_up,
        "draws": sampling.draws,
        "seed": sampling.seed,
        "prior": PRIOR,
        "covers": "the data's noise or stated uncertainties; systematic contributions are in the parameters alone",
        "diverging": diverging,
        "converged": worst < 1.02 and diverging < 0.01,  # Vehtari et al. 2021
        "ends_by_prior": free.ended(drawn, coordinates.model.parameter_names),
        "parameters": table,
    }


@dataclass(frozen=True, eq=False)
class _Unbounded:
    """The sampler's coordinates v, without bounds, and the optimiser's z."""

    low: FloatArray  # lowest z, shape (p,); −∞ where there is no bound
    high: FloatArray  # highest z, likewise
    damping: int  # index of the core's damping ratio; −1 if it has no damping ratio
    frequency: int  # index of its natural frequency
    at: float  # z of the natural frequency that damping is taken over

    @classmethod
    def of(cls, coordinates: Coordinates, z: FloatArray) -> _Unbounded:
        """Those of a model, ``at`` an estimate."""
        names = list(coordinates.model.parameter_names)
        pair = coordinates.model.core.oscillator
        low, high = coordinates.edges
        if pair is None:
            return cls(low, high, -1, -1, 0.0)
        frequency, damping = (names.index(name) for name in pair)
        return cls(low, high, damping, frequency, float(z[frequency]))

    @property
    def range(self) -> tuple[BoolArray, FloatArray, FloatArray]:
        """Which coordinates have ends, and these; zero and one for the others."""
        closed = np.isfinite(self.low)
        return closed, np.where(closed, self.low, 0.0), np.where(closed, self.high, 1.0)

    def bounded(self, v: Any) -> Any:
        """Optimiser's z of v, shape (p,)."""
        closed, low, high = self.range
        z = jnp.where(closed, low + (high - low) * jax.nn.sigmoid(v), v)
        if self.damping >= 0:
            z = z.at[self.damping].set(jnp.arcsinh(v[self.damping] * jnp.exp(z[self.frequency] - self.at)))
        return z

    def ended(self, z: FloatArray, names: Sequence[str]) -> list[str]:
        """Parameters of which the range searched, and not the data, ends the distribution."""
        closed, low, high = self.range
        margin = 0.05 * (high - low)
        part = np.mean(closed & ((z < low + margin) | (z > high - margin)), axis=(0, 1))
        return [name for name, share in zip(names, part, strict=True) if share > 0.01]

    def log_volume(self, v: Any) -> Any:
        """Logarithm of |∂z/∂v|, which keeps a density of z one of v."""
        return jnp.linalg.slogdet(jax.jacfwd(self.bounded)(v))[1]

    def round(self, z: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The v of z, and L with L Lᵀ the covariance of v; no direction is wider than three."""
        closed = self.range[0]
        share = (z[closed] - self.low[closed]) / (self.high[closed] - self.low[closed])
        share = np.clip(share, 1e-3, 1.0 - 1e-3)
        v = np.array(z, dtype=float)
        if self.damping >= 0:
            v[self.damping] = np.sinh(z[self.damping])
        v[closed] = np.log(share / (1.0 - share))
        back = np.linalg.inv(np.asarray(jax.jacfwd(self.bounded)(jnp.asarray(v))))
        moved = back @ covariance @ back.T
        values, vectors = np.linalg.eigh(0.5 * (moved + moved.T))
        return v, vectors * np.clip(np.sqrt(np.maximum(values, 0.0)), 1e-12, 3.0)


def _freedom(estimate: Estimate) -> FloatArray | None:
    """Degrees of freedom behind the deviation of each tone; None where it is known: stated, or as the misfit has it."""
    if estimate.tones is None or estimate.findings.model_error is not None:
        return None
    return estimate.tones.degrees_of_freedom


def _log_density(
    coordinates: Coordinates, problem: FrequencyProblem, freedom: FloatArray | None, scale: float
) -> Callable[[Any], Any]:
    """Log posterior density of the coordinates z, up to a constant."""

    def likelihood(z: Any) -> Any:
        residual = problem.residual(z, coordinates) / scale
        if freedom is None:
            return -0.5 * jnp.sum(residual**2)
        squares = jnp.sum(residual.reshape(2, -1) ** 2, axis=0)
        return -jnp.sum(0.5 * (freedom + 2.0) * jnp.log1p(squares / freedom))

    def prior(z: Any) -> Any:
        # Cauchy's of unit width, of a damping ratio sinh z as of a ratio z.
        own = {"positive": lambda z: jnp.log(jnp.cosh(z)), "ratio": lambda z: jnp.log1p(z**2)}
        kinds = [spec.kind for spec in coordinates.model.parameters]
        return -sum((own[kind](z[i]) for i, kind in enumerate(kinds) if kind in own), start=jnp.zeros(()))

    return lambda z: likelihood(z) + prior(z)


def _physical(coordinates: Coordinates, z: FloatArray) -> dict[str, FloatArray]:
    """Every parameter of every draw, estimated and derived; z of shape (chains, draws, p), values (chains, draws)."""
    moved = np.moveaxis(z, -1, 0)
    values = {name: np.asarray(value) for name, value in coordinates.physical(moved).items()}
    flat = [dict(zip(values, draw, strict=True)) for draw in zip(*(v.ravel() for v in values.values()), strict=True)]
    for quantity in coordinates.model.core.derived:
        if all(quantity.exists(draw) for draw in flat):
            values[quantity.name] = np.asarray(quantity.value(values))
    return values


def _summary(values: FloatArray, diagnostics: Any) -> dict[str, Any]:
    tail = 50.0 * (1.0 - COVERAGE)
    low, high = np.percentile(values, [tail, 100.0 - tail])
    return {
        "mean": float(np.mean(values)),
        "standard_deviation": float(np.std(values, ddof=1)),
        "interval_95": [float(low), float(high)],
        "r_hat": float(diagnostics.split_gelman_rubin(values)),
        "effective_sample_size": float(diagnostics.effective_sample_size(values)),
    }
