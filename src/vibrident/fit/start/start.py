"""Start values from the nonparametric response alone: no user ever gives one.

The best and most different places of a grid (:mod:`vibrident.fit.start.candidates`) descend on the
logarithm of the magnitude, which neither delay nor sign can spoil, side by side
(:mod:`vibrident.fit.start.search`), fewer of them further. The phases then determine sign and
delay, over hundreds of periods of the highest frequency, and the remaining candidates descend on
the residual that the estimators minimise. Nothing is compiled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.information import laplace_score
from vibrident.fit.optimise import NO_START
from vibrident.fit.problem import FrequencyProblem
from vibrident.fit.start.candidates import MIN_DEVIATION, candidates, likely, with_guesses
from vibrident.fit.start.rational import two_modes
from vibrident.fit.start.search import (
    MIN_POSITIVE,
    LogCoordinates,
    Population,
    TargetFRF,
    descend,
    differences,
    information_at,
    logarithms,
    magnitudes,
)
from vibrident.physics.models import SensorModel

#: Most points of the search …
MAX_POINTS = 200
#: … and of its last descent.
MAX_FINAL_POINTS = 800
#: Combinations of cores with add-ons that go on after some steps, of the most points …
SECOND_CANDIDATES = 12
#: … and to the end. Of fewer points more go on, as they cost no more.
LAST_CANDIDATES = 6
#: After the first descent a cost of use is no more than this many times as large as in the end.
MAX_FIRST_RATIO = 100.0
#: Steps of the first descent, of all combinations; of those between; and of the last.
FIRST_STEPS = 6
STEPS = 25
LAST_STEPS = 40
#: Candidates on their way that differ by less in every coordinate are one.
MIN_DISTANCE = 0.15
#: Optima that differ by less in every coordinate are one.
MIN_OPTIMUM_DISTANCE = 1e-3
#: A delay is searched over so many periods of the highest frequency either way …
PERIODS = 400
#: … at so many places in each.
PER_PERIOD = 8
#: Optima whose costs differ by less fit alike: then the shorter delay is taken.
MAX_COST_DIFFERENCE = 9.0


@dataclass(frozen=True)
class Start:
    """Start of an estimator, and the path to it from the grid.

    Attributes:
        values: parameters near the optimum, by name, in physical units.
        costs: cost at each iterate of the path.
        equations: number of residuals.
        path: parameters at each iterate.
        other_optima: other optima, by cost, with their costs.
    """

    values: dict[str, float]
    costs: tuple[float, ...]
    equations: int
    path: tuple[dict[str, float], ...]
    other_optima: tuple[tuple[dict[str, float], float], ...] = ()

    @property
    def chi2_reduced(self) -> float:
        """Return the cost at the end of the path over its degrees of freedom."""
        return self.costs[-1] / max(self.equations - len(self.values), 1)


def find_start(problem: FrequencyProblem, model: SensorModel, most: float = np.inf) -> Start:
    """Return the best fit of the nonparametric response from all candidates.

    Nonlinear parameters have no influence on the response to small signals, and start at zero. A
    start value stated in the problem is used unchanged.

    Args:
        problem: the nonparametric response.
        model: the sensor model.
        most: cost above which a fit is of no use; once it is clear that none is below, the search
            ends.

    Raises:
        NotConverged: no candidate leads to a finite fit, or to one of use.
    """
    sought = sought_response(problem)
    final = sought.few(MAX_FINAL_POINTS)
    chart = _chart(problem, model.linear, final)
    scale = problem.points / max(final.frequency_hz.size, 1)
    if problem.start is not None:
        u, sign = chart.place(dict(problem.start))
        stated = descend(chart, u[None], np.array([sign]), differences(final), 0)
        return Start(
            dict(problem.start),
            (scale * float(stated.cost[0]),),
            problem.equations,
            (dict(problem.start),),
        )
    front = _optima(problem, chart, sought, final, most / problem.points)
    rows = _finite(front, LAST_CANDIDATES, MIN_OPTIMUM_DISTANCE)
    if chart.model.shares:
        rows = _likeliest_first(rows, front, chart, final)
    single_frequency = np.ptp(final.frequency_hz) == 0.0
    longer_rad = 0.0 if single_frequency else np.pi
    first, *other_rows = _shortest_delay_first(rows, front, chart.model, longer_rad)

    def named(u: FloatArray, row: int) -> dict[str, float]:
        return dict.fromkeys(model.parameter_names, 0.0) | chart.named(
            u[None], front.sign[row : row + 1], 0
        )

    return Start(
        named(front.u[first], first),
        tuple((front.path[1][:, first] * scale).tolist()),
        problem.equations,
        tuple(named(u, first) for u in front.path[0][:, first]),
        tuple((named(front.u[row], row), scale * float(front.cost[row])) for row in other_rows),
    )


def _chart(problem: FrequencyProblem, model: SensorModel, points: TargetFRF) -> LogCoordinates:
    """Return the coordinates of the search at these points."""
    return LogCoordinates(
        model, problem.quantity, points.frequency_hz, 1.0 / (2.0 * np.pi * problem.band_hz[1])
    )


def _finite(front: Population, count: int, apart: float = 0.0) -> np.ndarray:
    """Return the best rows as of :meth:`Population.best`, at least one.

    Raises:
        NotConverged: no row has a finite cost.
    """
    rows = front.best(count, apart)
    if not rows.size:
        raise NotConverged(NO_START)
    return rows


def _shortest_delay_first(
    rows: np.ndarray, front: Population, model: SensorModel, longer: float
) -> list[int]:
    """Return the rows in order of cost; of those that fit as well as the best, a short delay first.

    At one frequency half a period more with the other sign fits exactly as well, so that only the
    shortest will do.

    Args:
        rows: in order of cost.
        front: the candidates.
        model: theirs.
        longer: by which a delay may exceed the shortest, in rad at the highest frequency.
    """
    if not model.has_delay:
        return rows.tolist()
    index = [spec.kind for spec in model.parameters].index("time")
    alike = [
        row for row in rows.tolist() if front.cost[row] <= front.cost[rows[0]] + MAX_COST_DIFFERENCE
    ]
    delays = np.abs(front.u[alike, index])  # rad at the highest frequency
    first = alike[int(np.argmax(delays <= np.min(delays) + longer))]
    return [first, *(row for row in rows.tolist() if row != first)]


def _likeliest_first(
    rows: np.ndarray, front: Population, chart: LogCoordinates, final: TargetFRF
) -> np.ndarray:
    """Return the rows by :func:`vibrident.fit.information.laplace_score`, the likeliest first."""
    u = front.u[rows]
    sign = front.sign[rows]
    information = information_at(chart, u, sign, differences(final))
    return rows[np.argsort(laplace_score(front.cost[rows], information), kind="stable")]


def sought_response(problem: FrequencyProblem) -> TargetFRF:
    """Return the response of a problem for the search; points without response are left out."""
    usable = np.abs(problem.response) > 0
    phase = np.asarray(problem.data[4]) if problem.polar else problem.relative_deviation
    tiny = np.finfo(float).tiny
    target = TargetFRF(
        np.asarray(problem.data[0]),
        problem.response,
        np.maximum(problem.relative_deviation, tiny),
        np.maximum(phase, tiny),
        problem.has_phase,
        problem.polar,
    )
    return target.at(np.flatnonzero(usable))


def _optima(
    problem: FrequencyProblem,
    chart: LogCoordinates,
    sought: TargetFRF,
    final: TargetFRF,
    most: float,
) -> Population:
    """Return where the candidates end, judged at the points ``final``.

    Args:
        problem: the nonparametric response.
        chart: coordinates at the points ``final``.
        sought: the response.
        final: points by which the end is judged.
        most: cost for each point, as of :func:`_aligned`.
    """
    points = sought.few(MAX_POINTS)
    near = chart.at(points)
    u = candidates(points, near, problem.band_hz)
    sign = np.ones(len(u))
    coarse = descend(near, u, sign, magnitudes(points, MIN_DEVIATION), FIRST_STEPS)
    _require_use(coarse, MAX_FIRST_RATIO * most * points.frequency_hz.size)
    rows = coarse.best(_affordable(SECOND_CANDIDATES, points), MIN_DISTANCE)
    fine = descend(near, coarse.u[rows], sign[rows], magnitudes(points, MIN_DEVIATION), STEPS)
    _require_use(fine, most * points.frequency_hz.size)
    # Where magnitudes carry little information, or a zero may lie on either side, they mislead: the
    # first candidates go on, too.
    rows = fine.best(_affordable(LAST_CANDIDATES, points), MIN_DISTANCE)
    selected = np.concatenate([fine.u[rows], u[:32]])
    return _aligned(selected, chart, points, final, problem.longest_delay_s, most)


def _affordable(count: int, points: TargetFRF) -> int:
    """Return how many candidates take as long at these points as ``count`` at the most points."""
    return count * max(MAX_POINTS // max(points.frequency_hz.size, 1), 1)


def _require_use(front: Population, most: float) -> None:
    """Refuse to go on where all costs are above ``most``.

    Later stages have no larger deviations, and so no smaller costs.

    Raises:
        NotConverged: no candidate is of use.
    """
    if not np.any(front.cost <= most):
        raise NotConverged(NO_START)


def extended(
    problem: FrequencyProblem, model: SensorModel, values: Mapping[str, float], most: float = np.inf
) -> Start:
    """Return the best fit of a response by a model that extends one whose values are known.

    The search begins at these values and at the guesses of the missing ones.

    Args:
        problem: the nonparametric response.
        model: the extended model.
        values: of the smaller model, by name.
        most: as of :func:`find_start`.

    Raises:
        NotConverged: no candidate leads to a finite fit, or to one of use.
    """
    sought = sought_response(problem)
    points = sought.few(MAX_POINTS)
    chart = _chart(problem, model, points)
    known = {name: values.get(name, 0.0) for name in model.parameter_names}
    # A logarithm does not return from zero: a parameter that ended there begins at each place of
    # its grid.
    ended = [
        {spec.name: value}
        for spec in model.parameters
        if spec.kind == "positive"
        and known[spec.name] < MIN_POSITIVE
        and isinstance(spec.grid, tuple)
        for value in spec.grid
    ]
    cores = np.array([chart.place(known | restart)[0] for restart in ended or [{}]])
    missing = [name for name in model.parameter_names if name not in values]
    combined = with_guesses(cores, model, problem.band_hz, missing)
    selected = likely(combined, len(cores), points, chart)
    front = _aligned(
        selected, chart, points, points, problem.longest_delay_s, most / problem.points, last=1
    )
    row = int(_finite(front, 1)[0])
    scale = problem.points / max(points.frequency_hz.size, 1)
    best = chart.named(front.u, front.sign, row)
    return Start(best, (scale * float(front.cost[row]),), problem.equations, (best,))


def _aligned(
    selected: FloatArray,
    chart: LogCoordinates,
    points: TargetFRF,
    final: TargetFRF,
    longest_delay_s: float,
    most: float,
    last: int | None = None,
) -> Population:
    """Return where candidates of the right magnitude end, with signs and delays that align phases.

    Args:
        selected: coordinates of the candidates, shape (C, P).
        chart: coordinates at the points ``final``.
        points: of the search.
        final: points by which the end is judged.
        longest_delay_s: that the data could show.
        most: cost for each point above which a fit is of no use.
        last: number of candidates of the last descent; None: as many as the points allow.
    """
    if not points.has_phase:
        return descend(chart, selected, np.ones(len(selected)), differences(final), LAST_STEPS)
    near = chart.at(points)
    turned, sign = _with_sign_and_delay(selected, near, points, longest_delay_s)
    begun = descend(near, turned, sign, logarithms(points, MIN_DEVIATION), FIRST_STEPS)
    rows = begun.best(_affordable(SECOND_CANDIDATES, points), MIN_DISTANCE)
    turned, sign = _with_two_modes(begun.u[rows], begun.sign[rows], near, points)
    aligned = descend(near, turned, sign, logarithms(points, MIN_DEVIATION), STEPS)
    _require_use(aligned, most * points.frequency_hz.size)
    rows = aligned.best(_affordable(LAST_CANDIDATES, points), MIN_DISTANCE)
    closer = descend(
        near, aligned.u[rows], aligned.sign[rows], logarithms(points, MIN_DEVIATION / 100.0), STEPS
    )
    _require_use(closer, most * points.frequency_hz.size)
    rows = np.argsort(closer.cost, kind="stable")[: last or len(rows)]
    return descend(chart, closer.u[rows], closer.sign[rows], differences(final), LAST_STEPS)


def _with_two_modes(
    u: FloatArray, sign: FloatArray, chart: LogCoordinates, sought: TargetFRF
) -> tuple[FloatArray, FloatArray]:
    """Return the candidates, with those of linear algebra for a model with a second mode.

    Linear algebra takes the delays of the first candidates.
    """
    if len(chart.model.oscillators) != 2 or not chart.model.shares:
        return u, sign
    additional = [
        chart.place(v)
        for row in range(min(3, len(u)))
        for v in two_modes(sought, chart.model, chart.quantity, chart.named(u, sign, row))
    ]
    places = [place for place, _ in additional]
    signs = [place_sign for _, place_sign in additional]
    return np.concatenate([u, *(p[None] for p in places)]), np.concatenate([sign, np.array(signs)])


def _with_sign_and_delay(
    u: FloatArray, chart: LogCoordinates, sought: TargetFRF, longest_delay_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the candidates with the signs, and the delays, that align their phases."""
    model = chart.model
    response = chart.response(u, np.ones(len(u)))
    weight = 1.0 / np.maximum(sought.deviation, MIN_DEVIATION) ** 2
    turn = sought.response / response
    turn = weight * turn / np.abs(turn)
    if not model.has_delay:
        return u, np.where(np.sum(turn, axis=1).real >= 0, 1.0, -1.0)
    index = [spec.kind for spec in model.parameters].index("time")
    highest = float(np.max(sought.frequency_hz))
    steps = int(min(PERIODS, longest_delay_s * highest) * PER_PERIOD)
    periods = np.arange(-steps, steps + 1) / PER_PERIOD
    turns = np.tile(
        np.exp(2j * np.pi / PER_PERIOD * sought.frequency_hz / highest), (len(periods), 1)
    )
    turns[0] = np.exp(2j * np.pi * periods[0] * sought.frequency_hz / highest)
    sums = np.real(np.cumprod(turns, axis=0) @ turn.T)  # (delays, C)
    # Of alignments that differ by less than 0.2 % for each doubling of the delay, the shorter is
    # likelier.
    preferred = np.abs(sums) * (1.0 - 2e-3 * np.log2(1.0 + np.abs(periods)))[:, None]
    places = []
    signs = []
    for row in range(len(u)):
        for delay in _peaks(preferred[:, row]):
            moved = u[row].copy()
            moved[index] += periods[delay] / highest / chart.time_unit_s
            places.append(moved)
            signs.append(1.0 if sums[delay, row] >= 0 else -1.0)
    return np.array(places), np.array(signs)


def _peaks(values: FloatArray) -> list[int]:
    """Return the indices of the three highest local maxima."""
    is_peak = (values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:])
    peaks = np.flatnonzero(is_peak) + 1
    if not peaks.size:
        return [int(np.argmax(values))]
    return peaks[np.argsort(-values[peaks], kind="stable")[:3]].tolist()
