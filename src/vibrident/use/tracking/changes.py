"""A change of the sensor: when it is certain, what is learned anew, and what it was."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models import ParameterSpec
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import NORMAL, Change, change, likelihood_ratio, named, variance_deviate
from vibrident.use.tracking.knowledge import Knowledge
from vibrident.use.tracking.state import Alarm

#: Standard deviation that a changed parameter is given after an alarm, in units of its change.
RELEARN = 10.0
#: Blocks before a segment from which on its noise can be told to be another.
BEHIND = 8
DEAD = "dead channel"
LOUDER = "noise, or a part of the response that the model does not have: a second mode, a loose mounting"
PASSED = "a disturbance that has passed"


class Changes:
    """Tests the segments under way, and names a change one block after it was certain."""

    def __init__(self, knowledge: Knowledge) -> None:
        self.knowledge = knowledge
        self.alarms: list[Alarm] = []

    def alarmed(self) -> bool:
        """Test the segments that end here; where one is certain to be of another sensor, learn that anew."""
        s = self.knowledge.state
        blocks = int(s.clock[4])
        for level in range(self.knowledge.settings.levels):
            if blocks % (1 << level):
                break
            found, statistic, deviate = self._tested(level)
            certain = found.columns > 0 and statistic > self.knowledge.thresholds.change[level, found.columns - 1]
            if certain or deviate > self.knowledge.thresholds.noise[level]:
                self._relearn(certain=certain)
                return True
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
        if behind < BEHIND * self.knowledge.settings.block:
            return found, statistic, 0.0
        return found, statistic, _deviate(squares / freedom / variance, freedom, behind, spread)

    def spread(self) -> float:
        """Variance of the squares of the noise, in units of its squared variance: by fourth powers, or from block to
        block where that is more."""
        squares, freedom, fourth, rows, blocks_squared, blocks = self.knowledge.state.noise
        variance = squares / freedom
        between = (blocks_squared / freedom / variance**2 - 1.0) * freedom / blocks
        return float(max(NORMAL - 1.0, fourth / rows / variance**2 - 1.0, between))

    def _keep_others(self, before: FloatArray, after: FloatArray) -> None:
        """A response without motion tells the gain alone."""
        s, net = self.knowledge.state, self.knowledge.network
        k, amount = net.nuisances, np.zeros(net.parameters)
        amount[net.gain] = after[net.gain] - before[net.gain]
        s.noise[:], s.lags[:] = 0.0, 0.0
        s.known[:] = information.walk(self.knowledge.before, (RELEARN * amount) ** 2, k)
        self.knowledge.move(np.concatenate([np.zeros(k), before + amount]))

    def _relearn(self, *, certain: bool) -> None:
        """Something changed: find when, and open what is known to what follows."""
        s, k = self.knowledge.state, self.knowledge.network.nuisances
        tests = {int(level): self._tested(int(level)) for level in np.flatnonzero(s.ladder.meta[:, 0] > 0.0)}
        level = max(tests, key=lambda each: tests[each][0].statistic if certain else tests[each][2])
        found = tests[level][0]
        _, _, _, variance, behind, spread, start = s.ladder.meta[level]
        s.pending[:6] = 1.0, start, self.knowledge.time_s, variance, behind, spread
        self.knowledge.before[:] = s.ladder.known[level]
        s.known[:] = information.walk(s.ladder.known[level], (RELEARN * found.amount) ** 2, k)
        s.noise[:], s.lags[:], s.ladder.meta[:] = 0.0, 0.0, 0.0
        s.clock[4] = s.clock[9] = 0.0
        self.knowledge.move(np.concatenate([np.zeros(k), found.before + found.amount]))

    def name(self) -> bool:
        """A whole block after a change: say what it was."""
        s, net = self.knowledge.state, self.knowledge.network
        k = net.nuisances
        before, after = (information.solve(known)[k:] for known in (self.knowledge.before, s.known))
        spread = information.covariance(self.knowledge.before, k) + information.covariance(s.known, k)
        _, start, detected, variance, behind, noise_spread = s.pending[:6].tolist()
        changed = named(before, after, spread, self.knowledge.thresholds.further)
        for place, amount, u in changed:
            spec, scale = net.model.parameters[place], float(net.scale[place])
            value = float(s.point[k + place] + before[place]) * scale
            what = in_words(spec, value, value + amount * scale, u * scale)
            self.alarms.append(Alarm(start, detected, spec.name, value, value + amount * scale, u * scale, what))
            if what == DEAD:
                self._keep_others(before, after)
                behind = 0.0  # what it does now is no noise of the sensor's
                break
        if behind > 0.0:
            freedom, ratio = float(s.noise[1]), float(s.noise[0] / s.noise[1]) / variance
            louder = _deviate(ratio, freedom, behind, noise_spread) > self.knowledge.thresholds.noise[0]
            if louder or not changed:
                values = float(np.sqrt(variance)), float(np.sqrt(ratio * variance))
                u = float(np.sqrt(noise_spread / 4.0 * (values[0] ** 2 / behind + values[1] ** 2 / freedom)))
                what = LOUDER if louder else PASSED
                self.alarms.append(Alarm(start, detected, "innovation", *values, u, what))
        s.pending[0] = s.clock[4] = 0.0
        return False


def in_words(spec: ParameterSpec, before: float, after: float, u: float) -> str:
    """What a change of this parameter is called; by it a gain of zero within 3 u is a dead channel."""
    if spec.kind == "gain":
        if abs(after) < 3.0 * u:
            return DEAD
        return "polarity" if abs(after + before) < 3.0 * u else "gain"
    return "clock, or delay of a channel" if spec.kind == "time" else spec.words or spec.name.replace("_", " ")


def _deviate(ratio: float, above: float, below: float, spread: float) -> float:
    """Zero where the noise is not known by one degree of freedom, where the approximation fails."""
    if 2.0 * min(above, below) < spread:
        return 0.0
    return variance_deviate(ratio, 2.0 * above / spread, 2.0 * below / spread)
