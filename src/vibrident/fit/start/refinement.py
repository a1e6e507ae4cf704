"""Descent of start values at the coarse bins, by few evaluations of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.group.network import Step, evaluate, products
from vibrident.fit.information import inverse_where_shown, laplace_score
from vibrident.fit.optimise import levenberg_marquardt
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.frequency_domain import Local
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of
from vibrident.fit.start.coarse import CoarseRows, with_likeliest_noise
from vibrident.fit.start.grid_search import StartCandidate

#: Decrease of the cost that is not worth a step.
TOLERANCE = 0.5
MAX_EVALUATIONS = 15


@dataclass(frozen=True, eq=False)
class CoarseDescent:
    """Descent at the coarse bins.

    Attributes:
        band: the network.
        band_hz: lowest and highest frequency of the motion.
        rows: the coarse bins.
    """

    band: Band
    band_hz: tuple[float, float]
    rows: Sequence[CoarseRows]

    def refined(
        self, front: Sequence[StartCandidate], held: Sequence[str] = ()
    ) -> list[StartCandidate]:
        """Return where candidates descend to, the likeliest first, each end once.

        Args:
            front: the candidates.
            held: parameters that stay as they are.
        """
        ends: list[StartCandidate] = []
        descended = [self._descended(candidate, held) for candidate in front]
        for end in sorted(descended, key=lambda candidate: candidate.cost):
            # Two descents to one bottom end within their tolerance of it.
            if not ends or end.cost > ends[-1].cost + 2.0 * TOLERANCE:
                ends.append(end)
        return ends

    def with_second_mode(
        self, front: Sequence[StartCandidate], modes: Sequence[Mapping[str, float]]
    ) -> list[StartCandidate]:
        """Return where one step from the model without second mode leads, the best mode first.

        A mode of little share hides in the misfit of a first mode that is not exact. From the best
        fit without it, its share and the change of the other parameters are linear (score test;
        Rao 1948).

        Args:
            front: places of the first mode.
            modes: frequency and damping of the second, by name.
        """
        shares = self.band.model.shares
        first_modes = [
            replace(place, values=place.values | dict.fromkeys(shares, 0.0)) for place in front
        ]
        smaller = self.refined(first_modes, held=shares)[0]
        delayed = self._delayed(smaller)
        scanned = []
        for mode in modes:
            coordinates = self._coordinates({**smaller.values, **mode})
            z = coordinates.first
            local = _local(self.band, delayed, coordinates, z)
            step = inverse_where_shown(local.matrix) @ local.gradient
            values = self._with_excess(coordinates.values(coordinates.moved(z, step)), smaller)
            scanned.append(StartCandidate(local.cost - float(step @ local.gradient), values))
        return sorted(scanned, key=lambda place: place.cost)

    def _descended(self, candidate: StartCandidate, held: Sequence[str]) -> StartCandidate:
        """Return where a candidate descends to, with the inputs delayed as much as it."""
        coordinates = self._coordinates(candidate.values)
        delayed = self._delayed(candidate)
        free = np.array([name not in held for name in self.band.model.parameter_names], dtype=float)

        def objective(z: FloatArray, _: None) -> Local:
            local = _local(self.band, delayed, coordinates, z)
            return Local(local.matrix * np.outer(free, free), local.gradient * free, local.cost)

        try:
            trace = levenberg_marquardt(
                objective,
                coordinates.first,
                None,
                tolerance=TOLERANCE,
                max_evaluations=MAX_EVALUATIONS,
            )
        except (NotConverged, np.linalg.LinAlgError):
            return candidate
        values = self._with_excess(coordinates.values(trace.last), candidate)
        return StartCandidate(self._score(values), values)

    def _score(self, values: Mapping[str, float]) -> float:
        """Return −2 log of the likelihood of the data (Laplace), in the noise at these values."""
        end = StartCandidate(np.inf, dict(values))
        coordinates = self._coordinates(values)
        local = _local(self.band, self._delayed(end), coordinates, coordinates.first)
        log_noise = sum(
            float(rows.log_noise_at(self._through(rows, values)))
            for rows in self.rows
            if np.any(rows.reference)
        )
        cost = with_likeliest_noise(self.rows, np.array([local.cost]))[0]
        return float(laplace_score(cost, local.matrix)) + log_noise

    def _through(self, rows: CoarseRows, values: Mapping[str, float]) -> FloatArray:
        """Return |H|² by which noise of the reference passes, shape (R, K)."""
        quantity = self.band.problem.frame.quantity
        return power_of(self.band.model.frequency_response(values, rows.frequency_hz, quantity))

    def _coordinates(self, values: Mapping[str, float]) -> Coordinates:
        """Return coordinates around values, with the delay of the inputs."""
        delays = dict.fromkeys(self._times, float(self.band.problem.frame.delay_s))
        return Coordinates.at(self.band.model, {**values, **delays}, self.band_hz)

    def _delayed(self, candidate: StartCandidate) -> list[CoarseRows]:
        """Return the rows with their inputs at a candidate's delay, in the noise of both channels.

        The inputs are delayed, or the response is advanced as much. Either shift is circular, and
        leaks what jumps between the ends of its channel, so the one that leaves less is taken.
        """
        rows = list(self.rows)
        for place, of_rate in enumerate(rows):
            if np.any(of_rate.reference):
                weight = of_rate.weight_at(self._through(of_rate, candidate.values))
                rows[place] = replace(of_rate, weight=weight)
        excess_s = self._excess_s(candidate)
        if excess_s == 0.0:
            return rows
        coordinates = self._coordinates(candidate.values)
        both = [_shifted(rows, excess_s, inputs=inputs) for inputs in (True, False)]
        return min(
            both, key=lambda rows: _local(self.band, rows, coordinates, coordinates.first).cost
        )

    def _with_excess(
        self, values: Mapping[str, float], candidate: StartCandidate
    ) -> dict[str, float]:
        """Return values at the rows that :meth:`_delayed` gives as those at the rows themselves."""
        excess_s = self._excess_s(candidate)
        return {**values, **{name: values[name] + excess_s for name in self._times}}

    def _excess_s(self, candidate: StartCandidate) -> float:
        """Return by how much a candidate's delay exceeds that of the inputs, s."""
        delay_s = float(self.band.problem.frame.delay_s)
        return sum(candidate.values[name] - delay_s for name in self._times)

    @property
    def _times(self) -> list[str]:
        """Return the names of the delays, at most one."""
        return [spec.name for spec in self.band.model.parameters if spec.kind == "time"]


def _shifted(rows: Sequence[CoarseRows], delay_s: float, *, inputs: bool) -> list[CoarseRows]:
    """Return rows with the inputs delayed, or the response advanced, as if the motion recurred."""
    shifted: list[CoarseRows] = []
    for of_rate in rows:
        phase = np.exp(-2j * np.pi * delay_s * of_rate.frequency_hz)
        bins = of_rate.bins
        if inputs:
            bins = replace(bins, inputs=bins.inputs * phase[:, None])
        else:
            bins = replace(bins, response=bins.response * phase.conj())
        shifted.append(replace(of_rate, bins=bins))
    return shifted


def _local(
    band: Band, all_rows: Sequence[CoarseRows], coordinates: Coordinates, z: FloatArray
) -> Local:
    """Return the weighted sum of squares at the coarse bins, its gradient and matrix."""
    values = coordinates.values(z)
    slopes = coordinates.slopes(z)[:, None]
    delay_s = band.problem.frame.delay_s
    factor_values = {name: values[name] for name in band.model.factor_names}
    trained = replace(band.problem.trained, factor_values=factor_values)
    matrix = np.zeros((len(z), len(z)))
    gradient = np.zeros(len(z))
    cost = 0.0
    with np.errstate(all="ignore"):
        for coarse in all_rows:
            rows = _with_factors(band, coarse, values)
            step = Step(*trained.with_slopes(values, *rows.bins.step, delay_s))
            if not np.all(np.isfinite(step.transfer.denominator)):
                return Local(matrix, gradient, np.inf)
            evaluated = evaluate(rows.bins, step, rows.weight)
            root = np.sqrt(rows.weight)[:, None]
            derivatives = evaluated.jacobian
            if evaluated.edge_jacobian.size:
                derivatives = derivatives + evaluated.edge_jacobian
            jacobian = (derivatives * slopes * root).swapaxes(0, 1).reshape(len(z), -1)
            residual = (evaluated.residual[:, None] * root).reshape(1, -1)
            matrix += products(jacobian, jacobian)
            gradient += products(jacobian, residual)[:, 0]
            cost += float(products(residual, residual)[0, 0])
    return Local(matrix, gradient, cost)


def _with_factors(band: Band, rows: CoarseRows, values: Mapping[str, float]) -> CoarseRows:
    """Return rows with inputs filtered by the factors of ``values``, as if the motion recurred."""
    frame = band.problem.frame
    if not frame.factor_values:
        return rows
    unfiltered = rows.bins.inputs[:, : frame.terms]
    factors = _relative_factors(band, rows, values)
    inputs = np.concatenate([unfiltered * factor[:, None] for factor in factors], axis=1)
    return replace(rows, bins=replace(rows.bins, inputs=inputs))


def _relative_factors(
    band: Band, rows: CoarseRows, values: Mapping[str, float]
) -> list[ComplexArray]:
    """Return factors and their slopes over the factors of the inputs, shape (R, K) each."""
    frame = band.problem.frame
    inverse = 1.0 / frame.model.factors(frame.factor_values, rows.frequency_hz)
    slopes = frame.model.factor_slopes(values, rows.frequency_hz)
    factors = [frame.model.factors(values, rows.frequency_hz)]
    factors += [slopes[name] for name in frame.factor_values]
    return [inverse * factor for factor in factors]
