"""Key of a calibration: a hash of all that its outcome depends on, but not of its location."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, NamedTexts
from vibrident.data.io.calibration_file import CalibrationFile, read_calibration_file
from vibrident.data.io.known_files import known_files
from vibrident.data.io.reader import sha256
from vibrident.data.io.record_files import data_files
from vibrident.data.io.toml_text import read_toml
from vibrident.lab.fleet.orders import Orders

SCHEMA = "vibrident.fleet/1"
#: In place of the hash of a file that is missing or not readable: the key changes once it can be
#: read.
_ABSENT = "absent"


@dataclass(frozen=True)
class Fingerprint:
    """Calibration before it is read."""

    # SHA-256, as hexadecimal digits, of the calibration file, the names and hashes of its data
    # files, the settings and the version
    key: str
    shape: str  # equal for calibrations that take about the same time
    calibration: bool = True  # False for a TOML file that is no calibration file
    exists: bool = True  # False if the file does not exist


def fingerprint(path: str, orders: Orders) -> Fingerprint:
    """Hash a calibration's files.

    A file that cannot be used has a key too, and is refused when it is read.
    """
    file = Path(path)
    if not file.is_file():
        return Fingerprint(_key(file, [], orders), "not readable", exists=file.exists())
    try:
        document = read_calibration_file(file)
    except InputError:
        return Fingerprint(
            _key(file, [], orders), "not readable", calibration=_may_be_calibration(file)
        )
    try:
        names = data_files(document, file.parent, path)
    except InputError:  # a glob that matches nothing
        names = []
    names += known_files(document)
    return Fingerprint(_key(file, names, orders), _shape(document, file.parent, names))


def sensor_text(path: str) -> NamedTexts:
    """Return the sensor section of a calibration file, as far as it can be read.

    The file may be unusable otherwise.
    """
    section = _toml(Path(path)).get("sensor")
    plain = section if isinstance(section, Mapping) else {}
    return {
        str(key): str(value) for key, value in plain.items() if not isinstance(value, list | dict)
    }


def _key(file: Path, names: list[str], orders: Orders) -> str:
    digest = _digest(file)
    content = {
        "schema": SCHEMA,
        "settings": orders.settings,
        "calibration": digest,
        "data": [[name, _digest(file.parent / name)] for name in names],
        "place": os.path.abspath(file)
        if digest == _ABSENT
        else "",  # two unreadable files must not have the same key
    }
    return hashlib.sha256(
        json.dumps(content, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()


def _digest(path: Path) -> str:
    if not path.is_file():  # reading a pipe or a device may never end
        return _ABSENT
    try:
        return sha256(path)
    except InputError:
        return _ABSENT


def _shape(document: CalibrationFile, folder: Path, names: list[str]) -> str:
    size = sum(os.path.getsize(folder / name) for name in names if os.path.isfile(folder / name))
    kinds = {entry.excitation for entry in document.records} or {"table"}
    endings = {Path(name).suffix.lower() for name in names}
    numbers = [
        document.sensor.model,
        *sorted(kinds),
        *sorted(endings),
        len(names),
        round(math.log2(size + 1)),
    ]
    return " ".join(str(number) for number in numbers)


def _may_be_calibration(file: Path) -> bool:
    """Return whether an invalid file was meant as a calibration file."""
    document = _toml(file)
    return not document or bool(document.keys() & CalibrationFile.model_fields.keys())


def _toml(file: Path) -> Fields:
    """Return the keys of a TOML file; empty if it cannot be read."""
    try:
        return read_toml(file)
    except InputError:
        return {}
