"""Learning from a block of rows, by recursive prediction errors."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.noise.autoregression import yule_walker
from vibrident.use.tracking import information
from vibrident.use.tracking.changes import Changes
from vibrident.use.tracking.knowledge import Knowledge
from vibrident.use.tracking.state import OPENED

#: Power of the response to the motion, in units of the noise's, from which a block counts: as the bins of a fit.
EXCITED = 10.0
#: Part of a block that sets the point of linearisation, where it is not settled.
FIRST = 8


class Learner:
    """Takes whole blocks into what is known."""

    def __init__(self, knowledge: Knowledge) -> None:
        self.knowledge, self.changes = knowledge, Changes(knowledge)

    def end_block(self) -> None:
        """The block under way is whole: learn from it, test it, begin the next."""
        s, net = self.knowledge.state, self.knowledge.network
        m, k = net.columns, net.nuisances
        gram = s.gram
        upper = information.triangle(gram)
        squares = float(upper[m, m] ** 2)
        freedom = float(s.own[1] - np.count_nonzero(np.diag(upper)[:m]))
        known_noise = s.noise[1] > 0.0
        variance = s.noise[0] / s.noise[1] if known_noise else squares / max(freedom, 1.0)
        gain = k + net.gain
        least = EXCITED * s.own[1] * variance / max(upper[gain, gain], 1e-150) ** 2  # of the gain's square
        if not (freedom > 0.0 and variance > 0.0 and max(1.0, s.point[gain] ** 2) > least):
            self.knowledge.free_run()
            return
        if s.point[gain] ** 2 <= least:  # a dead channel: motion without a response tells the gain alone
            others = np.delete(np.arange(k, m), net.gain)
            gram[others], gram[:, others] = 0.0, 0.0
            upper = information.triangle(gram)
        fresh = bool(s.clock[6])
        if fresh:
            diagonal = np.arange(k)
            s.known[diagonal, diagonal] = np.sqrt(information.NONE * np.maximum(np.diag(gram)[:k], 1e-300) / variance)
            s.clock[6] = 0.0
        s.known[:], s.clock[3] = self.knowledge.walked(), self.knowledge.time_s
        learned = information.absorb(s.known, upper[:m] / np.sqrt(variance))
        lags = s.own[3:].copy(), float(s.own[1])
        if not s.clock[9]:
            if s.pending[0] != OPENED:
                if not s.clock[10]:
                    s.pending[1] = self.knowledge.time_s - s.own[0] * net.interval_s
                s.clock[10] += 1.0
            if not fresh and not self._unsettled(learned):
                s.clock[9] = 1.0
                self._learn_whitening(*lags)
                s.lags[:] = 0.0
            s.own[:], s.part[:] = 0.0, 0.0
            self.knowledge.move(information.solve(learned))
            return
        before = self.changes.noise() if known_noise else (0.0, 0.0, 0.0)
        start = self.knowledge.time_s - s.own[0] * net.interval_s
        gram = gram / variance
        if s.pending[0] != OPENED:
            s.ladder.add(s.known, gram, (squares, freedom, *before), start, int(s.clock[4]))
        s.known[:] = learned
        s.row[:-2] += gram.ravel()
        s.row[-2:] += (squares, freedom)
        s.noise += (squares, freedom, s.own[2], s.own[1], squares**2 / freedom, 1.0)
        s.clock[4] += 1.0
        s.own[:], s.part[:] = 0.0, 0.0
        if s.pending[0] == OPENED:
            self.changes.name()
        elif self.changes.alarmed():
            return
        if not self._moved(fresh=fresh):
            self._learn_whitening(*lags)

    def end_run(self) -> None:
        """Doubt what was known where more parts than a block has set the point in a run, and no two agreed."""
        s = self.knowledge.state
        if not s.clock[9] and s.clock[10] > FIRST:
            self.changes.contradict()

    def _unsettled(self, learned: FloatArray) -> bool:
        """Whether this block moves the point by more than two independent ones may: it then sets the point alone."""
        k = self.knowledge.network.nuisances
        away = learned[k:, k:-1] @ information.solve(learned)[k:]
        return bool(away @ away > 2.0 * self.knowledge.thresholds.further[-1])

    def _moved(self, *, fresh: bool) -> bool:
        """Move the point of linearisation where the estimate is about u off, or the initial states are new."""
        s, net = self.knowledge.state, self.knowledge.network
        k = net.nuisances
        move = information.solve(s.known)
        away = s.known[k:, k:-1] @ move[k:]
        if not fresh and s.clock[4] > 1.0 and away @ away <= len(away):  # its square expects one a parameter
            return False
        self.knowledge.move(move)
        return True

    def _learn_whitening(self, lags: FloatArray, rows: float) -> None:
        """The autoregression of the residual anew, whenever the number of blocks has doubled."""
        s = self.knowledge.state
        s.lags += np.concatenate([[rows, 1.0], lags])
        blocks = int(s.lags[1])
        if blocks & (blocks - 1):
            return
        rows = s.lags[0]
        white, left = yule_walker(s.lags[2:] / rows, rows)
        s.whitening[:] = np.append(white[1:], np.zeros(len(s.whitening) - len(white) + 1))
        if s.noise[1] > 0.0:
            ratio = left / (s.noise[0] / s.noise[1])
            s.noise[0] *= ratio
            s.noise[[2, 4]] *= ratio**2
