"""Files in, files out: the calibration file, one reader a data format, and a writer.

``read`` gives a Calibration in physical units, ``read_guarded`` the same from a process of its own,
``describe`` its summary, ``write_calibration`` the files back.
Libraries for the formats are loaded when a file of that format is opened.
"""

from vibrident.data.io.reading import GivenCalibration, as_calibration, read, read_guarded
from vibrident.data.io.writer import write_calibration
from vibrident.data.records.calibration import describe

__all__ = [
    "GivenCalibration",
    "as_calibration",
    "describe",
    "read",
    "read_guarded",
    "write_calibration",
]
