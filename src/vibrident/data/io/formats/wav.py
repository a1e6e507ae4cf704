"""WAV and FLAC files: one column a channel. They state a rate, and what full scale is not."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vibrident.data.io.columns import Channel, Clock, ColumnFile, Positions, reading
from vibrident.data.io.reader import Reader
from vibrident.data.records import FloatArray

#: libsndfile's names. A .wav file may hold MP3 or coded speech, which are not measured signals.
_CONTAINERS = ("WAV", "WAVEX", "RF64", "W64", "FLAC")
_FLOATING_POINT = ("FLOAT", "DOUBLE")
_SAMPLES = ("PCM_S8", "PCM_U8", "PCM_16", "PCM_24", "PCM_32", *_FLOATING_POINT)
#: Unit of integer samples: no physical one before a scale.
FULL_SCALE = "full scale"
_PIECE_FRAMES = 1 << 18  # that are read at once
_MAX_STATED_BYTES = 0x7FFF_0000  # a larger size is that of a stream, whose writer did not know it


class WavFile(ColumnFile):
    """A file of "channel 1", "channel 2" and so on.

    Integer samples become float64 in [−1, 1), in parts of the full scale; floating-point ones stay,
    in a unit that the file does not state.
    """

    expected = "a WAV or FLAC file of PCM or floating-point samples"

    def __init__(self, path: Path) -> None:
        import soundfile

        with reading(path, self.expected):
            header = soundfile.info(str(path))
            if header.format not in _CONTAINERS or header.subtype not in _SAMPLES:
                raise ValueError(f"{header.format} with samples of type {header.subtype}")
            with path.open("rb") as stream:
                kind, size = struct.unpack("<4sI", stream.read(8))
            file_bytes = path.stat().st_size
            if kind == b"RIFF" and file_bytes < size + 8 < _MAX_STATED_BYTES:
                raise ValueError(f"the file ends at byte {file_bytes} of {size + 8}")
        clock = Clock(float(header.samplerate))
        frames = int(header.frames)
        unit = "" if header.subtype in _FLOATING_POINT else FULL_SCALE
        channels = [
            Channel(f"channel {number + 1}", number, clock, samples=frames, unit=unit)
            for number in range(int(header.channels))
        ]
        super().__init__(path, channels, {})

    def _read(self, handles: Positions) -> Sequence[FloatArray]:
        values = [np.empty(self.length(0)) for _ in handles]
        self._read_frames(handles, values, 0, self.length(0))
        return values

    def block(self, positions: Positions, start: int, stop: int) -> FloatArray:
        """Return samples of channels from ``start`` up to ``stop``; nothing else is read.

        See ColumnFile.
        """
        values = np.empty((len(positions), stop - start))
        self._read_frames(positions, [*values], start, stop)
        return values

    def reads_parts(self, position: int) -> bool:
        """Return True: frames are found by their number."""
        return True

    def _read_frames(
        self, positions: Positions, targets: Sequence[FloatArray], start: int, stop: int
    ) -> None:
        """Read samples of channels into ``targets``; ValueError where the file ends early."""
        import soundfile

        with reading(self._path, self.expected), soundfile.SoundFile(str(self._path)) as file:
            file.seek(start)
            for begin in range(0, stop - start, _PIECE_FRAMES):
                frames = min(_PIECE_FRAMES, stop - start - begin)
                samples = file.read(frames, dtype="float64", always_2d=True)
                if len(samples) < frames:
                    raise ValueError(f"the samples end at {start + begin + len(samples)}")
                for position, target in zip(positions, targets, strict=True):
                    target[begin : begin + frames] = samples[:, position]

    def locate(self, position: int, row: int) -> str:
        """Return file, channel and sample of a value."""
        return f"{self.file}, {self.names[position]}, sample {row + 1}"


WAV = Reader(name="wav", title="WAV and FLAC audio", endings=(".wav", ".flac"), open=WavFile)
