"""Tracker of a sensor: recursive prediction errors (Gauss–Newton), block by block.

The network runs with its forward sensitivities at a point of linearisation (Ljung & Söderström
1983, ch. 3). A block of rows, whitened by the autoregression of the residual, is one triangle,
which is added to the square-root information. The point is moved to the estimate where that is more
than a standard uncertainty off, or by an alarm; states and what is known move with it. As nothing
is forgotten but by the stated random walk, the estimate is that of least squares over all samples,
and parameters that the motion does not excite keep their values.
"""

from __future__ import annotations

import numpy as np

from vibrident.base.fields import NamedNumbers
from vibrident.data.records import FloatArray, Quantity
from vibrident.data.records.basis import runs_of_true
from vibrident.physics.models import SensorModel
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import NORMAL_KURTOSIS, extend_segments
from vibrident.use.tracking.knowledge import Knowledge
from vibrident.use.tracking.learner import PARTS_OF_FIRST_BLOCK, Learner
from vibrident.use.tracking.network import LinearisedCell, SensorNetwork
from vibrident.use.tracking.state import Alarm, ClockItem, State, TrackedEstimate, TrackerSettings
from vibrident.use.tracking.tones import Tone

#: Part of the information about a parameter that the other parameters must leave: condition indices
#: above 30 are harmful collinearity (Belsley, Kuh & Welsch 1980, ch. 3).
MIN_SEPARATE_INFORMATION = 1.0 / 30.0**2
#: Steps whose inputs are computed at once.
MAX_STEPS_AT_ONCE = 16384
DEFAULT_SETTINGS = TrackerSettings()


class Tracker:
    """Track one sensor, as the module describes.

    Args:
        model: its sensor model, linear and rational.
        values: name → start value, SI units, frequencies in Hz.
        covariance: of the values in the model's order, shape (P, P).
        sampling_rate_hz: samples per second.
        quantity: of the reference.
        settings: of the tracking.

    Raises:
        ModelError: the model has no state space.
    """

    def __init__(
        self,
        model: SensorModel,
        values: NamedNumbers,
        covariance: FloatArray,
        sampling_rate_hz: float,
        quantity: Quantity = "acceleration",
        settings: TrackerSettings = DEFAULT_SETTINGS,
    ) -> None:
        network = SensorNetwork.from_start_values(model, values, quantity, 1.0 / sampling_rate_hz)
        self.network: SensorNetwork = network
        self.settings: TrackerSettings = settings
        self.knowledge: Knowledge = Knowledge(network, settings)
        state = self.knowledge.state
        self.state: State = state
        self._learner = Learner(self.knowledge)
        k = network.nuisances
        state.point[k:] = np.array([values[name] for name in model.parameter_names]) / network.scale
        state.root[k:, k:-1] = _square_root(covariance / np.outer(network.scale, network.scale))
        self.begin(0.0)

    @property
    def alarms(self) -> list[Alarm]:
        """Return the changes so far, in the order in which they became certain."""
        return self._learner.changes.alarms

    def begin(self, time_s: float, tone_hz: float | None = None) -> None:
        """Begin a run of samples, whose states are unknown.

        Args:
            time_s: time of its first sample, s.
            tone_hz: frequency of the tone that the motion is, which counts as a whole when the run
                ends.
        """
        self.finish()
        s = self.state
        first = self.network.first
        if (self._tone is None) != (tone_hz is None):  # the residual's unit changes
            s.noise[:] = 0.0
            s.lags[:] = 0.0
            s.whitening[:] = 0.0
            s.ladder.meta[:] = 0.0
            s.clock[ClockItem.BLOCKS] = 0.0
        self._tone = (
            None if tone_hz is None else Tone.from_frequency(tone_hz, self.network.interval_s)
        )
        without_samples = (
            s.clock[ClockItem.SAMPLES_FED] == 0.0
            and s.clock[ClockItem.LAST_WALK_S] == s.clock[ClockItem.RUN_START_S]
        )
        if np.isnan(s.clock[ClockItem.LAST_WALK_S]) or without_samples:
            s.clock[ClockItem.LAST_WALK_S] = time_s
        s.reference = np.zeros(0)
        s.response = np.zeros(0)
        s.clock[ClockItem.RUN_START_S] = time_s
        s.clock[ClockItem.SAMPLES_FED] = 0.0
        s.clock[ClockItem.STEPS_TAKEN] = max(0, -first)
        s.clock[ClockItem.PARTS_AT_POINT] = 0.0
        s.clock[ClockItem.REFERENCE_TO_SKIP] = max(0, first)
        s.clock[ClockItem.RESPONSE_TO_SKIP] = max(0, -first)
        self.knowledge.free_run()

    def feed(self, reference: FloatArray, response: FloatArray) -> None:
        """Take the next samples, both of shape (samples,); those that are not numbers are a gap."""
        if self._tone is not None:
            self._feed_tone(self._tone, reference, response)
            return
        good = np.isfinite(reference) & np.isfinite(response)
        start = self.next_sample_s
        for first, last in zip(*runs_of_true(good), strict=True):
            if first:
                self.begin(start + first * self.network.interval_s)
            self._feed(reference[first:last], response[first:last])
        if not good[-1:].all():
            self.begin(start + len(good) * self.network.interval_s)

    def finish(self) -> None:
        """End the run: take the steps of the block under way."""
        if self._tone is not None:
            self._end_tone(self._tone)
        elif self.state.block[1] > 0.0:
            self._learner.end_block()
        self._learner.end_run()

    def read(self) -> TrackedEstimate:
        """Return the estimate after the last whole block."""
        s = self.state
        net = self.network
        k = net.nuisances
        values = np.array(list(self.values.values()))
        covariance = information.covariance(self.knowledge.walked(), k) * np.outer(
            net.scale, net.scale
        )
        covariance[net.gain, net.gain] += (
            self.settings.reference_uncertainty * values[net.gain]
        ) ** 2
        gram = s.row[:-2].reshape(s.products.shape[1:])
        squares = s.row[-2]
        rows = s.row[-1]
        root = information.triangle(information.without_nuisances(gram, k))[k:-1, k:-1]
        names = net.model.parameter_names
        excited = tuple[str, ...]()
        if (np.diag(root) > 0.0).all():
            inverse = np.linalg.inv(root)
            alone = 1.0 / np.sum(inverse**2, axis=1)
            separate = (alone > MIN_SEPARATE_INFORMATION * np.sum(root**2, axis=0)) & (
                alone * (values / net.scale) ** 2 > 1.0
            )
            excited = tuple(np.array(names)[separate].tolist())
        u = np.sqrt(np.diag(covariance))
        s.row[:] = 0.0
        return TrackedEstimate(
            self.knowledge.time_s,
            self.values,
            dict(zip(names, u.tolist(), strict=True)),
            covariance,
            float(np.sqrt(squares / rows)) if rows > 0.0 else float("nan"),
            excited,
        )

    @property
    def values(self) -> dict[str, float]:
        """Return name → value of each parameter now."""
        s = self.state
        net = self.network
        now = (
            net.moved(s.point[net.nuisances :], information.solve(s.root)[net.nuisances :])
            * net.scale
        )
        return dict(zip(net.model.parameter_names, now.tolist(), strict=True))

    @property
    def changing(self) -> tuple[float, float] | None:
        """Return time and detection of a change that is certain but not named yet, s."""
        stage, start, detected = self.state.pending[:3].tolist()
        return (start, detected) if stage else None

    @property
    def noise(self) -> float | None:
        """Return the standard deviation of the whitened residual, response unit.

        It is None where it is not known, and for tones.
        """
        squares, freedom = self.state.noise[:2].tolist()
        return (squares / freedom) ** 0.5 if freedom > 0.0 and self._tone is None else None

    @property
    def next_sample_s(self) -> float:
        """Return the time of the next sample of the run, s."""
        return float(
            self.state.clock[ClockItem.RUN_START_S]
            + self.state.clock[ClockItem.SAMPLES_FED] * self.network.interval_s
        )

    def _feed(self, reference: FloatArray, response: FloatArray) -> None:
        s = self.state
        net = self.network
        s.clock[ClockItem.SAMPLES_FED] += len(response)
        queues = []
        for index, waiting, new in (
            (ClockItem.REFERENCE_TO_SKIP, s.reference, reference),
            (ClockItem.RESPONSE_TO_SKIP, s.response, response),
        ):
            skipped = min(int(s.clock[index]), len(new))
            s.clock[index] -= skipped
            queues.append(np.concatenate([waiting, new[skipped:]]))
        s.reference, s.response = queues
        while (
            steps := min(len(s.response), len(s.reference) - net.taps + 1, MAX_STEPS_AT_ONCE)
        ) > 0:
            self._take(net.inputs(s.reference, steps), s.response[:steps])
            s.reference = s.reference[steps:]
            s.response = s.response[steps:]

    def _feed_tone(self, tone: Tone, reference: FloatArray, response: FloatArray) -> None:
        """Take the whole stretches of a tone."""
        s = self.state
        interval = self.network.interval_s
        s.clock[ClockItem.SAMPLES_FED] += len(response)
        s.clock[ClockItem.STEPS_TAKEN] += len(response)
        reference = np.concatenate([s.reference, reference])
        response = np.concatenate([s.response, response])
        end = len(reference) // tone.length * tone.length
        for at in range(0, end, tone.length):
            stretch = slice(at, at + tone.length)
            tone.take(reference[stretch], response[stretch], interval)
        s.reference = reference[end:]
        s.response = response[end:]

    def _end_tone(self, tone: Tone) -> None:
        """Learn from a tone: a block of two rows, and one that holds their variance."""
        s = self.state
        k = self.network.nuisances
        rows, freedom = tone.rows(self.network, s.point[k:], self.settings.model_error)
        tone.amplitudes.clear()
        s.reference = np.zeros(0)
        s.response = np.zeros(0)
        if not freedom:
            return
        count = int(freedom) + k + len(rows)
        table = np.eye(k + 3, s.products.shape[1])  # the nuisances are zero
        table[k : k + 2, k:] = rows
        table[-1] = 0.0
        table[-1, -1] = np.sqrt(freedom)
        s.products[(count & -count).bit_length() - 1] = table.T @ table
        s.block[:4] = s.clock[ClockItem.STEPS_TAKEN], count, NORMAL_KURTOSIS * count, count
        s.clock[ClockItem.POINT_IS_SETTLED] = 1.0
        self._learner.end_block()
        s.row[-2:] = 0.0

    def _take(self, inputs: FloatArray, response: FloatArray) -> None:
        """Take steps with their inputs, shape (steps, q), and responses, shape (steps,)."""
        s = self.state
        done = 0
        while done < len(response):
            length = (
                self.settings.block
                if s.clock[ClockItem.POINT_IS_SETTLED]
                else self.settings.block // PARTS_OF_FIRST_BLOCK
            )
            steps = min(length - int(s.block[0]), len(response) - done)
            span = slice(done, done + steps)
            done += self._accumulate(inputs[span], response[span])
            if s.block[0] >= length:
                self._learner.end_block()

    def _accumulate(self, inputs: FloatArray, response: FloatArray) -> int:
        """Take steps into the block under way, up to the first at which a change is certain.

        Returns the number of steps taken.
        """
        s = self.state
        net = self.network
        out, cell = self._linearised.run(s.cell, inputs)
        n = net.order
        order = self.settings.order
        m = net.columns
        rows = np.empty((order + len(response), m + 1))
        rows[:order] = s.rows
        new = rows[order:]
        new[:, :n] = out[:, 1 : n + 1]
        new[:, n] = 1.0
        new[:, n + 1 : m] = out[:, n + 1 :]
        new[:, m] = response - out[:, 0] - s.point[n]
        white = new.copy()
        for lag in np.flatnonzero(s.whitening):
            white += s.whitening[lag] * rows[order - 1 - lag : -1 - lag]
        skipped = min(len(new), max(0, order - int(s.clock[ClockItem.ROWS_TO_LOOK_BACK])))
        white = white[skipped:]
        e = rows[:, m]
        count = int(s.block[1])
        certain = self._learner.changes.first_certain(count, white)
        if certain and certain[0] - count < len(white):
            self._accumulate(
                inputs[: skipped + certain[0] - count], response[: skipped + certain[0] - count]
            )
            return skipped + certain[0] - count
        s.cell[:] = cell
        s.clock[ClockItem.ROWS_TO_LOOK_BACK] = min(
            order, s.clock[ClockItem.ROWS_TO_LOOK_BACK] + len(response)
        )
        extend_segments(s.products, count, white)
        s.block[:3] += (len(response), len(white), np.sum(white[:, m] ** 4))
        late = e[order + skipped :]
        for lag in range(order + 1):
            s.block[3 + lag] += late @ e[order + skipped - lag : len(e) - lag]
        s.rows[:] = rows[len(response) :]
        s.clock[ClockItem.STEPS_TAKEN] += len(response)
        if certain:
            self._learner.changes.begin(1 << certain[1])
        return len(response)

    @property
    def _linearised(self) -> LinearisedCell:
        point = self.state.point[self.network.nuisances :]
        if self._cached is None or not np.array_equal(self._cached[0], point):
            self._cached = point.copy(), LinearisedCell.at_point(self.network, point)
        return self._cached[1]

    _tone: Tone | None = None
    _cached: tuple[FloatArray, LinearisedCell] | None = None


def _square_root(covariance: FloatArray) -> FloatArray:
    """Return the upper triangle R with (RᵀR)⁻¹ = ``covariance``, shape (P, P)."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    floored = np.maximum(values, np.finfo(float).eps * values[-1])
    return information.reduced((vectors / np.sqrt(floored)).T)
