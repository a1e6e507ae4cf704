"""A tracker: what is known of a sensor after every block of samples, by recursive prediction errors (Gauss–Newton).

The network runs with its forward sensitivities at a point of linearisation (Ljung & Söderström 1983, ch. 3). A block of
rows, whitened by the autoregression of the residual, is one triangle, which is added to the square-root information.
The point is moved to the estimate where that is more than a standard uncertainty off, or by an alarm; states and
what is known move with it. As nothing is forgotten but by the stated random walk, the estimate is that of least
squares over all samples, and what the motion does not excite keeps its value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vibrident.data.records import FloatArray, Quantity
from vibrident.physics.models import ParameterSpec, SensorModel
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import (
    NORMAL,
    Change,
    Ladder,
    Thresholds,
    change,
    likelihood_ratio,
    named,
    variance_deviate,
)
from vibrident.use.tracking.network import TAPS, Linearised, Network

SECONDS_A_YEAR = 365.25 * 86400.0
#: Power of the response to the motion, in units of the noise's, from which a block counts: as the bins of a fit.
EXCITED = 10.0
#: Part of what a motion tells of a parameter that the others leave: one tone in a reference with noise of 1 % has less.
ALONE = 1e-3
#: Information that stands for none about a nuisance, in units of its first block's: a limit of the arithmetic.
NONE = 1e-8
#: Standard deviation that a changed parameter is given after an alarm, in units of its change.
RELEARN = 10.0
#: Blocks before a segment from which on its noise can be told to be another.
BEHIND = 8
#: Part of a block that sets the point of linearisation, where it is not settled.
FIRST = 8
#: Steps taken from the reference at once.
AT_ONCE = 16384


@dataclass(frozen=True)
class Settings:
    """How a sensor is tracked.

    Attributes:
        false_alarms_per_day: expected of noise alone, in a day of motion.
        drift_per_year: random walk of each parameter, relative, in one year: its u grows by it where nothing is seen.
        reference_uncertainty: relative standard uncertainty of the reference, systematic; part of the gain's u.
        block: steps in a block.
        order: of the autoregression of the residual.
        levels: lengths of segments that are tested for a change, 1, 2, 4, … blocks.
    """

    false_alarms_per_day: float = 0.01
    drift_per_year: float = 0.01
    reference_uncertainty: float = 0.0
    block: int = 1024
    order: int = 8
    levels: int = 16


@dataclass(frozen=True)
class Alarm:
    """A change.

    Attributes:
        time_s: estimated time of the change.
        detected_s: time of the sample at which it was certain.
        parameter: name of the parameter, or ``innovation``.
        before: value before, in the parameter's unit; of the innovation its rms, in that of the response.
        after: value after.
        u: standard uncertainty of the change.
        what: what changed, in words.
    """

    time_s: float
    detected_s: float
    parameter: str
    before: float
    after: float
    u: float
    what: str

    def document(self) -> dict[str, float | str]:
        """As in ``track.json``."""
        return {
            "time_s": self.time_s,
            "detected_s": self.detected_s,
            "parameter": self.parameter,
            "from": self.before,
            "to": self.after,
            "u": self.u,
            "what": self.what,
        }


@dataclass(eq=False)
class State:
    """All that a tracker carries from sample to sample; arrays of float64, in the order in which they are saved."""

    point: FloatArray  # unknowns at the point of linearisation, shape (m,); zero for the initial states
    known: FloatArray  # square-root information about the unknowns less the point, shape (m, m + 1)
    cell: FloatArray  # states and their sensitivities, shape (S,)
    rows: FloatArray  # the last rows before whitening, shape (order, m + 1)
    gram: FloatArray  # products of the whitened rows of the block under way, shape (m + 1, m + 1)
    own: FloatArray  # of that block: steps, rows, fourth powers; then its autocovariance, shape (3 + order + 1,)
    whitening: FloatArray  # autoregression of the residual, shape (order,)
    # of the whitened residual: squares, degrees of freedom, fourth powers, rows; squares² over degrees of freedom of
    # each block, blocks; shape (6,)
    noise: FloatArray
    lags: FloatArray  # number of residuals, blocks; their autocovariance, shape (2 + order + 1,)
    # time of the run's first sample, s; samples fed and steps taken in it; time of the last random walk, s; blocks
    # since the start or the last alarm; rows that whitening may look back to; whether the run's nuisances are all
    # unknown; samples of reference and response still to be left out; whether the point is settled; shape (10,)
    clock: FloatArray
    row: FloatArray  # products since the last row that was read, shape (m + 1, m + 1); its squares and rows behind
    # a change that is not named yet: whether there is one, its time and that of its detection, s; variance of the noise
    # before it, its degrees of freedom and spread; then what was known before it, shape (6 + m (m + 1),)
    pending: FloatArray
    ladder: Ladder
    # samples that wait for others
    reference: FloatArray = field(default_factory=lambda: np.zeros(0))
    response: FloatArray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def empty(cls, network: Network, settings: Settings) -> State:
        """Nothing known, at rest."""
        m, n, p = network.columns, network.order, network.parameters
        return cls(
            np.zeros(m),
            np.zeros((m, m + 1)),
            np.zeros(n * (1 + p + n)),
            np.zeros((settings.order, m + 1)),
            np.zeros((m + 1, m + 1)),
            np.zeros(4 + settings.order),
            np.zeros(settings.order),
            np.zeros(6),
            np.zeros(3 + settings.order),
            np.array([0.0, 0.0, 0.0, np.nan, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
            np.zeros((m + 1) ** 2 + 2),
            np.zeros(6 + m * (m + 1)),
            Ladder.empty(settings.levels, m),
        )


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known at a moment.

    Attributes:
        time_s: of the moment.
        values: name → value.
        uncertainty: name → standard uncertainty.
        covariance: of the values in the model's order, the reference's uncertainty included, shape (P, P).
        innovation: rms of the whitened residual since the last reading, response unit; NaN where nothing moved.
        excited: names of the parameters that the motion since then tells by itself, apart from the others and better
            than ± 100 %.
    """

    time_s: float
    values: Mapping[str, float]
    uncertainty: Mapping[str, float]
    covariance: FloatArray
    innovation: float
    excited: tuple[str, ...]


class Tracker:
    """Tracks one sensor; see the module.

    Args:
        model: its sensor model, linear and rational.
        values: name → start value, SI units, frequencies in Hz.
        covariance: of the values in the model's order, shape (P, P).
        sampling_rate_hz: samples per second.
        quantity: what the reference is.
        settings: how it is tracked.

    Raises:
        ModelError: the model has no state space.
    """

    def __init__(
        self,
        model: SensorModel,
        values: Mapping[str, float],
        covariance: FloatArray,
        sampling_rate_hz: float,
        quantity: Quantity = "acceleration",
        settings: Settings = Settings(),
    ) -> None:
        self.network = network = Network.of(model, values, quantity, 1.0 / sampling_rate_hz)
        self.settings = settings
        self.thresholds = Thresholds.of(
            settings.false_alarms_per_day, settings.block * network.interval_s, settings.levels, network.parameters
        )
        self.state = state = State.empty(network, settings)
        k = network.nuisances
        state.point[k:] = np.array([values[name] for name in model.parameter_names]) / network.scale
        state.known[k:, k:-1] = _square_root(covariance / np.outer(network.scale, network.scale))
        self.alarms: list[Alarm] = []
        self.begin(0.0)

    def begin(self, time_s: float) -> None:
        """A run of samples begins: its first is of this time; what came before it does not tell its state."""
        self.finish()
        s, first = self.state, self.network.first
        s.reference, s.response = np.zeros(0), np.zeros(0)
        s.clock[:3] = time_s, 0.0, max(0, -first)
        s.clock[7:9] = max(0, first), max(0, -first)
        if np.isnan(s.clock[3]):
            s.clock[3] = time_s
        self._free_run()

    def feed(self, reference: FloatArray, response: FloatArray) -> None:
        """Samples that follow those before; ones that are not numbers are a gap. Both of shape (samples,)."""
        good = np.isfinite(reference) & np.isfinite(response)
        if good.all():
            self._feed(reference, response)
            return
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
        start = self.next_sample_s
        for k, (first, last) in enumerate(edges.reshape(-1, 2)):
            if k or first:
                self.begin(start + first * self.network.interval_s)
            self._feed(reference[first:last], response[first:last])
        if not good[-1]:
            self.begin(start + len(good) * self.network.interval_s)

    def finish(self) -> None:
        """No sample follows: take the steps of the block under way."""
        if self.state.own[1] > 0.0:
            self._end_block()

    def read(self) -> Estimate:
        """What is known after the last whole block."""
        s, net = self.state, self.network
        names, k = net.model.parameter_names, net.nuisances
        move = information.solve(self._walked())[k:]
        values = net.bounded(s.point[k:] + move) * net.scale
        covariance = information.covariance(self._walked(), k) * np.outer(net.scale, net.scale)
        covariance[net.gain, net.gain] += (self.settings.reference_uncertainty * values[net.gain]) ** 2
        gram, squares, rows = s.row[:-2].reshape(s.gram.shape), s.row[-2], s.row[-1]
        seen = information.triangle(information.without_nuisances(gram, k))[k:-1, k:-1]
        excited: tuple[str, ...] = ()
        if (np.diag(seen) > 0.0).all():
            inverse = np.linalg.inv(seen)
            alone = 1.0 / np.sum(inverse**2, axis=1)
            told = (alone > ALONE * np.sum(seen**2, axis=0)) & (alone * (values / net.scale) ** 2 > 1.0)
            excited = tuple(name for name, one in zip(names, told, strict=True) if one)
        u = np.sqrt(np.diag(covariance))
        s.row[:] = 0.0
        return Estimate(
            self.time_s,
            dict(zip(names, values.tolist(), strict=True)),
            dict(zip(names, u.tolist(), strict=True)),
            covariance,
            float(np.sqrt(squares / rows)) if rows > 0.0 else float("nan"),
            excited,
        )

    @property
    def next_sample_s(self) -> float:
        """Time of the next sample of the run, s."""
        return float(self.state.clock[0] + self.state.clock[1] * self.network.interval_s)

    @property
    def time_s(self) -> float:
        """Time of the next step, s: samples before it are taken."""
        return float(self.state.clock[0] + self.state.clock[2] * self.network.interval_s)

    def _free_run(self) -> None:
        """State and offset of what follows are unknown."""
        s, net = self.state, self.network
        n, p = net.order, net.parameters
        s.cell[:] = 0.0
        s.cell[n * (1 + p) :] = np.eye(n).ravel()
        s.rows[:], s.own[:], s.gram[:] = 0.0, 0.0, 0.0
        s.point[: n + 1] = 0.0
        s.known[: n + 1] = 0.0
        s.ladder.drop(n + 1)
        self._before[: n + 1] = 0.0
        s.clock[5:7] = 0.0, 1.0

    def _feed(self, reference: FloatArray, response: FloatArray) -> None:
        s, net = self.state, self.network
        s.clock[1] += len(response)
        held = []
        for place, waiting, new in ((7, s.reference, reference), (8, s.response, response)):
            skipped = min(int(s.clock[place]), len(new))
            s.clock[place] -= skipped
            held.append(np.concatenate([waiting, new[skipped:]]))
        s.reference, s.response = held
        while (steps := min(len(s.response), len(s.reference) - TAPS + 1, AT_ONCE)) > 0:
            self._take(net.inputs(s.reference, steps), s.response[:steps])
            s.reference, s.response = s.reference[steps:], s.response[steps:]

    def _take(self, inputs: FloatArray, response: FloatArray) -> None:
        """Steps with their inputs, shape (steps, q), and responses, shape (steps,)."""
        s, done = self.state, 0
        while done < len(response):
            length = self.settings.block if s.clock[9] else self.settings.block // FIRST
            steps = min(length - int(s.own[0]), len(response) - done)
            part = slice(done, done + steps)
            self._accumulate(inputs[part], response[part])
            done += steps
            if s.own[0] >= length:
                self._end_block()

    def _accumulate(self, inputs: FloatArray, response: FloatArray) -> None:
        """Take steps into the block under way."""
        s, net = self.state, self.network
        out, s.cell, _ = self._linearised.run(s.cell, inputs)
        n, order, m = net.order, self.settings.order, net.columns
        rows = np.empty((order + len(response), m + 1))
        rows[:order] = s.rows
        new = rows[order:]
        new[:, :n], new[:, n], new[:, n + 1 : m] = out[:, 1 : n + 1], 1.0, out[:, n + 1 :]
        new[:, m] = response - out[:, 0] - s.point[n]
        white = new.copy()
        for lag in np.flatnonzero(s.whitening):
            white += s.whitening[lag] * rows[order - 1 - lag : -1 - lag]
        skipped = min(len(new), max(0, order - int(s.clock[5])))
        white, e = white[skipped:], rows[:, m]
        s.clock[5] = min(order, s.clock[5] + len(response))
        s.gram += white.T @ white
        s.own[:3] += (len(response), len(white), np.sum(white[:, m] ** 4))
        late = e[order + skipped :]
        for lag in range(order + 1):
            s.own[3 + lag] += late @ e[order + skipped - lag : len(e) - lag]
        s.rows = rows[len(response) :]
        s.clock[2] += len(response)

    @property
    def _linearised(self) -> Linearised:
        at = self.state.point[self.network.nuisances :]
        if self._cached is None or not np.array_equal(self._cached[0], at):
            self._cached = at.copy(), Linearised.at(self.network, at)
        return self._cached[1]

    _cached: tuple[FloatArray, Linearised] | None = None

    def _walked(self) -> FloatArray:
        """What is known now, the random walk since the last time included."""
        s, net = self.state, self.network
        k = net.nuisances
        rate = self.settings.drift_per_year**2 / SECONDS_A_YEAR
        size = np.where([spec.kind == "time" for spec in net.model.parameters], 1.0, s.point[k:])
        variance = rate * size**2 * max(0.0, self.time_s - s.clock[3])
        return information.walk(s.known, variance, k)

    def _end_block(self) -> None:
        """The block under way is whole: learn from it, test it, begin the next."""
        s, net = self.state, self.network
        m, k = net.columns, net.nuisances
        upper = information.triangle(s.gram)
        squares = float(upper[m, m] ** 2)
        freedom = float(s.own[1] - np.count_nonzero(np.diag(upper)[:m]))
        known_noise = s.noise[1] > 0.0
        variance = s.noise[0] / s.noise[1] if known_noise else squares / max(freedom, 1.0)
        gain = k + net.gain
        least = EXCITED * s.own[1] * variance / max(upper[gain, gain], 1e-300) ** 2  # of the gain's square
        if not (freedom > 0.0 and variance > 0.0 and max(1.0, s.point[gain] ** 2) > least):
            self._free_run()
            return
        if s.point[gain] ** 2 <= least:  # a dead channel: motion without a response tells the gain alone
            others = np.delete(np.arange(k, m), net.gain)
            s.gram[others], s.gram[:, others] = 0.0, 0.0
            upper = information.triangle(s.gram)
        if s.clock[6]:
            diagonal = np.arange(k)
            s.known[diagonal, diagonal] = np.sqrt(NONE * np.maximum(np.diag(s.gram)[:k], 1e-300) / variance)
            s.clock[6] = 0.0
        s.known, s.clock[3] = self._walked(), self.time_s
        learned = information.absorb(s.known, upper[:m] / np.sqrt(variance))
        if not s.clock[9] and self._unsettled(learned):
            s.own[:], s.gram[:] = 0.0, 0.0
            self._move(information.solve(learned))
            return
        before = (variance, float(s.noise[1]), self._spread()) if known_noise else (0.0, 0.0, 0.0)
        start = self.time_s - s.own[0] * net.interval_s
        gram = s.gram / variance
        if not s.pending[0]:
            s.ladder.add(s.known, gram, (squares, freedom, *before), start, int(s.clock[4]))
        s.known, s.clock[9] = learned, 1.0
        s.row[:-2] += gram.ravel()
        s.row[-2:] += (squares, freedom)
        s.noise += (squares, freedom, s.own[2], s.own[1], squares**2 / freedom, 1.0)
        s.clock[4] += 1.0
        lags = s.own[3:].copy(), s.own[1]
        s.own[:], s.gram[:] = 0.0, 0.0
        tested = self._name() if s.pending[0] else self._alarmed()
        if not tested and not self._moved():
            self._learn_whitening(*lags)

    def _unsettled(self, learned: FloatArray) -> bool:
        """Whether this block moves the point by more than two independent ones may: it then sets the point alone."""
        k = self.network.nuisances
        away = learned[k:, k:-1] @ information.solve(learned)[k:]
        return bool(away @ away > 2.0 * self.thresholds.further[-1])

    def _moved(self) -> bool:
        """Move the point of linearisation where the estimate is more than u off."""
        s, net = self.state, self.network
        k = net.nuisances
        move = information.solve(s.known)
        u = np.sqrt(np.diag(information.covariance(s.known, k)))
        if s.clock[4] > 1.0 and not np.any(np.abs(move[k:]) > u):
            return False
        self._move(move)
        return True

    def _move(self, move: FloatArray) -> None:
        s, net = self.state, self.network
        n, p, k = net.order, net.parameters, net.nuisances
        move[k:] = net.bounded(s.point[k:] + move[k:]) - s.point[k:]
        s.point[n:] += move[n:]
        free, slopes = s.cell[n * (1 + p) :].reshape(n, n), s.cell[n : n * (1 + p)].reshape(p, n)
        s.cell[:n] += move[:n] @ free + move[k:] @ slopes
        for known in (s.known, self._before):
            known[:, -1] -= known[:, :-1] @ move
        s.rows[:, -1] -= s.rows[:, :-1] @ move
        s.ladder.shift(move)
        side = s.gram.shape[0]
        s.row[:-2] = information.shifted(s.row[:-2].reshape(side, side), move).ravel()

    def _learn_whitening(self, lags: FloatArray, rows: float) -> None:
        """The autoregression of the residual anew, whenever the number of blocks has doubled."""
        s = self.state
        s.lags += np.concatenate([[rows, 1.0], lags])
        blocks = int(s.lags[1])
        if blocks & (blocks - 1):
            return
        r = s.lags[2:] / s.lags[0]
        a, left = np.zeros(0), r[0]
        for order in range(1, len(r)):
            reflection = -(r[order] + a @ r[order - 1 : 0 : -1]) / left
            a = np.concatenate([a + reflection * a[::-1], [reflection]])
            left *= 1.0 - reflection**2
        ratio = left / (s.noise[0] / s.noise[1])
        s.noise[0] *= ratio
        s.noise[[2, 4]] *= ratio**2
        s.whitening[:] = a

    def _alarmed(self) -> bool:
        """Test the segments that end here; where one is certain to be of another sensor, learn that anew."""
        s = self.state
        blocks = int(s.clock[4])
        for level in range(self.settings.levels):
            if blocks % (1 << level):
                break
            found, statistic, deviate = self._tested(level)
            certain = found.columns > 0 and statistic > self.thresholds.change[level, found.columns - 1]
            if certain or deviate > self.thresholds.noise[level]:
                self._relearn(certain=certain)
                return True
        return False

    def _tested(self, level: int) -> tuple[Change, float, float]:
        """Test of a change at the start of a segment, its statistic, and the deviate of the segment's noise.

        A segment that is noisier than the rest is tested against its own noise.
        """
        s = self.state
        _, squares, freedom, variance, behind, spread, _ = s.ladder.meta[level]
        found = change(s.ladder.known[level], s.ladder.gram[level], self.network.nuisances)
        own = max(1.0, squares / freedom / (s.noise[0] / s.noise[1]))
        statistic = likelihood_ratio(found.statistic / own, float(s.noise[1]))
        if behind < BEHIND * self.settings.block:
            return found, statistic, 0.0
        return found, statistic, _deviate(squares / freedom / variance, freedom, behind, spread)

    def _spread(self) -> float:
        """Variance of the squares of the noise, in units of its squared variance: by fourth powers, or from block to
        block where that is more."""
        squares, freedom, fourth, rows, blocks_squared, blocks = self.state.noise
        variance = squares / freedom
        between = (blocks_squared / freedom / variance**2 - 1.0) * freedom / blocks
        return float(max(NORMAL - 1.0, fourth / rows / variance**2 - 1.0, between))

    def _keep_others(self, before: FloatArray, after: FloatArray) -> None:
        """A response without motion tells the gain alone."""
        s, net = self.state, self.network
        k, amount = net.nuisances, np.zeros(net.parameters)
        amount[net.gain] = after[net.gain] - before[net.gain]
        s.known = information.walk(self._before, (RELEARN * amount) ** 2, k)
        self._move(np.concatenate([np.zeros(k), before + amount]))

    @property
    def _before(self) -> FloatArray:
        """What was known before a change that is not named yet, shape (m, m + 1)."""
        return self.state.pending[6:].reshape(self.state.known.shape)

    def _relearn(self, *, certain: bool) -> None:
        """Something changed: find when, and open what is known to what follows."""
        s, k = self.state, self.network.nuisances
        tests = {int(level): self._tested(int(level)) for level in np.flatnonzero(s.ladder.meta[:, 0] > 0.0)}
        level = max(tests, key=lambda each: tests[each][1 if certain else 2])
        found = tests[level][0]
        _, _, _, variance, behind, spread, start = s.ladder.meta[level]
        s.pending[:6] = 1.0, start, self.time_s, variance, behind, spread
        self._before[:] = s.ladder.known[level]
        s.known = information.walk(s.ladder.known[level], (RELEARN * found.amount) ** 2, k)
        s.noise[:], s.lags[:], s.ladder.meta[:] = 0.0, 0.0, 0.0
        s.clock[4] = s.clock[9] = 0.0
        self._move(np.concatenate([np.zeros(k), found.before + found.amount]))

    def _name(self) -> bool:
        """A whole block after a change: say what it was."""
        s, net = self.state, self.network
        k = net.nuisances
        before, after = (information.solve(known)[k:] for known in (self._before, s.known))
        spread = information.covariance(self._before, k) + information.covariance(s.known, k)
        _, start, detected, variance, behind, noise_spread = s.pending[:6].tolist()
        changed = named(before, after, spread, self.thresholds.further)
        for place, amount, u in changed:
            spec, scale = net.model.parameters[place], float(net.scale[place])
            value = float(s.point[k + place] + before[place]) * scale
            what = in_words(spec, value, value + amount * scale, u * scale)
            self.alarms.append(Alarm(start, detected, spec.name, value, value + amount * scale, u * scale, what))
            if what == DEAD:
                self._keep_others(before, after)
                break
        if behind > 0.0:
            freedom, ratio = float(s.noise[1]), float(s.noise[0] / s.noise[1]) / variance
            louder = _deviate(ratio, freedom, behind, noise_spread) > self.thresholds.noise[0]
            if louder or not changed:
                values = float(np.sqrt(variance)), float(np.sqrt(ratio * variance))
                u = float(np.sqrt(noise_spread / 4.0 * (values[0] ** 2 / behind + values[1] ** 2 / freedom)))
                what = LOUDER if louder else PASSED
                self.alarms.append(Alarm(start, detected, "innovation", *values, u, what))
        s.pending[0] = s.clock[4] = 0.0
        return False


DEAD = "dead channel"
LOUDER = "noise, or a part of the response that the model does not have: a second mode, a loose mounting"
PASSED = "a disturbance that has passed"


def in_words(spec: ParameterSpec, before: float, after: float, u: float) -> str:
    """What a change of this parameter is called; by it a gain of zero within 3 u is a dead channel."""
    if spec.kind == "gain":
        if abs(after) < 3.0 * u:
            return DEAD
        return "polarity" if abs(after + before) < 3.0 * u else "gain"
    return "clock, or delay of a channel" if spec.kind == "time" else spec.words or spec.name.replace("_", " ")


def _deviate(ratio: float, above: float, below: float, spread: float) -> float:
    return variance_deviate(ratio, 2.0 * above / spread, 2.0 * below / spread)


def _square_root(covariance: FloatArray) -> FloatArray:
    """Upper triangle R with (RᵀR)⁻¹ = ``covariance``, shape (P, P)."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    kept = np.maximum(values, np.finfo(float).eps * values[-1])
    found = np.linalg.qr((vectors / np.sqrt(kept)).T, mode="r")
    return found * np.where(np.diag(found) < 0.0, -1.0, 1.0)[:, None]


__all__ = ["Alarm", "Change", "Estimate", "Settings", "State", "Tracker"]
