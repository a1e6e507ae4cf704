"""A tracker: what is known of a sensor after every block of samples, by recursive prediction errors (Gauss–Newton).

The network runs with its forward sensitivities at a point of linearisation (Ljung & Söderström 1983, ch. 3). A block of
rows, whitened by the autoregression of the residual, is one triangle, which is added to the square-root information.
The point is moved to the estimate where that is more than a standard uncertainty off, or by an alarm; states and
what is known move with it. As nothing is forgotten but by the stated random walk, the estimate is that of least
squares over all samples, and what the motion does not excite keeps its value.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibrident.data.records import FloatArray, Quantity
from vibrident.data.records.basis import runs_of_true
from vibrident.physics.models import SensorModel
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import NORMAL, extend
from vibrident.use.tracking.knowledge import Knowledge
from vibrident.use.tracking.learner import FIRST, Learner
from vibrident.use.tracking.network import TAPS, Linearised, Network
from vibrident.use.tracking.state import Alarm, Estimate, Settings
from vibrident.use.tracking.tones import Tone

#: Part of what a motion tells of a parameter that the others leave: condition indices above 30 are harmful collinearity
#: (Belsley, Kuh & Welsch 1980, ch. 3).
ALONE = 1.0 / 30.0**2
#: Steps taken from the reference at once.
AT_ONCE = 16384
USUAL = Settings()


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
        settings: Settings = USUAL,
    ) -> None:
        self.network = network = Network.of(model, values, quantity, 1.0 / sampling_rate_hz)
        self.settings = settings
        self.knowledge = Knowledge(network, settings)
        self.state = state = self.knowledge.state
        self._learner = Learner(self.knowledge)
        k = network.nuisances
        state.point[k:] = np.array([values[name] for name in model.parameter_names]) / network.scale
        state.known[k:, k:-1] = _square_root(covariance / np.outer(network.scale, network.scale))
        self.begin(0.0)

    @property
    def alarms(self) -> list[Alarm]:
        """What changed so far, in the order in which it was certain."""
        return self._learner.changes.alarms

    def begin(self, time_s: float, tone_hz: float | None = None) -> None:
        """A run of samples begins: its first is of this time; what came before it does not tell its state.

        ``tone_hz``: its motion is a tone of this frequency, which counts as a whole when the run ends.
        """
        self.finish()
        s, first = self.state, self.network.first
        if (self._tone is None) != (tone_hz is None):  # the residual's unit is another
            s.noise[:], s.lags[:], s.whitening[:], s.ladder.meta[:], s.clock[4] = 0.0, 0.0, 0.0, 0.0, 0.0
        self._tone = None if tone_hz is None else Tone.of(tone_hz, self.network.interval_s)
        if np.isnan(s.clock[3]) or (s.clock[1] == 0.0 and s.clock[3] == s.clock[0]):  # nothing came so far
            s.clock[3] = time_s
        s.reference, s.response = np.zeros(0), np.zeros(0)
        s.clock[:3] = time_s, 0.0, max(0, -first)
        s.clock[10] = 0.0
        s.clock[7:9] = max(0, first), max(0, -first)
        self.knowledge.free_run()

    def feed(self, reference: FloatArray, response: FloatArray) -> None:
        """Samples that follow those before; ones that are not numbers are a gap. Both of shape (samples,)."""
        if self._tone is not None:
            self._feed_tone(self._tone, reference, response)
            return
        good, start = np.isfinite(reference) & np.isfinite(response), self.next_sample_s
        for first, last in zip(*runs_of_true(good), strict=True):
            if first:
                self.begin(start + first * self.network.interval_s)
            self._feed(reference[first:last], response[first:last])
        if not good[-1:].all():
            self.begin(start + len(good) * self.network.interval_s)

    def finish(self) -> None:
        """No sample follows: take the steps of the block under way."""
        if self._tone is not None:
            self._end_tone(self._tone)
        elif self.state.own[1] > 0.0:
            self._learner.end_block()
        self._learner.end_run()

    def read(self) -> Estimate:
        """What is known after the last whole block."""
        s, net = self.state, self.network
        k, values = net.nuisances, np.array(list(self.values.values()))
        covariance = information.covariance(self.knowledge.walked(), k) * np.outer(net.scale, net.scale)
        covariance[net.gain, net.gain] += (self.settings.reference_uncertainty * values[net.gain]) ** 2
        gram, squares, rows = s.row[:-2].reshape(s.part.shape[1:]), s.row[-2], s.row[-1]
        seen = information.triangle(information.without_nuisances(gram, k))[k:-1, k:-1]
        names, excited = net.model.parameter_names, tuple[str, ...]()
        if (np.diag(seen) > 0.0).all():
            inverse = np.linalg.inv(seen)
            alone = 1.0 / np.sum(inverse**2, axis=1)
            told = (alone > ALONE * np.sum(seen**2, axis=0)) & (alone * (values / net.scale) ** 2 > 1.0)
            excited = tuple(name for name, one in zip(names, told, strict=True) if one)
        u = np.sqrt(np.diag(covariance))
        s.row[:] = 0.0
        return Estimate(
            self.knowledge.time_s,
            self.values,
            dict(zip(names, u.tolist(), strict=True)),
            covariance,
            float(np.sqrt(squares / rows)) if rows > 0.0 else float("nan"),
            excited,
        )

    @property
    def values(self) -> dict[str, float]:
        """Name → value of each parameter now."""
        s, net = self.state, self.network
        now = net.moved(s.point[net.nuisances :], information.solve(s.known)[net.nuisances :]) * net.scale
        return dict(zip(net.model.parameter_names, now.tolist(), strict=True))

    @property
    def changing(self) -> tuple[float, float] | None:
        """Time of a change that is certain but not named yet, and of its detection, s."""
        return (float(self.state.pending[1]), float(self.state.pending[2])) if self.state.pending[0] else None

    @property
    def noise(self) -> float | None:
        """Standard deviation of the whitened residual, response unit; None where it is not known, or of tones."""
        squares, freedom = self.state.noise[:2].tolist()
        return (squares / freedom) ** 0.5 if freedom > 0.0 and self._tone is None else None

    @property
    def next_sample_s(self) -> float:
        """Time of the next sample of the run, s."""
        return float(self.state.clock[0] + self.state.clock[1] * self.network.interval_s)

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

    def _feed_tone(self, tone: Tone, reference: FloatArray, response: FloatArray) -> None:
        """Whole stretches of a tone."""
        s, interval = self.state, self.network.interval_s
        s.clock[1:3] += len(response)
        held = np.concatenate([s.reference, reference]), np.concatenate([s.response, response])
        whole = len(held[0]) // tone.length * tone.length
        for at in range(0, whole, tone.length):
            tone.take(held[0][at : at + tone.length], held[1][at : at + tone.length], interval)
        s.reference, s.response = held[0][whole:], held[1][whole:]

    def _end_tone(self, tone: Tone) -> None:
        """Learn from a tone: a block of two rows, and one that holds what is known of their variance."""
        s, k = self.state, self.network.nuisances
        rows, freedom = tone.rows(self.network, s.point[k:], self.settings.model_error)
        tone.amplitudes.clear()
        s.reference, s.response = np.zeros(0), np.zeros(0)
        if not freedom:
            return
        count = int(freedom) + k + len(rows)
        table = np.eye(k + 3, s.part.shape[1])  # the nuisances are zero
        table[k : k + 2, k:], table[-1] = rows, 0.0
        table[-1, -1] = np.sqrt(freedom)
        s.part[(count & -count).bit_length() - 1] = table.T @ table
        s.own[:4] = s.clock[2], count, NORMAL * count, count
        s.clock[9] = 1.0
        self._learner.end_block()
        s.row[-2:] = 0.0

    def _take(self, inputs: FloatArray, response: FloatArray) -> None:
        """Steps with their inputs, shape (steps, q), and responses, shape (steps,)."""
        s, done = self.state, 0
        while done < len(response):
            length = self.settings.block if s.clock[9] else self.settings.block // FIRST
            steps = min(length - int(s.own[0]), len(response) - done)
            part = slice(done, done + steps)
            done += self._accumulate(inputs[part], response[part])
            if s.own[0] >= length:
                self._learner.end_block()

    def _accumulate(self, inputs: FloatArray, response: FloatArray) -> int:
        """Take steps into the block under way, up to the first at which a change is certain; returns their number."""
        s, net = self.state, self.network
        out, cell = self._linearised.run(s.cell, inputs)
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
        count = int(s.own[1])
        seen = self._learner.changes.seen(count, white)
        if seen and seen[0] - count < len(white):
            self._accumulate(inputs[: skipped + seen[0] - count], response[: skipped + seen[0] - count])
            return skipped + seen[0] - count
        s.cell[:] = cell
        s.clock[5] = min(order, s.clock[5] + len(response))
        extend(s.part, count, white)
        s.own[:3] += (len(response), len(white), np.sum(white[:, m] ** 4))
        late = e[order + skipped :]
        for lag in range(order + 1):
            s.own[3 + lag] += late @ e[order + skipped - lag : len(e) - lag]
        s.rows[:] = rows[len(response) :]
        s.clock[2] += len(response)
        if seen:
            self._learner.changes.begin(1 << seen[1])
        return len(response)

    @property
    def _linearised(self) -> Linearised:
        at = self.state.point[self.network.nuisances :]
        if self._cached is None or not np.array_equal(self._cached[0], at):
            self._cached = at.copy(), Linearised.at(self.network, at)
        return self._cached[1]

    _tone: Tone | None = None
    _cached: tuple[FloatArray, Linearised] | None = None


def _square_root(covariance: FloatArray) -> FloatArray:
    """Upper triangle R with (RᵀR)⁻¹ = ``covariance``, shape (P, P)."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    kept = np.maximum(values, np.finfo(float).eps * values[-1])
    return information.reduced((vectors / np.sqrt(kept)).T)
