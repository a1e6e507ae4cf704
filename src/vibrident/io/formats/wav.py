"""WAV files: one column a channel, full scale is 1."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vibrident.io.allowance import require_room
from vibrident.io.columns import Clock, ColumnFile, unreadable
from vibrident.io.reader import Reader
from vibrident.records import FloatArray

_EXPECTED = "a WAV file of PCM or floating-point samples"
#: libsndfile's names. A .wav file may hold MP3 or coded speech, which are not measured signals.
_CONTAINERS = ("WAV", "WAVEX", "RF64", "W64")
_SAMPLES = ("PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE")


class WavFile(ColumnFile):
    """A WAV file. Integer samples become float64 in [−1, 1); float samples stay as they are."""

    def __init__(self, path: Path) -> None:
        """Read the header.

        Raises:
            InputError: the file is not a WAV file.
        """
        import soundfile

        self._path = path
        try:
            path.open("rb").close()  # the system's error is clearer than libsndfile's
            header = soundfile.info(str(path))
            if header.format not in _CONTAINERS or header.subtype not in _SAMPLES:
                raise ValueError(f"{header.format} with samples of type {header.subtype}")
        except (OSError, RuntimeError, ValueError, TypeError) as error:
            raise unreadable(str(path), error, _EXPECTED) from error
        self._channels = int(header.channels)
        self._rate_hz = float(header.samplerate)
        self._frames = int(header.frames)

    @property
    def file(self) -> str:
        """Name of the file in messages."""
        return str(self._path)

    @property
    def names(self) -> tuple[str, ...]:
        """The names are "channel 1", "channel 2" and so on."""
        return tuple(f"channel {number}" for number in range(1, self._channels + 1))

    @property
    def numbered(self) -> tuple[int, ...]:
        """All channels."""
        return tuple(range(self._channels))

    def clock(self, position: int) -> Clock:
        """Samples per second, from the file's header."""
        return Clock(self._rate_hz)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these channels; each has shape (samples,).

        Raises:
            InputError: the file is damaged.
        """
        import soundfile

        require_room(self._path, self._frames * self._channels)
        try:
            samples, _ = soundfile.read(str(self._path), dtype="float64", always_2d=True)
        except (OSError, RuntimeError, ValueError, TypeError) as error:
            raise unreadable(self.file, error, _EXPECTED) from error
        return tuple(np.array(samples[:, position], dtype=np.float64) for position in positions)

    def length(self, position: int) -> int:
        """Number of samples, from the file's header."""
        return self._frames

    def block(self, positions: Sequence[int], start: int, stop: int) -> FloatArray:
        """Samples of channels from ``start`` up to ``stop``; nothing else is read. See ColumnFile."""
        import soundfile

        try:
            samples, _ = soundfile.read(str(self._path), start=start, stop=stop, dtype="float64", always_2d=True)
        except (OSError, RuntimeError, ValueError, TypeError) as error:
            raise unreadable(self.file, error, _EXPECTED) from error
        return np.ascontiguousarray(samples[:, list(positions)].T, dtype=np.float64)

    def locate(self, position: int, row: int) -> str:
        """File, channel and sample of a value."""
        return f"{self.file}, {self.names[position]}, sample {row + 1}"


WAV = Reader(name="wav", title="WAV audio", endings=(".wav",), open=WavFile)
