"""Start values from everywhere: a grid at the exact bins.

Natural frequency and damping come from a grid, the gain (and the share of a second mode, which the
response is linear in, too) in closed form, the delay from the peak of a correlation. A model with
add-ons starts from the best values of the model without them. No nonparametric response is needed.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.bins.transfer import DiscreteTransfer
from vibrident.fit.group.group import in_parts
from vibrident.fit.group.network import Step, evaluate, products
from vibrident.fit.optimise import levenberg_marquardt
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.frequency_domain import Local
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of
from vibrident.fit.start.coarse import CoarseRows, coarse_rows
from vibrident.fit.start.delay import PER_PERIOD, beside_peak, preferred
from vibrident.fit.start.look import Look
from vibrident.physics.models import ParameterSpec, SensorModel

#: Natural frequencies of the grid, from a part of the lowest to a multiple of the highest.
FREQUENCIES = 32
BELOW = 1.0 / 3.0
ABOVE = 8.0
#: Values of a parameter that differ by less than these factors are one start.
APART_FREQUENCY = 1.8
APART = 2.5
#: Places of the smaller model from which add-ons are looked for: at least, and with all guesses.
PLACES = 3
MAX_PLACES = 500
#: Places with add-ons that go down at the coarse bins, and evaluations of each.
REFINED = 12
ROUGH = 0.5
MAX_EVALUATIONS = 15
#: Directions of which shares hold less than this part of the best add nothing.
SHOWN = 1e-10


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place to begin at.

    Attributes:
        cost: weighted sum of squares that it leaves at the coarse bins.
        values: the parameters by name.
    """

    cost: float
    values: dict[str, float]


def candidates(band: Band, look: Look, most: int) -> list[Candidate]:
    """Return the best and most different places of the grid, the best first.

    Raises:
        NotConverged: no place of the grid has a finite response.
    """
    model = band.model
    search = _Search(band, look.band_hz, tuple(coarse_rows(band, look)))
    core = [spec for spec in model.core.parameters if spec.grid]
    # A free decay tells no frequency from that of its image above half the sampling rate.
    rates = [group.grid.rate_hz for group in band.groups if not group.grid.driven]
    top_hz = min([ABOVE * look.band_hz[1], *(0.5 * rate for rate in rates)])
    places = _places(core, [_axis(spec, look.band_hz[0], top_hz) for spec in core])
    added = [
        spec
        for add_on in model.add_ons
        for spec in add_on.parameters
        if spec.guesses and spec.name not in model.shares
    ]
    guesses = _places(added, [_guesses(spec, look.band_hz) for spec in added])
    if any(spec.start is not None for spec in core):
        most_places = REFINED
    else:
        most_places = max(most, PLACES)
    front = search.best(places, max(most_places, MAX_PLACES // len(guesses) if added else 0))
    if added and front:
        known = [{spec.name: place.values[spec.name] for spec in core} for place in front]
        front = search.best([here | more for here in known for more in guesses], REFINED)
    if front and (added or any(spec.start is not None for spec in core)):
        front = search.refined(front)
    if not front:
        raise NotConverged("No start value gives a finite fit: are the columns and units right?")
    return front[:most]


def _places(
    specs: Sequence[ParameterSpec], axes: Sequence[Sequence[float]]
) -> list[dict[str, float]]:
    """Return every combination of values of parameters, by name."""
    names = [spec.name for spec in specs]
    return [dict(zip(names, values, strict=True)) for values in itertools.product(*axes)]


def _axis(spec: ParameterSpec, low_hz: float, top_hz: float) -> list[float]:
    if spec.grid == "band":
        return np.geomspace(BELOW * low_hz, top_hz, FREQUENCIES).tolist()
    return list(spec.grid)


def _guesses(spec: ParameterSpec, band_hz: tuple[float, float]) -> list[float]:
    low, high = band_hz
    guesses = np.array(spec.guesses)
    if spec.kind in ("log", "duration") and spec.guess_at != "band":
        span = guesses[-1] / guesses[0]
        guesses = np.geomspace(guesses[0], guesses[-1], 1 + int(np.ceil(np.log2(span))))
    if spec.guess_at == "band":
        return (low * (high / low) ** guesses).tolist()
    unit = {"lowest": low, "highest": high, "period": 1.0 / high, "one": 1.0}[spec.guess_at]
    return (guesses * unit).tolist()


def _neutral(model: SensorModel, band_hz: tuple[float, float]) -> dict[str, float]:
    """Return values at which add-ons do nothing that shows, and the gain is one."""
    low, high = band_hz
    at = {"lowest": 1e-3 * low, "highest": 1e3 * high, "period": 1e-3 / high, "band": 3.0 * high}
    values = {}
    for spec in model.parameters:
        nothing = (
            at.get(spec.guess_at, 0.1) if spec.kind in ("log", "duration", "positive") else 0.0
        )
        values[spec.name] = 1.0 if spec.kind == "gain" else nothing
    return values


class _Scores(NamedTuple):
    """How well places of a grid suit.

    Attributes:
        cost: weighted sum of squares that each leaves, infinite where it has none, shape (G,).
        amounts: the best gain, and what each share adds, shape (G, T).
        late_s: the best delay, s, shape (G,).
    """

    cost: FloatArray
    amounts: FloatArray
    late_s: FloatArray


@dataclass(frozen=True, eq=False)
class _Search:
    """Compares places of a grid.

    Attributes:
        band: the network.
        band_hz: of the motion.
        rows: the coarse bins.
    """

    band: Band
    band_hz: tuple[float, float]
    rows: tuple[CoarseRows, ...]

    def best(self, places: Sequence[Mapping[str, float]], most: int) -> list[Candidate]:
        """Return the best and most different of places, the best first."""
        neutral = _neutral(self.band.model, self.band_hz)
        tried = [neutral | dict(place) for place in places]
        networks = [self._networks(tried, rows.bins.step) for rows in self.rows]
        bins = sum(rows.weight.size for rows in self.rows)
        parts: list[_Scores] = []
        for some in in_parts(len(tried), bins):
            here = [DiscreteTransfer(*(part[some] for part in network)) for network in networks]
            parts.append(self._scored(here, tried[some]))
        scores = _Scores(*(np.concatenate(each) for each in zip(*parts, strict=True)))
        chosen: list[Candidate] = []
        for number in np.argsort(scores.cost, kind="stable").tolist():
            if len(chosen) == most or not np.isfinite(scores.cost[number]):
                break
            values = self._values(
                tried[number], scores.amounts[number], float(scores.late_s[number])
            )
            if all(self._differ(values, other.values, places[0]) for other in chosen):
                chosen.append(Candidate(float(scores.cost[number]), values))
        return chosen

    def _values(
        self, place: Mapping[str, float], amounts: FloatArray, late_s: float
    ) -> dict[str, float]:
        """Return the parameters of a place by name, with its gain, shares and delay."""
        model = self.band.model
        gain, *others = amounts.tolist()
        times = [spec.name for spec in model.parameters if spec.kind == "time"]
        shares = {name: amount / gain for name, amount in zip(model.shares, others, strict=True)}
        return {**place, model.gain_name: gain, **shares, **dict.fromkeys(times, late_s)}

    def refined(self, front: Sequence[Candidate]) -> list[Candidate]:
        """Return where places lead at the coarse bins, the best first."""
        ends = [self._refined(candidate) for candidate in front]
        return sorted(ends, key=lambda each: each.cost)

    def _refined(self, candidate: Candidate) -> Candidate:
        """Return where a place leads at the coarse bins, with the response turned by its delay."""
        model = self.band.model
        delay_s = float(self.band.problem.frame.delay_s)
        times = [spec.name for spec in model.parameters if spec.kind == "time"]
        late = sum(candidate.values[name] for name in times) - (delay_s if times else 0.0)
        begin = candidate.values | dict.fromkeys(times, delay_s)
        coordinates = Coordinates.at(model, begin, self.band_hz)
        turned = [
            replace(
                rows,
                bins=replace(
                    rows.bins,
                    response=rows.bins.response * np.exp(2j * np.pi * late * rows.frequency_hz),
                ),
            )
            for rows in self.rows
        ]

        def objective(z: FloatArray, _: None) -> Local:
            return self._local(turned, coordinates, z)

        try:
            trace = levenberg_marquardt(
                objective, coordinates.first, None, tolerance=ROUGH, max_evaluations=MAX_EVALUATIONS
            )
        except (NotConverged, np.linalg.LinAlgError):
            return candidate
        values = coordinates.values(trace.last)
        return Candidate(trace.costs[-1], values | {name: values[name] + late for name in times})

    def _local(self, every: Sequence[CoarseRows], coordinates: Coordinates, z: FloatArray) -> Local:
        """Return the weighted sum of squares at the coarse bins, its gradient and matrix."""
        values = coordinates.values(z)
        slopes = coordinates.slopes(z)[:, None]
        delay_s = self.band.problem.frame.delay_s
        model = self.band.model
        trained = self.band.problem.trained
        trained = replace(
            trained, factor_values={name: values[name] for name in model.factor_names}
        )
        matrix = np.zeros((len(z), len(z)))
        gradient = np.zeros(len(z))
        cost = 0.0
        with np.errstate(all="ignore"):
            for coarse in every:
                rows = self._behind(coarse, values)
                at = values, *rows.bins.step, delay_s
                step = Step(*trained.with_slopes(*at))
                if not np.all(np.isfinite(step.transfer.denominator)):
                    return Local(matrix, gradient, np.inf)
                found = evaluate(rows.bins, step, rows.weight)
                root = np.sqrt(rows.weight)[:, None]
                jacobian = (found.jacobian * slopes * root).swapaxes(0, 1).reshape(len(z), -1)
                residual = (found.residual[:, None] * root).reshape(1, -1)
                matrix += products(jacobian, jacobian)
                gradient += products(jacobian, residual)[:, 0]
                cost += float(products(residual, residual)[0, 0])
        return Local(matrix, gradient, cost)

    def _networks(
        self, places: Sequence[dict[str, float]], step: tuple[float, float]
    ) -> DiscreteTransfer:
        """Return the networks of G places: without what T − 1 shares multiply, and with each of it.

        Returns:
            In leading axes (G, T).
        """
        model = self.band.model
        problem = self.band.problem
        trials = [
            trial
            for values in places
            for trial in (values, *({**values, name: 1.0} for name in model.shares))
        ]
        names = list(trials[0])
        late = {
            spec.name: problem.frame.delay_s for spec in model.parameters if spec.kind == "time"
        }
        late |= problem.frame.factor_values
        trained = problem.trained
        if trained.method.takes_many:
            many: dict[str, Any] = {
                name: np.array([trial[name] for trial in trials]) for name in names
            }
            both = trained.transfer(many | late, *step, problem.frame.delay_s)
        else:
            steps = [
                trained.transfer(trial | late, *step, problem.frame.delay_s) for trial in trials
            ]
            both = DiscreteTransfer(*(np.stack(parts) for parts in zip(*steps, strict=True)))
        shape = len(places), 1 + len(model.shares)
        return DiscreteTransfer(*(part.reshape(*shape, *part.shape[1:]) for part in both))

    def _factors(
        self,
        rows: CoarseRows,
        tried: Sequence[Mapping[str, float]],
    ) -> ComplexArray | None:
        """Return the factors of each place over those of the inputs, shape (R, G, K).

        None of a rational model.
        """
        if not self.band.problem.frame.factor_values:
            return None
        model = self.band.problem.frame.model
        over = 1.0 / model.factors(self.band.problem.frame.factor_values, rows.frequency_hz)
        return np.stack(
            [over * model.factors(values, rows.frequency_hz) for values in tried], axis=1
        )

    def _moved_factors(self, rows: CoarseRows, values: Mapping[str, float]) -> list[ComplexArray]:
        """Return factors and their slopes over the factors of the inputs, shape (R, K) each."""
        frame = self.band.problem.frame
        over = 1.0 / frame.model.factors(frame.factor_values, rows.frequency_hz)
        slopes = frame.model.factor_slopes(values, rows.frequency_hz)
        factors = [frame.model.factors(values, rows.frequency_hz)]
        factors += [slopes[name] for name in frame.factor_values]
        return [over * factor for factor in factors]

    def _behind(self, rows: CoarseRows, values: Mapping[str, float]) -> CoarseRows:
        """Return rows with inputs behind the factors of ``values``, as if the motion recurred."""
        frame = self.band.problem.frame
        if not frame.factor_values:
            return rows
        plain = rows.bins.inputs[:, : frame.terms]
        factors = self._moved_factors(rows, values)
        inputs = np.concatenate([plain * factor[:, None] for factor in factors], axis=1)
        return replace(rows, bins=replace(rows.bins, inputs=inputs))

    def _differ(
        self, values: Mapping[str, float], others: Mapping[str, float], names: Mapping[str, float]
    ) -> bool:
        specs = {spec.name: spec for spec in self.band.model.parameters}
        for name in names:
            factor = APART_FREQUENCY if specs[name].kind == "log" else APART
            ratio = (values[name] + 1e-300) / (others[name] + 1e-300)
            if not 1.0 / factor < ratio < factor:
                return True
        return False

    def _scored(
        self,
        networks: Sequence[DiscreteTransfer],
        tried: Sequence[Mapping[str, float]],
    ) -> _Scores:
        """Return how well some places suit, with the best gain, shares and delay.

        Args:
            networks: of these places at each sampling rate, as of :meth:`_networks`.
            tried: the values of each place.
        """
        stay = [self._stay_finite(*pair) for pair in zip(self.rows, networks, strict=True)]
        usable = np.flatnonzero(np.all(stay, axis=0))
        places, trials = networks[0].denominator.shape[:2]
        scores = _Scores(np.full(places, np.inf), np.zeros((places, trials)), np.zeros(places))
        if not usable.size:
            return scores
        freed = [
            rows.freed(
                DiscreteTransfer(*(part[usable] for part in network)),
                self._factors(rows, [tried[place] for place in usable.tolist()]),
            )
            for rows, network in zip(self.rows, networks, strict=True)
        ]
        if self.band.model.has_delay:
            scores.late_s[usable] = late = self._late(freed)
            for rows, each in zip(self.rows, freed, strict=True):
                each[:, :, -1] *= np.exp(2j * np.pi * late[:, None] * rows.frequency_hz[:, None])
        normal = np.zeros((len(usable), trials + 1, trials + 1))
        for each in freed:
            each[:, :, 1:-1] -= each[:, :, :1]
            normal += np.sum(products(each, each), axis=0)
        scale = np.sqrt(np.diagonal(normal, axis1=1, axis2=2)[:, :-1])
        finite = np.all(np.isfinite(normal), axis=(1, 2)) & np.all(scale > 0.0, axis=1)
        usable, normal, scale = usable[finite], normal[finite], scale[finite]
        right = normal[:, :-1, -1] / scale
        gram = normal[:, :-1, :-1] / scale[:, :, None] / scale[:, None]
        amounts = (np.linalg.pinv(gram, rcond=SHOWN, hermitian=True) @ right[:, :, None])[:, :, 0]
        cost = normal[:, -1, -1] - np.sum(amounts * right, axis=1)
        scores.cost[usable] = np.where(amounts[:, 0] != 0.0, cost, np.inf)
        scores.amounts[usable] = amounts / scale
        scores.late_s[:] += float(self.band.problem.frame.delay_s)
        return scores

    def _stay_finite(self, rows: CoarseRows, networks: DiscreteTransfer) -> BoolArray:
        """Return which places have networks whose states stay finite, shape (G,)."""
        usable = np.all(np.isfinite(networks.denominator), axis=(1, 2))
        if not self.band.problem.frame.method.is_exact:
            for place in np.flatnonzero(usable).tolist():
                each = networks.denominator[place]
                usable[place] = all(
                    self.band.is_stable(denominator, rows.bins.step) for denominator in each
                )
        return usable

    def _late(self, freed: Sequence[ComplexArray]) -> FloatArray:
        """Return the delay of each place at which the response agrees best with the first forced one, s, (G,)."""
        low, high = self.band_hz
        reach = max(2.0 / max(high - low, 1e-3 * high), 4.0 * self.rows[0].bins.step[0])
        count = int(np.ceil(reach * high * PER_PERIOD))
        late = np.arange(-count, count + 1) / (PER_PERIOD * high)
        sums = np.zeros((freed[0].shape[1], late.size))
        for rows, each in zip(self.rows, freed, strict=True):
            common = np.swapaxes(each[:, :, 0].conj() * each[:, :, -1], 0, 1).reshape(len(sums), -1)
            shown = np.flatnonzero(np.any(power_of(common) > 0.0, axis=0))
            hz = rows.frequency_hz.reshape(-1)[shown]
            for some in in_parts(late.size, hz.size):
                turns = np.exp(2j * np.pi * np.outer(late[some], hz))
                sums[:, some] += (common[:, shown] @ turns.T).real
        agreement = np.abs(sums)
        whole = late + self.band.problem.frame.delay_s
        best = np.argmax(preferred(agreement, whole * high), axis=1)
        beside = [
            beside_peak(row, place) for row, place in zip(agreement, best.tolist(), strict=True)
        ]
        return np.asarray(late[best] + np.array(beside) * (late[1] - late[0]))
