"""Comparison of the places of a grid at the coarse bins.

The gain (and the share of a second mode, which the response is linear in, too) follows in closed
form, the delay from the peak of a correlation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.bins.transfer import DiscreteTransfer
from vibrident.fit.group.group import in_batches
from vibrident.fit.group.network import products
from vibrident.fit.problem.band import Band
from vibrident.fit.response.phase_delay import PER_PERIOD, preferred
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import peak_shift, power_of
from vibrident.fit.start.coarse import CoarseRows, with_likeliest_noise
from vibrident.physics.models import SensorModel

#: Natural frequencies that differ by less than this factor are one start …
MIN_FREQUENCY_RATIO = 1.8
#: … and so are values of other parameters that differ by less than this one.
MIN_RATIO = 2.5
#: Directions in which shares hold less than this fraction of the best add nothing.
MIN_SHARE_POWER = 1e-10


@dataclass(frozen=True, eq=False)
class StartCandidate:
    """Start values and their cost.

    Attributes:
        cost: weighted sum of squares at the coarse bins.
        values: the parameters by name.
    """

    cost: float
    values: dict[str, float]


def _neutral(model: SensorModel, band_hz: tuple[float, float]) -> dict[str, float]:
    """Return values at which add-ons have no visible effect, and the gain is one."""
    low, high = band_hz
    by_guess = {
        "lowest": 1e-3 * low,
        "highest": 1e3 * high,
        "period": 1e-3 / high,
        "band": 3.0 * high,
    }
    values = {}
    for spec in model.parameters:
        positive = spec.kind in ("log", "duration", "positive")
        neutral = by_guess.get(spec.guess_at, 0.1) if positive else 0.0
        values[spec.name] = 1.0 if spec.kind == "gain" else neutral
    return values


class _Scores(NamedTuple):
    """Costs of G places of a grid, and the best gain, shares and delay of each.

    Attributes:
        cost: weighted sum of squares, infinite where the response is not finite, shape (G,).
        amounts: the best gain, and the amount of each share, shape (G, T).
        delay_s: the best delay, s, shape (G,).
    """

    cost: FloatArray
    amounts: FloatArray
    delay_s: FloatArray


@dataclass(frozen=True, eq=False)
class GridSearch:
    """Search for the best places of a grid.

    Attributes:
        band: the network.
        band_hz: lowest and highest frequency of the motion.
        rows: the coarse bins.
    """

    band: Band
    band_hz: tuple[float, float]
    rows: tuple[CoarseRows, ...]

    def best(self, places: Sequence[Mapping[str, float]], most: int) -> list[StartCandidate]:
        """Return the best and most different of the places, at most ``most``, the best first."""
        neutral = _neutral(self.band.model, self.band_hz)
        trials = [neutral | dict(place) for place in places]
        networks = [self._networks(trials, rows.bins.step) for rows in self.rows]
        bins = sum(rows.weight.size for rows in self.rows)
        batches: list[_Scores] = []
        for batch in in_batches(len(trials), bins):
            batch_networks = [
                DiscreteTransfer(*(array[batch] for array in network)) for network in networks
            ]
            batches.append(self._scored(batch_networks, trials[batch]))
        scores = _Scores(*(np.concatenate(arrays) for arrays in zip(*batches, strict=True)))
        chosen: list[StartCandidate] = []
        for number in np.argsort(scores.cost, kind="stable").tolist():
            if len(chosen) == most or not np.isfinite(scores.cost[number]):
                break
            values = self._values(
                trials[number], scores.amounts[number], float(scores.delay_s[number])
            )
            if all(self._differ(values, c.values, places[0]) for c in chosen):
                chosen.append(StartCandidate(float(scores.cost[number]), values))
        return chosen

    def _values(
        self, place: Mapping[str, float], amounts: FloatArray, delay_s: float
    ) -> dict[str, float]:
        """Return the parameters of a place by name, with its gain, shares and delay."""
        model = self.band.model
        gain, *share_amounts = amounts.tolist()
        times = [spec.name for spec in model.parameters if spec.kind == "time"]
        shares = {
            name: amount / gain for name, amount in zip(model.shares, share_amounts, strict=True)
        }
        return {**place, model.gain_name: gain, **shares, **dict.fromkeys(times, delay_s)}

    def _networks(
        self, places: Sequence[dict[str, float]], step: tuple[float, float]
    ) -> DiscreteTransfer:
        """Return the networks of G places, without shares and with one share at a time.

        Returns:
            Arrays with leading axes (G, T): all shares zero first, then each of the T − 1 shares at
                one.
        """
        model = self.band.model
        problem = self.band.problem
        trials = [
            trial
            for values in places
            for trial in (values, *({**values, name: 1.0} for name in model.shares))
        ]
        names = list(trials[0])
        fixed = {
            spec.name: problem.frame.delay_s for spec in model.parameters if spec.kind == "time"
        }
        fixed |= problem.frame.factor_values
        trained = problem.trained
        if trained.method.is_exact:
            columns: dict[str, Any] = {
                name: np.array([trial[name] for trial in trials]) for name in names
            }
            transfers = trained.transfer(columns | fixed, *step, problem.frame.delay_s)
        else:
            steps = [
                trained.transfer(trial | fixed, *step, problem.frame.delay_s) for trial in trials
            ]
            transfers = DiscreteTransfer(*(np.stack(arrays) for arrays in zip(*steps, strict=True)))
        shape = len(places), 1 + len(model.shares)
        return DiscreteTransfer(*(array.reshape(*shape, *array.shape[1:]) for array in transfers))

    def _factors(
        self,
        rows: CoarseRows,
        trials: Sequence[Mapping[str, float]],
    ) -> ComplexArray | None:
        """Return the factors of each place over those of the inputs, shape (R, G, K).

        None of a rational model.
        """
        if not self.band.problem.frame.factor_values:
            return None
        model = self.band.problem.frame.model
        inverse = 1.0 / model.factors(self.band.problem.frame.factor_values, rows.frequency_hz)
        return np.stack(
            [inverse * model.factors(values, rows.frequency_hz) for values in trials], axis=1
        )

    def _differ(
        self,
        values: Mapping[str, float],
        reference_values: Mapping[str, float],
        names: Mapping[str, float],
    ) -> bool:
        """Return whether two places differ enough in a parameter to be different starts."""
        specs = {spec.name: spec for spec in self.band.model.parameters}
        for name in names:
            factor = MIN_FREQUENCY_RATIO if specs[name].kind == "log" else MIN_RATIO
            ratio = (values[name] + 1e-300) / (reference_values[name] + 1e-300)
            if not 1.0 / factor < ratio < factor:
                return True
        return False

    def _scored(
        self,
        networks: Sequence[DiscreteTransfer],
        trials: Sequence[Mapping[str, float]],
    ) -> _Scores:
        """Return the scores of places, with the best gain, shares and delay.

        Args:
            networks: of these places at each sampling rate, as of :meth:`_networks`.
            trials: the values of each place.
        """
        finite = [self._stay_finite(*pair) for pair in zip(self.rows, networks, strict=True)]
        usable = np.flatnonzero(np.all(finite, axis=0))
        places, columns = networks[0].denominator.shape[:2]
        scores = _Scores(np.full(places, np.inf), np.zeros((places, columns)), np.zeros(places))
        if not usable.size:
            return scores
        tried = [trials[place] for place in usable.tolist()]
        finite_networks = [
            DiscreteTransfer(*(array[usable] for array in network)) for network in networks
        ]
        weights = [rows.weight[:, None] for rows in self.rows]
        log_noise = np.zeros(len(tried))
        if any(np.any(rows.reference) for rows in self.rows):
            weights, log_noise = self._weights(tried)
        fitted = self._fitted(finite_networks, tried, weights)
        fitted.cost[:] = with_likeliest_noise(self.rows, fitted.cost) + log_noise
        for array, values in zip(scores, fitted, strict=True):
            array[usable] = values
        scores.delay_s[:] += float(self.band.problem.frame.delay_s)
        return scores

    def _weights(
        self, trials: Sequence[Mapping[str, float]]
    ) -> tuple[list[FloatArray], FloatArray]:
        """Return the weights of each place in the noise of both channels, shape (R, G, K) each.

        With them: what that noise adds to −2 log likelihood, shape (G,).

        The gain by which noise of the reference passes is the median size of response over forced
        response.
        """
        model = self.band.model
        columns: dict[str, Any] = {
            name: np.array([trial[name] for trial in trials])[:, None, None]
            for name in model.parameter_names
        }
        quantity = self.band.problem.frame.quantity
        through = [
            power_of(model.frequency_response(columns, rows.frequency_hz, quantity))
            for rows in self.rows
        ]
        ratios = []
        for rows, power in zip(self.rows, through, strict=True):
            used = rows.weight > 0.0
            forced = power[:, used] * power_of(rows.bins.inputs[:, 0])[used]
            response = np.broadcast_to(power_of(rows.bins.response)[used], forced.shape)
            ratio = np.divide(response, forced, out=np.zeros_like(forced), where=forced > 0.0)
            ratios.append(ratio)
        gain_squared = np.median(np.concatenate(ratios, axis=1), axis=1)[:, None, None]
        passed = [gain_squared * power for power in through]
        weights = [
            rows.weight_at(power).swapaxes(0, 1)
            for rows, power in zip(self.rows, passed, strict=True)
        ]
        log_noise = [
            rows.log_noise_at(power) for rows, power in zip(self.rows, passed, strict=True)
        ]
        return weights, np.sum(log_noise, axis=0)

    def _fitted(
        self,
        networks: Sequence[DiscreteTransfer],
        trials: Sequence[Mapping[str, float]],
        weights: Sequence[FloatArray],
    ) -> _Scores:
        """Return the scores of places with finite networks, in weights, shape (R, G or 1, K)."""
        factors = [self._factors(rows, trials) for rows in self.rows]
        freed = self._freed(networks, factors, weights)
        if not self.band.model.has_delay:
            return _best_amounts(freed)
        delay_s = self._delays(freed)
        phases = [
            np.exp(-2j * np.pi * delay_s[:, None] * rows.frequency_hz[:, None])
            for rows in self.rows
        ]
        delayed_factors = [
            phase if factor is None else factor * phase
            for factor, phase in zip(factors, phases, strict=True)
        ]
        of_delayed_inputs = _best_amounts(self._freed(networks, delayed_factors, weights))
        for responses, phase in zip(freed, phases, strict=True):
            responses[:, :, -1] *= phase.conj()
        of_advanced_response = _best_amounts(freed)
        # Either shift is circular, and leaks what jumps between the ends: less is right.
        better = of_delayed_inputs.cost < of_advanced_response.cost
        return _Scores(
            np.where(better, of_delayed_inputs.cost, of_advanced_response.cost),
            np.where(better[:, None], of_delayed_inputs.amounts, of_advanced_response.amounts),
            delay_s,
        )

    def _freed(
        self,
        networks: Sequence[DiscreteTransfer],
        factors: Sequence[ComplexArray | None],
        weights: Sequence[FloatArray],
    ) -> list[ComplexArray]:
        """Return forced responses and response of all rows, as of :meth:`CoarseRows.freed`."""
        return [
            rows.freed(network, factor, weight)
            for rows, network, factor, weight in zip(
                self.rows, networks, factors, weights, strict=True
            )
        ]

    def _stay_finite(self, rows: CoarseRows, networks: DiscreteTransfer) -> BoolArray:
        """Return which places have networks whose states stay finite, shape (G,)."""
        usable = np.all(np.isfinite(networks.denominator), axis=(1, 2))
        if not self.band.problem.frame.method.is_exact:
            for place in np.flatnonzero(usable).tolist():
                usable[place] = all(
                    self.band.is_stable(denominator, rows.bins.step)
                    for denominator in networks.denominator[place]
                )
        return usable

    def _delays(self, freed: Sequence[ComplexArray]) -> FloatArray:
        """Return the delay of the best agreement with the first forced response, s, shape (G,)."""
        low, high = self.band_hz
        reach = max(2.0 / max(high - low, 1e-3 * high), 4.0 * self.rows[0].bins.step[0])
        count = int(np.ceil(reach * high * PER_PERIOD))
        delays_s = np.arange(-count, count + 1) / (PER_PERIOD * high)
        sums = np.zeros((freed[0].shape[1], delays_s.size))
        for rows, responses in zip(self.rows, freed, strict=True):
            cross = responses[:, :, 0].conj() * responses[:, :, -1]
            cross = np.swapaxes(cross, 0, 1).reshape(len(sums), -1)
            nonzero = np.flatnonzero(np.any(power_of(cross) > 0.0, axis=0))
            hz = rows.frequency_hz.reshape(-1)[nonzero]
            for block in in_batches(delays_s.size, hz.size):
                turns = np.exp(2j * np.pi * np.outer(delays_s[block], hz))
                sums[:, block] += (cross[:, nonzero] @ turns.T).real
        agreement = np.abs(sums)
        total_s = delays_s + self.band.problem.frame.delay_s
        best = np.argmax(preferred(agreement, total_s * high), axis=1)
        shifts = [
            peak_shift(row, place) for row, place in zip(agreement, best.tolist(), strict=True)
        ]
        return np.asarray(delays_s[best] + np.array(shifts) * (delays_s[1] - delays_s[0]))


def _best_amounts(freed: Sequence[ComplexArray]) -> _Scores:
    """Return the costs of places at the best gain and shares, with no delay.

    Args:
        freed: weighted forced responses and response of all rows, which are changed, shape (R, G,
            T + 1, K) each.
    """
    places = freed[0].shape[1]
    columns = freed[0].shape[2] - 1
    scores = _Scores(np.full(places, np.inf), np.zeros((places, columns)), np.zeros(places))
    normal = np.zeros((places, columns + 1, columns + 1))
    for responses in freed:
        responses[:, :, 1:-1] -= responses[:, :, :1]
        normal += np.sum(products(responses, responses), axis=0)
    scale = np.sqrt(np.diagonal(normal, axis1=1, axis2=2)[:, :-1])
    regular = np.all(np.isfinite(normal), axis=(1, 2)) & np.all(scale > 0.0, axis=1)
    normal = normal[regular]
    scale = scale[regular]
    right = normal[:, :-1, -1] / scale
    gram = normal[:, :-1, :-1] / scale[:, :, None] / scale[:, None]
    inverse = np.linalg.pinv(gram, rcond=MIN_SHARE_POWER, hermitian=True)
    amounts = (inverse @ right[:, :, None])[:, :, 0]
    cost = normal[:, -1, -1] - np.sum(amounts * right, axis=1)
    scores.cost[regular] = np.where(amounts[:, 0] != 0.0, cost, np.inf)
    scores.amounts[regular] = amounts / scale
    return scores
