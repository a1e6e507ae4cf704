"""Knowledge of the unknowns at a point of linearisation, and moves of that point."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import Thresholds
from vibrident.use.tracking.network import SensorNetwork
from vibrident.use.tracking.state import ClockItem, State, TrackerSettings

SECONDS_A_YEAR = 365.25 * 86400.0


class Knowledge:
    """State of a tracker, with its network, settings and thresholds."""

    def __init__(self, network: SensorNetwork, settings: TrackerSettings) -> None:
        self.network: SensorNetwork = network
        self.settings: TrackerSettings = settings
        lengths = settings.segment_lengths, settings.levels
        self.thresholds: Thresholds = Thresholds.from_alarm_rate(
            settings.false_alarms_per_day, network.interval_s, *lengths, network.parameters
        )
        self.state: State = State.empty(network, settings)

    @property
    def time_s(self) -> float:
        """Return the time of the next step, s: samples before it are taken."""
        return float(
            self.state.clock[ClockItem.RUN_START_S]
            + self.state.clock[ClockItem.STEPS_TAKEN] * self.network.interval_s
        )

    @property
    def before(self) -> FloatArray:
        """Return the information before a change that is not named yet, shape (m, m + 1)."""
        return self.state.pending[7:].reshape(self.state.root.shape)

    def free_run(self) -> None:
        """Begin a run whose initial states and offset are unknown."""
        s = self.state
        net = self.network
        n = net.order
        p = net.parameters
        s.cell[:] = 0.0
        s.cell[n * (1 + p) :] = np.eye(n).ravel()
        s.rows[:] = 0.0
        s.drop_block()
        s.point[: n + 1] = 0.0
        s.root[: n + 1] = 0.0
        s.ladder.drop(n + 1)
        self.before[: n + 1] = 0.0
        s.clock[ClockItem.STATES_ARE_UNKNOWN] = 1.0

    def walked(self) -> FloatArray:
        """Return the information now, the random walk since the last time included."""
        s = self.state
        net = self.network
        k = net.nuisances
        rate = np.square(self.settings.drift_per_year) / SECONDS_A_YEAR
        size = np.where([spec.kind == "time" for spec in net.model.parameters], 1.0, s.point[k:])
        variance = rate * size**2 * max(0.0, self.time_s - s.clock[ClockItem.LAST_WALK_S])
        return information.walk(s.root, variance, k)

    def move(self, move: FloatArray) -> None:
        """Move the point of linearisation by ``move``, shape (m,), with states and information."""
        s = self.state
        net = self.network
        n = net.order
        p = net.parameters
        k = net.nuisances
        move[k:] = net.moved(s.point[k:], move[k:]) - s.point[k:]
        s.point[n:] += move[n:]
        free = s.cell[n * (1 + p) :].reshape(n, n)
        slopes = s.cell[n : n * (1 + p)].reshape(p, n)
        s.cell[:n] += move[:n] @ free + move[k:] @ slopes
        for root in (s.root, self.before):
            root[:, -1] -= root[:, :-1] @ move
        s.rows[:, -1] -= s.rows[:, :-1] @ move
        s.ladder.shift(move)
        side = s.products.shape[1]
        s.row[:-2] = information.shifted(s.row[:-2].reshape(side, side), move).ravel()
