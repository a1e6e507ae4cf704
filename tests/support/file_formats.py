"""Files of the formats that are extras, made by the library of each format."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

Channels = Mapping[str, np.ndarray]
RATE_HZ = 102400.0
START = "2024-01-01T00:00:00"


def tdms(path: Path, channels: Channels, rate_hz: float = RATE_HZ, delays_s: Mapping[str, float] | None = None) -> None:
    from nptdms import ChannelObject, TdmsWriter

    delays_s = delays_s or {}
    waveform = {"wf_increment": 1 / rate_hz, "wf_samples": 1, "wf_start_time": np.datetime64(START)}
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("run", name, values, {**waveform, "wf_start_offset": delays_s.get(name, 0.0)})
                for name, values in channels.items()
            ]
        )


def uff(path: Path, channels: Channels, rate_hz: float = RATE_HZ, *, binary: int = 1, **header: object) -> None:
    """pyuff's mode "overwrite" writes the first set only, so the file begins empty and every set is added."""
    import pyuff

    path.unlink(missing_ok=True)
    file = pyuff.UFF(str(path))
    even, double = header.pop("even", True), header.pop("double", True)
    for name, values in channels.items():
        axes = {f"{axis}_{field}": 0 for axis in ("abscissa", "ordinate", "orddenom", "z_axis") for field in _AXIS}
        labels = {f"{axis}_axis_{field}": "NONE" for axis in ("abscissa", "ordinate") for field in _LABELS}
        labels |= {f"{axis}_{field}": "NONE" for axis in ("orddenom", "z_axis") for field in _LABELS}
        dataset = {
            "type": 58,
            "binary": binary,
            **{f"id{number}": "NONE" for number in range(2, 6)},
            "id1": name,
            "func_type": 1,
            "rsp_node": 7,
            "rsp_dir": -3,
            "ref_node": 0,
            "ref_dir": 0,
            "x": np.arange(values.size) / rate_hz,
            "data": values,
            **axes,
            **labels,
            "abscissa_spec_data_type": 17,
            **header,
        }
        dataset |= {"abscissa_spacing": int(bool(even)), "ord_data_type": 4 if double else 2}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pyuff forgets to close binary files
            file.write_sets(dataset, mode="add", force_double=double)


_AXIS = ("spec_data_type", "len_unit_exp", "force_unit_exp", "temp_unit_exp")
_LABELS = ("lab", "units_lab")


def stream(channels: Channels, rate_hz: float = RATE_HZ):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import obspy

    header = {"network": "XX", "station": "T", "sampling_rate": rate_hz, "starttime": obspy.UTCDateTime(START)}
    return obspy.Stream([obspy.Trace(values, {**header, "channel": name}) for name, values in channels.items()])


def miniseed(path: Path, channels: Channels, rate_hz: float = RATE_HZ) -> None:
    write_seismic(stream(channels, rate_hz), path, "MSEED")


def sac(path: Path, channels: Channels, rate_hz: float = RATE_HZ) -> None:
    write_seismic(stream(channels, rate_hz)[:1], path, "SAC")


def write_seismic(traces, path: Path, name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        traces.write(str(path), format=name)


def mdf(path: Path, channels: Channels, rate_hz: float = RATE_HZ) -> None:
    from asammdf import MDF, Signal

    version = "3.30" if path.suffix == ".mdf" else "4.10"
    with MDF(version=version) as file:
        for name, values in channels.items():
            file.append([Signal(values, np.arange(values.size) / rate_hz, name=name)])
        file.save(path, overwrite=True)


def parquet(path: Path, channels: Channels, rate_hz: float = RATE_HZ) -> None:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table(dict(channels)).replace_schema_metadata({"sampling_rate_hz": repr(rate_hz)})
    pyarrow.parquet.write_table(table, path)


#: File name to what writes such a file; sac keeps the first channel only.
WRITERS: Mapping[str, Callable[..., None]] = {
    "x.tdms": tdms,
    "x.uff": uff,
    "x.mseed": miniseed,
    "x.sac": sac,
    "x.mf4": mdf,
    "x.mdf": mdf,
    "x.parquet": parquet,
}
