"""Provenance of an identification: data files, libraries and packages that add to this one."""

from __future__ import annotations

import datetime
import functools
import platform
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import PurePath
from types import MappingProxyType
from typing import Any

from vibrident.base.participants import participants
from vibrident.base.registry import Registry
from vibrident.base.version import __version__
from vibrident.data.records import Calibration
from vibrident.data.registry import READERS
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.registry import DEPARTURES, ESTIMATORS
from vibrident.physics.models.source import source_of
from vibrident.physics.registry import MODELS

_ALWAYS = ("numpy", "scipy")
#: Packages that read the files of each reader, beside NumPy and SciPy, which are always named.
LIBRARIES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "csv": (),
        "excel": ("openpyxl",),
        "hdf5": ("h5py",),
        "matlab": ("h5py",),
        "mdf": ("asammdf",),
        "miniseed": ("obspy",),
        "parquet": ("pyarrow",),
        "sac": ("obspy",),
        "tdms": ("npTDMS",),
        "uff": ("pyuff",),
        "wav": ("soundfile",),
    }
)


def provenance(fitted: Fitted) -> dict[str, Any]:
    """Return versions, files and time of an identification, as plain values."""
    evidence = fitted.evidence
    calibration = evidence.calibration
    sources = [record.provenance for record in evidence.records or calibration.records]
    if calibration.table is not None:
        sources = [calibration.table.provenance]
    readers = _readers(source.file for source in sources)
    read_by = {name for reader in readers for name in LIBRARIES.get(reader, ())}
    packages = _plug_ins(fitted, readers)
    model = evidence.model.core
    return {
        "vibrident": __version__,
        "python": platform.python_version(),
        "libraries": {
            package: _version(package) for package in (*_ALWAYS, *sorted(participants() | read_by))
        },
        **({"plug_ins": packages} if packages else {}),
        **({"model": source_of(model)} if MODELS.is_registered(model.name) else {}),
        "calibration_file": calibration.source,
        "files": [
            *(
                {"file": source.file, "sha256": source.sha256, "history": list(source.history)}
                for source in sources
            ),
            *_known_files(calibration),
        ],
        "seed": None,
        "time": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def _known_files(calibration: Calibration) -> Iterator[dict[str, Any]]:
    """Yield the files that state known responses of the channels."""
    for channel, known in calibration.known_responses.items():
        for name, sha256 in known.files:
            yield {"file": name, "sha256": sha256, "history": [f"known response of the {channel}"]}


def _readers(files: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the readers of these files; those of other packages are asked last."""
    endings = {PurePath(file).suffix.lower() for file in files} - {""}
    names: list[str] = []
    readers = READERS.one_by_one()
    while endings and (reader := next(readers, None)) is not None:
        if endings & set(reader.endings):
            names.append(reader.name)
            endings -= set(reader.endings)
    return tuple(names)


def _plug_ins(fitted: Fitted, readers: Iterable[str]) -> dict[str, str]:
    """Return the package, with its version, of each part that another package added, by name."""
    return {
        name: package
        for registry, name in _taking_part(fitted, readers)
        if (package := registry.package_of(name))
    }


def _taking_part(fitted: Fitted, readers: Iterable[str]) -> Iterator[tuple[Registry[Any], str]]:
    """Yield the parts of the model, the estimator, the readers, and every departure tested."""
    parts = fitted.evidence.model.name.split("+")
    yield from ((MODELS, part.partition(":")[0]) for part in parts)
    yield ESTIMATORS, fitted.estimate.estimator
    yield from ((READERS, name) for name in readers)
    if fitted.estimate.findings.decays is None:  # free decays have tests of their own
        yield from ((DEPARTURES, name) for name in DEPARTURES.names())


@functools.cache  # reading a package's metadata takes time
def _version(package: str) -> str:
    """Return the version of a package, or ``unknown``."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
