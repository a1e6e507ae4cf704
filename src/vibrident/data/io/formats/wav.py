"""WAV files: one column a channel, full scale is 1."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vibrident.data.io.columns import Channel, Clock, ColumnFile, reading, require_room
from vibrident.data.io.reader import Reader
from vibrident.data.records import FloatArray

_EXPECTED = "a WAV file of PCM or floating-point samples"
#: libsndfile's names. A .wav file may hold MP3 or coded speech, which are not measured signals.
_CONTAINERS = ("WAV", "WAVEX", "RF64", "W64")
_SAMPLES = ("PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE")


class WavFile(ColumnFile):
    """A WAV file of "channel 1", "channel 2" and so on. Integer samples become float64 in [−1, 1); float ones stay."""

    def __init__(self, path: Path) -> None:
        import soundfile

        with reading(path, _EXPECTED):
            header = soundfile.info(str(path))
            if header.format not in _CONTAINERS or header.subtype not in _SAMPLES:
                raise ValueError(f"{header.format} with samples of type {header.subtype}")
        clock, self._frames = Clock(float(header.samplerate)), int(header.frames)
        numbers = range(1, int(header.channels) + 1)
        super().__init__(
            path, [Channel(f"channel {number}", number - 1, clock) for number in numbers], {}
        )

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these channels; each has shape (samples,)."""
        with reading(self._path, _EXPECTED):
            require_room(self._path, self._frames * len(self._channels))
        return tuple(channel.copy() for channel in self.block(positions, 0, self._frames))

    def length(self, position: int) -> int:
        """Number of samples, from the file's header."""
        return self._frames

    def block(self, positions: Sequence[int], start: int, stop: int) -> FloatArray:
        """Samples of channels from ``start`` up to ``stop``; nothing else is read. See ColumnFile."""
        import soundfile

        with reading(self._path, _EXPECTED):
            samples, _ = soundfile.read(
                str(self._path), start=start, stop=stop, dtype="float64", always_2d=True
            )
        return np.ascontiguousarray(samples[:, list(positions)].T, dtype=np.float64)

    def locate(self, position: int, row: int) -> str:
        """File, channel and sample of a value."""
        return f"{self.file}, {self.names[position]}, sample {row + 1}"


WAV = Reader(name="wav", title="WAV audio", endings=(".wav",), open=WavFile)
