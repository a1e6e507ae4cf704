"""Learning from a block of rows, by recursive prediction errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.noise.autoregression import yule_walker
from vibrident.use.tracking import information
from vibrident.use.tracking.changes import Changes
from vibrident.use.tracking.knowledge import Knowledge
from vibrident.use.tracking.state import CHANGE_BEING_LEARNED, ClockItem

#: Power of the response to the motion from which a block counts, in units of the noise's power; as
#: the bins of a fit.
MIN_EXCITATION_RATIO = 10.0
#: A block is cut into so many parts, each of which sets the point until it is settled.
PARTS_OF_FIRST_BLOCK = 8


class _Block(NamedTuple):
    """Products of the rows of a block, and the noise there.

    Attributes:
        gram: products of columns and response, shape (m + 1, m + 1).
        upper: its triangle, shape (m + 1, m + 1).
        squares: of the residual.
        freedom: degrees of freedom of these.
        variance: of the noise.
        noise_is_known: whether earlier blocks tell it.
    """

    gram: FloatArray
    upper: FloatArray
    squares: float
    freedom: float
    variance: float
    noise_is_known: bool


class Learner:
    """Add whole blocks to what is known."""

    def __init__(self, knowledge: Knowledge) -> None:
        self.knowledge: Knowledge = knowledge
        self.changes: Changes = Changes(knowledge)

    def end_block(self) -> None:
        """Learn from the block under way, test it, and begin the next."""
        block = self._moving_block()
        if block is None:
            self.knowledge.free_run()
            return
        s = self.knowledge.state
        is_new_run = self._begin_states(block)
        s.root[:] = self.knowledge.walked()
        s.clock[ClockItem.LAST_WALK_S] = self.knowledge.time_s
        rows = block.upper[: self.knowledge.network.columns] / np.sqrt(block.variance)
        learned = information.absorb(s.root, rows)
        lags = s.block[3:].copy(), float(s.block[1])
        if not s.clock[ClockItem.POINT_IS_SETTLED]:
            if self._settle_point(learned, is_new_run=is_new_run):
                self._learn_whitening(*lags)
                s.lags[:] = 0.0
            self._clear_block()
            self.knowledge.move(information.solve(learned))
            return
        self._add(block, learned)
        self._clear_block()
        if s.pending[0] == CHANGE_BEING_LEARNED:
            self.changes.name()
        elif self.changes.test_segments():
            return
        if not self._moved(is_new_run=is_new_run):
            self._learn_whitening(*lags)

    def _moving_block(self) -> _Block | None:
        """Return the block under way; None where it has no motion that stands out of the noise."""
        s = self.knowledge.state
        net = self.knowledge.network
        m = net.columns
        k = net.nuisances
        gram = s.gram
        upper = information.triangle(gram)
        squares = float(upper[m, m] ** 2)
        freedom = float(s.block[1] - np.count_nonzero(np.diag(upper)[:m]))
        noise_is_known = bool(s.noise[1] > 0.0)
        variance = s.noise[0] / s.noise[1] if noise_is_known else squares / max(freedom, 1.0)
        gain = k + net.gain
        min_squared_gain = (
            MIN_EXCITATION_RATIO * s.block[1] * variance / max(upper[gain, gain], 1e-150) ** 2
        )
        moved = max(1.0, s.point[gain] ** 2) > min_squared_gain
        if not (freedom > 0.0 and variance > 0.0 and moved):
            return None
        if s.point[gain] ** 2 <= min_squared_gain:
            # A dead channel: motion without a response tells the gain alone.
            not_gain = np.delete(np.arange(k, m), net.gain)
            gram[not_gain] = 0.0
            gram[:, not_gain] = 0.0
            upper = information.triangle(gram)
        return _Block(gram, upper, squares, freedom, float(variance), noise_is_known)

    def _begin_states(self, block: _Block) -> bool:
        """Make the states of a new run next to unknown; return whether one begins in a block."""
        s = self.knowledge.state
        if not s.clock[ClockItem.STATES_ARE_UNKNOWN]:
            return False
        diagonal = np.arange(self.knowledge.network.nuisances)
        power = np.maximum(np.diag(block.gram)[: diagonal.size], 1e-300)
        s.root[diagonal, diagonal] = np.sqrt(
            information.INITIAL_INFORMATION * power / block.variance
        )
        s.clock[ClockItem.STATES_ARE_UNKNOWN] = 0.0
        return True

    def _settle_point(self, learned: FloatArray, *, is_new_run: bool) -> bool:
        """Settle the point of linearisation if a part of the first block does; return whether."""
        s = self.knowledge.state
        if s.pending[0] != CHANGE_BEING_LEARNED:
            if not s.clock[ClockItem.PARTS_AT_POINT]:
                s.pending[1] = self._block_start_s
            s.clock[ClockItem.PARTS_AT_POINT] += 1.0
        if is_new_run or self._is_unsettled(learned):
            return False
        s.clock[ClockItem.POINT_IS_SETTLED] = 1.0
        return True

    def _add(self, block: _Block, learned: FloatArray) -> None:
        """Add a block to what is known, and to the segments that are compared."""
        s = self.knowledge.state
        gram = block.gram / block.variance
        squares = block.squares
        freedom = block.freedom
        if s.pending[0] != CHANGE_BEING_LEARNED:
            before = self.changes.noise() if block.noise_is_known else (0.0, 0.0, 0.0)
            noise = squares, freedom, *before
            s.ladder.add(s.root, gram, noise, self._block_start_s, int(s.clock[ClockItem.BLOCKS]))
        s.root[:] = learned
        s.row[:-2] += gram.ravel()
        s.row[-2:] += (squares, freedom)
        s.noise += (squares, freedom, s.block[2], s.block[1], squares**2 / freedom, 1.0)
        s.clock[ClockItem.BLOCKS] += 1.0

    def _clear_block(self) -> None:
        """Begin the next block."""
        s = self.knowledge.state
        s.block[:] = 0.0
        s.products[:] = 0.0

    @property
    def _block_start_s(self) -> float:
        """Return when the block under way began, s."""
        knowledge = self.knowledge
        return knowledge.time_s - knowledge.state.block[0] * knowledge.network.interval_s

    def end_run(self) -> None:
        """Forget the parameters where the parts of a run contradict each other.

        That is so where more parts than a block has set the point, and no two agreed.
        """
        s = self.knowledge.state
        if (
            not s.clock[ClockItem.POINT_IS_SETTLED]
            and s.clock[ClockItem.PARTS_AT_POINT] > PARTS_OF_FIRST_BLOCK
        ):
            self.changes.contradict()

    def _is_unsettled(self, learned: FloatArray) -> bool:
        """Return whether this block moves the point by more than two independent blocks may.

        Such a block sets the point alone.
        """
        k = self.knowledge.network.nuisances
        away = learned[k:, k:-1] @ information.solve(learned)[k:]
        return bool(away @ away > 2.0 * self.knowledge.thresholds.further[-1])

    def _moved(self, *, is_new_run: bool) -> bool:
        """Move the point of linearisation where the estimate is about u off, or the run is new."""
        s = self.knowledge.state
        net = self.knowledge.network
        k = net.nuisances
        move = information.solve(s.root)
        away = s.root[k:, k:-1] @ move[k:]
        # the expected square is one for each parameter
        if not is_new_run and s.clock[ClockItem.BLOCKS] > 1.0 and away @ away <= len(away):
            return False
        self.knowledge.move(move)
        return True

    def _learn_whitening(self, lags: FloatArray, rows: float) -> None:
        """Estimate the residual's autoregression whenever the number of blocks has doubled."""
        s = self.knowledge.state
        s.lags += np.concatenate([[rows, 1.0], lags])
        blocks = int(s.lags[1])
        if blocks & (blocks - 1):
            return
        rows = s.lags[0]
        white, innovation_variance = yule_walker(s.lags[2:] / rows, rows)
        s.whitening[:] = np.append(white[1:], np.zeros(len(s.whitening) - len(white) + 1))
        if s.noise[1] > 0.0:
            ratio = innovation_variance / (s.noise[0] / s.noise[1])
            s.noise[0] *= ratio
            s.noise[[2, 4]] *= ratio**2
