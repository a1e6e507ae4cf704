"""Load a real example: the SM-3 seismometer.

VIBRIDENT_DATA names a folder that holds its recordings (``sm3/``).
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

#: What is told beside the data.
STORY = (
    "A real SM-3 seismometer: a current through the calibration coil drives the mass, a laser "
    "looks at it, one file a frequency. The header of the files lies: “FuncGen” is the drive and "
    "“Laser” the laser, but “SM-3 Z” is a dead channel. The program of those who recorded it "
    "printed a damping of 0.775; its formula lacks a square. See what comes out here, and whether "
    "a linear model explains a sensor whose natural frequency moves with the amplitude."
)
# Hz; where the laser is within its range
_FREQUENCIES = ("0_3", "0_4", "0_5", "0_6", "0_8", "1_0", "2_0", "3_0")
_DESCRIPTION = """[sensor]
manufacturer = "SM-3"
type = "electrodynamic seismometer, vertical"
serial_number = "SN001"
model = "accelerometer+delay"

[reference]
column = 3                      # the drive voltage
quantity = "drive"
scale = 0.9425e-6               # V per count
unit = "V"

[response]
column = 5                      # displacement of the mass relative to the frame
scale = 0.95066e-9              # m per count
unit = "m"

[sampling]
time_column = "Seconds"

[[records]]
file = "*Hz.csv"
excitation = "sine"
"""


def real_data() -> Path | None:
    """Return the folder of the recordings; None where they are not available."""
    named = os.environ.get("VIBRIDENT_DATA")
    folder = Path(named) / "sm3" if named else None
    return (
        folder
        if folder and all((folder / f"{name}Hz.csv").is_file() for name in _FREQUENCIES)
        else None
    )


def write_real(source: Path, folder: Path) -> None:
    """Copy the recordings into a folder, with the calibration file of their columns."""
    for name in _FREQUENCIES:
        shutil.copyfile(source / f"{name}Hz.csv", folder / f"{name}Hz.csv")
    (folder / "calibration.toml").write_text(_DESCRIPTION, encoding="utf-8")
