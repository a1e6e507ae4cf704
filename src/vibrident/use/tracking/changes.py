"""A change of the sensor: when it is certain, what is learned anew, and what it was."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models import ParameterSpec
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import (
    NORMAL,
    Change,
    change,
    likelihood_ratio,
    named,
    stretch,
    suspects,
    variance_deviate,
)
from vibrident.use.tracking.knowledge import Knowledge
from vibrident.use.tracking.state import INNOVATION, OPENED, SEEN, Alarm

DEAD = "dead channel"
LOUDER = "noise, or a part of the response that the model does not have: a second mode, a loose mounting"
PASSED = "a disturbance that has passed"
#: Variance of the noise, its degrees of freedom and spread, where none was seen.
NOTHING_BEFORE = (0.0, 0.0, 0.0)


class Changes:
    """Tests the segments under way, learns what follows a change, and names it."""

    def __init__(self, knowledge: Knowledge) -> None:
        self.knowledge = knowledge
        self.alarms: list[Alarm] = []

    def seen(self, count: int, rows: FloatArray) -> tuple[int, int] | None:
        """End and level of the first segment of a block in which a change is certain.

        ``count``: rows of the block before these; ``rows``: whitened, shape (rows, m + 1).
        """
        s, k, thresholds = self.knowledge.state, self.knowledge.network.nuisances, self.knowledge.thresholds
        if not s.clock[9] or s.clock[6] or s.pending[0] or s.noise[1] == 0.0:
            return None
        variance, freedom, spread = self.noise()
        parts = len(thresholds.louder)
        limit = thresholds.change[:parts, 0] * variance * spread / (NORMAL - 1.0)
        for end, level in suspects(s.part, count, rows, k, limit, variance * thresholds.louder):
            length = 1 << level
            gram = stretch(s.part, count, rows, end - length, end)
            found = change(s.known, gram / variance, k)
            statistic = likelihood_ratio(found.statistic * (NORMAL - 1.0) / spread, freedom)
            deviate = self._deviate(gram[-1, -1] / length / variance, length, freedom, spread)
            certain = found.order and statistic > thresholds.change[level, len(found.order) - 1]
            if certain or deviate > thresholds.noise[level]:
                return end, level
        return None

    def begin(self, length: int) -> None:
        """A change is certain by so many rows up to now: it is looked at by the rows that follow."""
        s, now = self.knowledge.state, self.knowledge.time_s
        start = now - length * self.knowledge.network.interval_s
        s.pending[:7] = SEEN, start, now, *self.noise(), 1.0
        s.ladder.meta[:], s.clock[4] = 0.0, 0.0
        s.drop_block()

    def alarmed(self) -> bool:
        """Test the segments that end here; where one is certain to be of another sensor, learn that anew."""
        s, parts = self.knowledge.state, self.knowledge.settings.parts
        blocks = int(s.clock[4])
        for level in range(self.knowledge.settings.levels):
            if blocks % (1 << level):
                break
            found, statistic, deviate = self._tested(level)
            limits = self.knowledge.thresholds.change[parts + level]
            certain = bool(found.order) and statistic > limits[len(found.order) - 1]
            if certain or deviate > self.knowledge.thresholds.noise[parts + level]:
                self._relearn(certain=certain)
                return True
        if s.pending[0] == SEEN:
            self._say_noise(float(s.ladder.meta[0, 1] / s.ladder.meta[0, 2]), float(s.ladder.meta[0, 2]), PASSED)
            s.pending[0] = 0.0
        return False

    def _tested(self, level: int) -> tuple[Change, float, float]:
        """Test of a change at the start of a segment, its statistic, and the deviate of the segment's noise.

        A segment that is noisier than the rest is tested against its own noise.
        """
        s = self.knowledge.state
        _, squares, freedom, variance, behind, spread, _ = s.ladder.meta[level]
        found = change(s.ladder.known[level], s.ladder.gram[level], self.knowledge.network.nuisances)
        own = max(1.0, squares / freedom / (s.noise[0] / s.noise[1]))
        statistic = likelihood_ratio(found.statistic / own, float(s.noise[1]))
        return found, statistic, self._deviate(squares / freedom / (variance or 1.0), freedom, behind, spread)

    def noise(self) -> tuple[float, float, float]:
        """Variance of the noise, its degrees of freedom, and its spread: the variance of its squares in units of its
        own squared, by fourth powers, or from block to block where that is more."""
        squares, freedom, fourth, rows, blocks_squared, blocks = self.knowledge.state.noise.tolist()
        variance = squares / freedom
        between = (blocks_squared / freedom / variance**2 - 1.0) * freedom / blocks
        return variance, freedom, max(NORMAL - 1.0, fourth / rows / variance**2 - 1.0, between)

    def _deviate(self, ratio: float, above: float, below: float, spread: float) -> float:
        """Normal deviate of a ratio of variances, whose spread is known by the blocks below (Student's t, by its
        likelihood ratio); zero where either is not known by one degree of freedom, where the approximation fails."""
        if not below or 2.0 * min(above, below) < spread:
            return 0.0
        normal = variance_deviate(ratio, 2.0 * above / spread, 2.0 * below / spread)
        blocks = below / self.knowledge.settings.block
        return float(np.copysign(np.sqrt(likelihood_ratio(normal**2, blocks)), normal))

    def _keep_others(self, before: FloatArray, gain: float) -> None:
        """A response without motion tells the gain alone, which is now this coordinate."""
        s, net = self.knowledge.state, self.knowledge.network
        k, amount = net.nuisances, np.zeros(net.parameters)
        amount[net.gain] = gain - before[k + net.gain]
        s.noise[:], s.lags[:] = 0.0, 0.0
        s.known[:] = information.walk(self.knowledge.before, amount**2 / information.LEFT, k)
        self.knowledge.move(before + np.concatenate([np.zeros(k), amount]))
        s.known[:, -1] = 0.0

    def _relearn(self, *, certain: bool) -> None:
        """Find when something changed, and open what is known to what follows."""
        s = self.knowledge.state
        tests = {int(level): self._tested(int(level)) for level in np.flatnonzero(s.ladder.meta[:, 0] > 0.0)}
        level = max(tests, key=lambda each: tests[each][0].statistic if certain else tests[each][2])
        blocks, _, _, variance, behind, spread, start = s.ladder.meta[level]
        if s.pending[0] != SEEN:
            s.pending[1:7] = start, self.knowledge.time_s, variance, behind, spread, blocks
        before, amount = tests[level][0].least(self.knowledge.thresholds.further)
        self._open(s.ladder.known[level], amount, before + amount)

    def contradict(self) -> None:
        """Forget every parameter: the parts of a run contradict what was known, each in its own way."""
        s, net = self.knowledge.state, self.knowledge.network
        s.pending[2:7] = self.knowledge.time_s, *NOTHING_BEFORE, 1.0
        back = information.solve(s.known)[net.nuisances :]
        self._open(s.known.copy(), np.ones(net.parameters), back)

    def _open(self, known: FloatArray, amount: FloatArray, move: FloatArray) -> None:
        """Open what was known to changes of the parameters, and move the point.

        Args:
            known: before the change, shape (m, m + 1).
            amount: by which each may have changed, shape (P,).
            move: of the point, shape (P,).
        """
        s, k = self.knowledge.state, self.knowledge.network.nuisances
        s.pending[0] = OPENED
        self.knowledge.before[:] = known
        s.known[:] = information.walk(known, amount**2 / information.LEFT, k)
        s.noise[:], s.lags[:], s.ladder.meta[:] = 0.0, 0.0, 0.0
        s.clock[4] = s.clock[9] = s.clock[10] = 0.0
        self.knowledge.move(np.concatenate([np.zeros(k), move]))

    def name(self) -> None:
        """A block after a change: say what it was, or wait for another where it takes more to tell."""
        s, net = self.knowledge.state, self.knowledge.network
        k = net.nuisances
        before, after = (information.solve(known) for known in (self.knowledge.before, s.known))
        spread = information.covariance(self.knowledge.before, k) + information.covariance(s.known, k)
        _, start, detected, variance, behind, noise_spread, wait = s.pending[:7].tolist()
        changed = named(before[k:], after[k:], spread, self.knowledge.thresholds.further)
        now, freedom = float(s.noise[0] / s.noise[1]), float(s.noise[1])
        louder = self._deviate(now / (variance or 1.0), freedom, behind, noise_spread)
        if not changed and louder < self.knowledge.thresholds.noise[self.knowledge.settings.parts] and wait > 1.0:
            s.pending[6] -= 1.0
            return
        for place, amount, u in changed:
            spec, scale = net.model.parameters[place], float(net.scale[place])
            value = float(s.point[k + place] + before[k + place]) * scale
            what = in_words(spec, value, value + amount * scale, u * scale)
            self.alarms.append(Alarm(start, detected, spec.name, value, value + amount * scale, u * scale, what))
            if what == DEAD:
                self._keep_others(before, float(after[k + net.gain]))
                behind = 0.0  # what it does now is no noise of the sensor's
                break
        if behind > 0.0:
            if louder > self.knowledge.thresholds.noise[self.knowledge.settings.parts]:
                self._say_noise(now, freedom, LOUDER)
            elif not changed:
                self._say_noise(now, freedom, PASSED)
                s.known[:] = self.knowledge.before
                self.knowledge.free_run()
        s.pending[0] = s.clock[4] = 0.0

    def _say_noise(self, now: float, freedom: float, what: str) -> None:
        _, start, detected, variance, behind, spread = self.knowledge.state.pending[:6].tolist()
        u = float(np.sqrt(spread / 4.0 * (variance / behind + now / freedom)))
        self.alarms.append(Alarm(start, detected, INNOVATION, variance**0.5, now**0.5, u, what))


def in_words(spec: ParameterSpec, before: float, after: float, u: float) -> str:
    """What a change of this parameter is called; by it a gain of zero within 3 u is a dead channel."""
    if spec.kind == "gain":
        if abs(after) < 3.0 * u:
            return DEAD
        return "polarity" if abs(after + before) < 3.0 * u else "gain"
    return "clock, or delay of a channel" if spec.kind == "time" else spec.words or spec.name.replace("_", " ")
