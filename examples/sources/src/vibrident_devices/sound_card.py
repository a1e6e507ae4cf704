"""A sound card by PortAudio; a USB accelerometer is one. Channels are columns, full scale is one.

    vibrident track result.json calibration.toml --source sound-card            the default input
    vibrident track result.json calibration.toml --source sound-card="Digiducer"

Ends with Ctrl-C.
"""

from __future__ import annotations

from collections.abc import Iterator

from vibrident import InputError
from vibrident.data.sources.source import Chunk, Source, SourceRequest
from vibrident_devices.channels import PIECE_S, check_rate, chunk, numbers


def _open(wanted: SourceRequest) -> Iterator[Chunk]:
    try:
        import sounddevice
    except (ImportError, OSError) as error:
        raise InputError(
            "There is no sound card to be read.",
            expected="sounddevice, and the library PortAudio",
            found=str(error),
            remedy="pip install sounddevice; on Debian also apt-get install libportaudio2",
        ) from error
    reference, response = numbers(wanted)
    device = int(wanted.address) if wanted.address.isdecimal() else wanted.address or None
    try:
        stream = sounddevice.InputStream(
            samplerate=wanted.rate_hz,
            device=device,
            channels=max(reference, response),
            dtype="float32",
        )
    except (sounddevice.PortAudioError, ValueError) as error:
        raise InputError(
            "The sound card cannot be opened.",
            expected=f"{max(reference, response)} channels at {wanted.rate_hz:g} Hz",
            found=str(error),
            where=wanted.address or "default device",
            remedy="`python -m sounddevice` lists the devices",
        ) from error
    check_rate(wanted, float(stream.samplerate))
    return _read(wanted, stream, reference - 1, response - 1)


def _read(wanted: SourceRequest, stream, reference: int, response: int) -> Iterator[Chunk]:
    with stream:
        try:
            while True:
                samples, overflowed = stream.read(max(1, round(PIECE_S * wanted.rate_hz)))
                pair = samples[:, reference].astype(float), samples[:, response].astype(float)
                yield chunk(wanted, *pair, separate=overflowed)
        except KeyboardInterrupt:
            return


SOUND_CARD = Source("sound-card", "a sound card, or a USB accelerometer that is one", _open)
