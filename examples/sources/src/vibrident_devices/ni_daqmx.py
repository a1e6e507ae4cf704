"""Analogue inputs of a device of NI-DAQmx, real or simulated: column 1 is ai0, in volts.

    vibrident track result.json calibration.toml --source ni-daqmx=Dev1

Ends with Ctrl-C.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vibrident import InputError
from vibrident.data.sources.source import Chunk, Source, SourceRequest
from vibrident_devices.channels import PIECE_S, check_rate, chunk, numbers

BUFFER_S = 10.0  # seconds that the driver keeps
WAIT_S = 10.0  # for a chunk, at most


def _open(wanted: SourceRequest) -> Iterator[Chunk]:
    try:
        import nidaqmx
        from nidaqmx.constants import AcquisitionType
        from nidaqmx.errors import Error
        from nidaqmx.stream_readers import AnalogMultiChannelReader
    except ImportError as error:
        raise InputError(
            "There is no NI-DAQmx.",
            expected="nidaqmx",
            found=str(error),
            remedy="pip install nidaqmx",
        ) from error
    places = numbers(wanted)
    try:
        task = nidaqmx.Task()
    except Error as error:
        raise _refused(wanted, error) from error
    try:
        for channel in places:
            task.ai_channels.add_ai_voltage_chan(f"{wanted.address or 'Dev1'}/ai{channel - 1}")
        buffer_samples = round(BUFFER_S * wanted.rate_hz)
        task.timing.cfg_samp_clk_timing(
            wanted.rate_hz, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=buffer_samples
        )
        check_rate(wanted, float(task.timing.samp_clk_rate))
        task.start()
    except Error as error:
        task.close()
        raise _refused(wanted, error) from error
    except InputError:
        task.close()
        raise
    return _read(wanted, task, AnalogMultiChannelReader(task.in_stream), Error)


def _read(wanted: SourceRequest, task, reader, failed: type[Exception]) -> Iterator[Chunk]:
    count = max(1, round(PIECE_S * wanted.rate_hz))
    with task:
        try:
            while True:
                samples = np.empty((2, count))
                reader.read_many_sample(samples, count, WAIT_S)
                yield chunk(wanted, samples[0], samples[1], separate=False)
        except KeyboardInterrupt:
            return
        except (
            failed
        ) as error:  # samples that were overwritten are lost: the driver says so and ends
            raise _refused(wanted, error) from error


def _refused(wanted: SourceRequest, error: Exception) -> InputError:
    return InputError(
        "The device cannot be read.",
        expected="the driver NI-DAQmx, and a device of it",
        found=str(error).splitlines()[0],
        where=wanted.address or "Dev1",
        remedy="install the driver and give the device's name; NI's tools can make a simulated one",
    )


NI_DAQMX = Source("ni-daqmx", "analogue inputs of NI-DAQmx, real or simulated", _open)
