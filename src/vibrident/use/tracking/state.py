"""Settings, state and estimates of a tracker."""

from __future__ import annotations

import binascii
import struct
from dataclasses import dataclass, field, fields
from enum import IntEnum

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.fields import NamedNumbers
from vibrident.data.records import FloatArray
from vibrident.use.tracking.detection import Ladder, segment_products
from vibrident.use.tracking.network import SensorNetwork

FORMAT_TAG = b"VTR2"
HEADER_BYTES = 16  # before the numbers
#: Stages of a change that is not named yet: its rows are still to come, or it is being learned.
CHANGE_DETECTED = 1.0
CHANGE_BEING_LEARNED = 2.0
#: Standard uncertainties from which something is certain.
CERTAIN_IN_U = 3.0
INNOVATION = "innovation"  # stands for the parameter in an alarm where the noise changed
WAITING_CHANNELS = ("reference", "response")  # fields whose samples wait for others


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of a tracker."""

    false_alarms_per_day: float = 0.01  # expected from noise alone, in a day of motion
    # relative random walk of the parameters in one year, of each or of all: their u grows by it
    # while they are not observed
    drift_per_year: float | tuple[float, ...] = 0.01
    # relative standard uncertainty of the reference, systematic; part of the gain's u
    reference_uncertainty: float = 0.0
    # relative error of the model at a tone, in addition to the noise, as the certificate states it
    model_error: float = 0.0
    block: int = 1024  # steps in a block, a power of two
    order: int = 8  # of the autoregression of the residual
    levels: int = 16  # number of lengths of segments tested for a change: 1, 2, 4, … blocks

    @property
    def segment_lengths(self) -> int:
        """Return the number of lengths of segments within a block: 1, 2, 4, … samples."""
        return self.block.bit_length() - 1


@dataclass(frozen=True)
class Alarm:
    """A change of the sensor or of its noise."""

    time_s: float  # estimated time of the change
    detected_s: float  # time of the sample at which it was certain
    parameter: str  # name of the parameter, or ``innovation``
    # value before, in the parameter's unit; of the innovation its rms, in that of the response
    before: float
    after: float  # value after
    u: float  # standard uncertainty of the change
    what: str  # what changed, in words

    def as_document(self) -> dict[str, float | str]:
        """Return the alarm as it stands in ``track.json``."""
        return {
            {"before": "from", "after": "to"}.get(name, name): value
            for name, value in vars(self).items()
        }


class ClockItem(IntEnum):
    """Places of the numbers in a state's ``clock``."""

    RUN_START_S = 0
    SAMPLES_FED = 1
    STEPS_TAKEN = 2
    LAST_WALK_S = 3
    #: Blocks since the start or the last alarm.
    BLOCKS = 4
    #: Rows before the block under way that whitening may look back to.
    ROWS_TO_LOOK_BACK = 5
    STATES_ARE_UNKNOWN = 6
    #: Samples of either channel that are still to be left out.
    REFERENCE_TO_SKIP = 7
    RESPONSE_TO_SKIP = 8
    POINT_IS_SETTLED = 9
    #: Parts of blocks that have set the point in this run.
    PARTS_AT_POINT = 10


def _initial_clock() -> FloatArray:
    """Return the clock of a tracker that has seen no sample."""
    clock = np.zeros(len(ClockItem))
    clock[ClockItem.LAST_WALK_S] = np.nan
    clock[ClockItem.STATES_ARE_UNKNOWN] = 1.0
    return clock


@dataclass(eq=False)
class State:
    """State that a tracker carries from sample to sample.

    The fields are arrays of float64, in the order in which they are saved.
    """

    # unknowns at the point of linearisation, shape (m,); zero for the initial states
    point: FloatArray
    # square-root information about the unknowns less the point, shape (m, m + 1)
    root: FloatArray
    # of the block under way: steps, rows, fourth powers; autocovariance; shape (3 + order + 1,)
    block: FloatArray
    whitening: FloatArray  # autoregression of the residual, shape (order,)
    # of the whitened residual: squares, degrees of freedom, fourth powers, rows; squares² over
    # degrees of freedom of each block, blocks; shape (6,)
    noise: FloatArray
    lags: FloatArray  # number of residuals, blocks; their autocovariance, shape (2 + order + 1,)
    clock: FloatArray  # the numbers that :class:`ClockItem` names, shape (11,)
    # products since the estimate was last read, shape (m + 1, m + 1), then their squares and rows
    row: FloatArray
    # a change that is not named yet: CHANGE_DETECTED or CHANGE_BEING_LEARNED, its time and that of
    # its detection, s; variance of the noise before it, its degrees of freedom and spread; blocks
    # that its naming may take; then the information before it, shape (7 + m (m + 1),); before any
    # change, the time of the first part that set the point
    pending: FloatArray
    ladder: Ladder
    cell: FloatArray  # states and their sensitivities, shape (S,)
    rows: FloatArray  # the last rows before whitening, shape (order, m + 1)
    # products of the whitened rows of the block under way, in its segments of 1, 2, 4, … rows at
    # the binary digits of their number, shape (segment_lengths + 1, m + 1, m + 1)
    products: FloatArray
    # samples that wait for others
    reference: FloatArray = field(default_factory=lambda: np.zeros(0))
    response: FloatArray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def empty(cls, network: SensorNetwork, settings: TrackerSettings) -> State:
        """Return the state of a sensor at rest of which nothing is known."""
        m = network.columns
        n = network.order
        p = network.parameters
        return cls(
            np.zeros(m),
            np.zeros((m, m + 1)),
            np.zeros(4 + settings.order),
            np.zeros(settings.order),
            np.zeros(6),
            np.zeros(3 + settings.order),
            _initial_clock(),
            np.zeros((m + 1) ** 2 + 2),
            np.zeros(7 + m * (m + 1)),
            Ladder.empty(settings.levels, m),
            np.zeros(n * (1 + p + n)),
            np.zeros((settings.order, m + 1)),
            np.zeros((settings.segment_lengths + 1, m + 1, m + 1)),
        )

    @property
    def gram(self) -> FloatArray:
        """Return the products of the whitened rows of the block under way, shape (m + 1, m + 1)."""
        count = int(self.block[1])
        return segment_products(self.products, count, np.zeros((0, len(self.products.T))), 0, count)

    def drop_block(self) -> None:
        """Drop the rows of the block under way, and what whitening would look back to."""
        self.block[:] = 0.0
        self.products[:] = 0.0
        self.clock[ClockItem.ROWS_TO_LOOK_BACK] = 0.0

    @property
    def views(self) -> list[FloatArray]:
        """Return views of all numbers but waiting samples, in the order in which they are saved."""
        views = [
            getattr(self, attribute.name)
            for attribute in fields(self)
            if attribute.name not in ("ladder", *WAITING_CHANNELS)
        ]
        views[9:9] = self.ladder.root, self.ladder.gram, self.ladder.meta
        return views

    def save(self) -> bytes:
        """Return the state as little-endian bytes.

        They are a tag, the counts of numbers and of waiting samples of either channel, the numbers
        and samples, and a CRC-32.
        """
        waiting = [getattr(self, name) for name in WAITING_CHANNELS]
        numbers = [np.ravel(view) for view in (*self.views, *waiting)]
        counts = sum(view.size for view in self.views), *(len(channel) for channel in waiting)
        body = (
            struct.pack("<4sIII", FORMAT_TAG, *counts)
            + np.concatenate(numbers).astype("<f8").tobytes()
        )
        return body + struct.pack("<I", binascii.crc32(body))

    def restore(self, saved: bytes) -> None:
        """Take over what :meth:`save` wrote.

        Raises:
            InputError: the bytes are damaged, or of another model, other settings or another
                version.
        """
        intact = (
            len(saved) > HEADER_BYTES
            and binascii.crc32(saved[:-4]) == struct.unpack("<I", saved[-4:])[0]
        )
        tag, *counts = struct.unpack("<4sIII", saved[:HEADER_BYTES]) if intact else (b"", 0, 0, 0)
        needed = sum(view.size for view in self.views)
        size = HEADER_BYTES + 8 * sum(counts) + 4
        if not intact or tag != FORMAT_TAG or counts[0] != needed or len(saved) != size:
            raise InputError(
                "The saved state of the tracker cannot be used.",
                expected=(
                    f"{needed} numbers, saved by this version with the same model and settings"
                ),
                found=f"{counts[0]} numbers" if intact else "damaged data",
                remedy="start anew in another folder",
            )
        numbers = np.frombuffer(saved[HEADER_BYTES:-4], dtype="<f8").astype(float)
        at = 0
        for view in self.views:
            view[...] = numbers[at : at + view.size].reshape(view.shape)
            at += view.size
        for name, count in zip(WAITING_CHANNELS, counts[1:], strict=True):
            setattr(self, name, numbers[at : at + count].copy())
            at += count


@dataclass(frozen=True, eq=False)
class TrackedEstimate:
    """Parameters of a sensor at a moment."""

    time_s: float  # of the moment
    values: NamedNumbers  # name → value
    uncertainty: NamedNumbers  # name → standard uncertainty
    # of the values in the model's order, the reference's uncertainty included, shape (P, P)
    covariance: FloatArray
    # rms of the whitened residual since the last reading, response unit; NaN where nothing moved
    innovation: float
    # names of the parameters that the motion since the last reading determines by itself, apart
    # from the other parameters and better than ± 100 %
    excited: tuple[str, ...]
