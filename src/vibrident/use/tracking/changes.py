"""A change of the sensor: its detection, what is learned anew, and its name."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models import ParameterSpec
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import (
    NORMAL_KURTOSIS,
    ChangeTest,
    changed_coordinates,
    likelihood_ratio,
    score_test,
    segment_products,
    suspect_segments,
    variance_deviate,
)
from vibrident.use.tracking.knowledge import Knowledge
from vibrident.use.tracking.state import (
    CHANGE_BEING_LEARNED,
    CHANGE_DETECTED,
    INNOVATION,
    Alarm,
    ClockItem,
)

DEAD_CHANNEL = "dead channel"
LOUDER_NOISE = (
    "noise, or a part of the response that the model does not have: a second mode, a loose mounting"
)
PASSED_DISTURBANCE = "a disturbance that has passed"
#: Variance of the noise, its degrees of freedom and its spread, before any noise was seen.
UNKNOWN_NOISE = (0.0, 0.0, 0.0)


class Changes:
    """Test the segments under way, learn what follows a change, and name it."""

    def __init__(self, knowledge: Knowledge) -> None:
        self.knowledge = knowledge
        self.alarms: list[Alarm] = []

    def first_certain(self, count: int, rows: FloatArray) -> tuple[int, int] | None:
        """Return end and level of the first segment of a block in which a change is certain.

        ``count``: rows of the block before these; ``rows``: whitened, shape (rows, m + 1).
        """
        s = self.knowledge.state
        k = self.knowledge.network.nuisances
        thresholds = self.knowledge.thresholds
        if (
            not s.clock[ClockItem.POINT_IS_SETTLED]
            or s.clock[ClockItem.STATES_ARE_UNKNOWN]
            or s.pending[0]
            or s.noise[1] == 0.0
        ):
            return None
        variance, freedom, spread = self.noise()
        lengths = len(thresholds.louder)
        limit = thresholds.change[:lengths, 0] * variance * spread / (NORMAL_KURTOSIS - 1.0)
        for end, level in suspect_segments(
            s.products, count, rows, k, limit, variance * thresholds.louder
        ):
            length = 1 << level
            gram = segment_products(s.products, count, rows, end - length, end)
            change = score_test(s.root, gram / variance, k)
            statistic = likelihood_ratio(
                change.statistic * (NORMAL_KURTOSIS - 1.0) / spread, freedom
            )
            deviate = self._deviate(gram[-1, -1] / length / variance, length, freedom, spread)
            certain = change.order and statistic > thresholds.change[level, len(change.order) - 1]
            if certain or deviate > thresholds.noise[level]:
                return end, level
        return None

    def begin(self, length: int) -> None:
        """Note that a change in the last ``length`` rows is certain, and wait for further rows."""
        s = self.knowledge.state
        now = self.knowledge.time_s
        start = now - length * self.knowledge.network.interval_s
        s.pending[:7] = CHANGE_DETECTED, start, now, *self.noise(), 1.0
        s.ladder.meta[:] = 0.0
        s.clock[ClockItem.BLOCKS] = 0.0
        s.drop_block()

    def test_segments(self) -> bool:
        """Test the segments that end here, and learn anew where a change is certain.

        Returns whether one is.
        """
        s = self.knowledge.state
        lengths = self.knowledge.settings.segment_lengths
        blocks = int(s.clock[ClockItem.BLOCKS])
        for level in range(self.knowledge.settings.levels):
            if blocks % (1 << level):
                break
            change, statistic, deviate = self._test_segment(level)
            limits = self.knowledge.thresholds.change[lengths + level]
            certain = bool(change.order) and statistic > limits[len(change.order) - 1]
            if certain or deviate > self.knowledge.thresholds.noise[lengths + level]:
                self._relearn(certain=certain)
                return True
        if s.pending[0] == CHANGE_DETECTED:
            self._say_noise(
                float(s.ladder.meta[0, 1] / s.ladder.meta[0, 2]),
                float(s.ladder.meta[0, 2]),
                PASSED_DISTURBANCE,
            )
            s.pending[0] = 0.0
        return False

    def _test_segment(self, level: int) -> tuple[ChangeTest, float, float]:
        """Test a change at the start of a segment.

        A segment that is noisier than the noise before it is tested against its own noise.

        Returns:
            The change, its statistic, and the normal deviate of the segment's noise.
        """
        s = self.knowledge.state
        _, squares, freedom, variance, behind, spread, _ = s.ladder.meta[level]
        change = score_test(
            s.ladder.root[level], s.ladder.gram[level], self.knowledge.network.nuisances
        )
        excess = max(1.0, squares / freedom / (s.noise[0] / s.noise[1]))
        statistic = likelihood_ratio(change.statistic / excess, float(s.noise[1]))
        return (
            change,
            statistic,
            self._deviate(squares / freedom / (variance or 1.0), freedom, behind, spread),
        )

    def noise(self) -> tuple[float, float, float]:
        """Return variance, degrees of freedom and spread of the noise.

        The spread is the variance of the noise's squares in units of its own variance squared, from
        fourth powers, or from block to block where that is larger.
        """
        squares, freedom, fourth, rows, blocks_squared, blocks = self.knowledge.state.noise.tolist()
        variance = squares / freedom
        between = (blocks_squared / freedom / variance**2 - 1.0) * freedom / blocks
        return (
            variance,
            freedom,
            max(NORMAL_KURTOSIS - 1.0, fourth / rows / variance**2 - 1.0, between),
        )

    def _deviate(self, ratio: float, above: float, below: float, spread: float) -> float:
        """Return the normal deviate of a ratio of variances.

        The spread is known by the blocks below (Student's t, by its likelihood ratio). It is zero
        where either variance is not known by one degree of freedom: the approximation fails there.
        """
        if not below or 2.0 * min(above, below) < spread:
            return 0.0
        normal = variance_deviate(ratio, 2.0 * above / spread, 2.0 * below / spread)
        blocks = below / self.knowledge.settings.block
        return float(np.copysign(np.sqrt(likelihood_ratio(normal**2, blocks)), normal))

    def _keep_others(self, before: FloatArray, gain: float) -> None:
        """Change the gain alone, as a response without motion tells of nothing else.

        ``before``: coordinates before; ``gain``: the gain's coordinate now.
        """
        s = self.knowledge.state
        net = self.knowledge.network
        k = net.nuisances
        amount = np.zeros(net.parameters)
        amount[net.gain] = gain - before[k + net.gain]
        s.noise[:] = 0.0
        s.lags[:] = 0.0
        s.root[:] = information.walk(
            self.knowledge.before, amount**2 / information.RETAINED_INFORMATION, k
        )
        self.knowledge.move(before + np.concatenate([np.zeros(k), amount]))
        s.root[:, -1] = 0.0

    def _relearn(self, *, certain: bool) -> None:
        """Find when something changed, and open the parameters to what follows."""
        s = self.knowledge.state
        tests = {
            int(level): self._test_segment(int(level))
            for level in np.flatnonzero(s.ladder.meta[:, 0] > 0.0)
        }
        level = max(
            tests, key=lambda place: tests[place][0].statistic if certain else tests[place][2]
        )
        blocks, _, _, variance, behind, spread, start = s.ladder.meta[level]
        if s.pending[0] != CHANGE_DETECTED:
            s.pending[1:7] = start, self.knowledge.time_s, variance, behind, spread, blocks
        before, amount = tests[level][0].smallest(self.knowledge.thresholds.further)
        self._open(s.ladder.root[level], amount, before + amount)

    def contradict(self) -> None:
        """Forget every parameter, as the parts of a run contradict each other."""
        s = self.knowledge.state
        net = self.knowledge.network
        s.pending[2:7] = self.knowledge.time_s, *UNKNOWN_NOISE, 1.0
        back = information.solve(s.root)[net.nuisances :]
        self._open(s.root.copy(), np.ones(net.parameters), back)

    def _open(self, root: FloatArray, amount: FloatArray, move: FloatArray) -> None:
        """Open what was known to changes of the parameters, and move the point.

        Args:
            root: before the change, shape (m, m + 1).
            amount: by which each may have changed, shape (P,).
            move: of the point, shape (P,).
        """
        s = self.knowledge.state
        k = self.knowledge.network.nuisances
        s.pending[0] = CHANGE_BEING_LEARNED
        self.knowledge.before[:] = root
        s.root[:] = information.walk(root, amount**2 / information.RETAINED_INFORMATION, k)
        s.noise[:] = 0.0
        s.lags[:] = 0.0
        s.ladder.meta[:] = 0.0
        for item in (
            ClockItem.BLOCKS,
            ClockItem.POINT_IS_SETTLED,
            ClockItem.PARTS_AT_POINT,
        ):
            s.clock[item] = 0.0
        self.knowledge.move(np.concatenate([np.zeros(k), move]))

    def name(self) -> None:
        """Name a change after a block of rows, or wait for another where they are too few."""
        s = self.knowledge.state
        net = self.knowledge.network
        k = net.nuisances
        before, after = (information.solve(root) for root in (self.knowledge.before, s.root))
        spread = information.covariance(self.knowledge.before, k) + information.covariance(
            s.root, k
        )
        _, start, detected, variance, behind, noise_spread, wait = s.pending[:7].tolist()
        changed = changed_coordinates(
            before[k:], after[k:], spread, self.knowledge.thresholds.further
        )
        variance_now = float(s.noise[0] / s.noise[1])
        freedom = float(s.noise[1])
        louder = self._deviate(variance_now / (variance or 1.0), freedom, behind, noise_spread)
        if (
            not changed
            and louder < self.knowledge.thresholds.noise[self.knowledge.settings.segment_lengths]
            and wait > 1.0
        ):
            s.pending[6] -= 1.0
            return
        for index, amount, u in changed:
            spec = net.model.parameters[index]
            scale = float(net.scale[index])
            value = float(s.point[k + index] + before[k + index]) * scale
            what = _name_of(spec, value, value + amount * scale, u * scale)
            self.alarms.append(
                Alarm(start, detected, spec.name, value, value + amount * scale, u * scale, what)
            )
            if what == DEAD_CHANNEL:
                self._keep_others(before, float(after[k + net.gain]))
                behind = 0.0  # what it does now is no noise of the sensor's
                break
        if behind > 0.0:
            if louder > self.knowledge.thresholds.noise[self.knowledge.settings.segment_lengths]:
                self._say_noise(variance_now, freedom, LOUDER_NOISE)
            elif not changed:
                self._say_noise(variance_now, freedom, PASSED_DISTURBANCE)
                s.root[:] = self.knowledge.before
                self.knowledge.free_run()
        s.pending[0] = 0.0
        s.clock[ClockItem.BLOCKS] = 0.0

    def _say_noise(self, now: float, freedom: float, what: str) -> None:
        _, start, detected, variance, behind, spread = self.knowledge.state.pending[:6].tolist()
        u = float(np.sqrt(spread / 4.0 * (variance / behind + now / freedom)))
        self.alarms.append(Alarm(start, detected, INNOVATION, variance**0.5, now**0.5, u, what))


def _name_of(spec: ParameterSpec, before: float, after: float, u: float) -> str:
    """Return the name of a change of this parameter.

    A gain of zero within 3 u is a dead channel.
    """
    if spec.kind == "gain":
        if abs(after) < 3.0 * u:
            return DEAD_CHANNEL
        return "polarity" if abs(after + before) < 3.0 * u else "gain"
    return (
        "clock, or delay of a channel"
        if spec.kind == "time"
        else spec.words or spec.name.replace("_", " ")
    )
