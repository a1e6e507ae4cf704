"""A digital calibration certificate: what a laboratory states of it, and the file as a tree."""

from dataclasses import replace

from lxml import etree

from vibrident.export import export

CERTIFICATE = {
    "number": "2025-0815",
    "laboratory": "Laboratory for <Vibration>",
    "laboratory_address": "Road 1\n12345 Town",
    "accreditation": "D-K-00000-01-00",
    "customer": "Customer & Co.",
    "order_number": "A 7",
    "date_of_receipt": "2025-11-01",
    "date_of_calibration": "2025-11-13",
    "date_of_issue": "2025-11-14",
    "temperature_c": 23.1,
    "temperature_uncertainty_c": 0.5,
    "relative_humidity_percent": 45.0,
    "air_pressure_hpa": 1013.2,
    "procedure": "ISO 16063-11, method 3",
    "traceability": "to the SI",
    "instruments": ({"name": "interferometer", "serial_number": "17", "certificate": "PTB 1"}, {"name": "amplifier"}),
    "operator": "A. Operator",
    "approved_by": "B. Head",
    "remarks": ("one", "two"),
}


def certified(result):
    return replace(result, certificate=CERTIFICATE)


def written(result, folder, **more):
    (path,) = export(result, "dcc", folder, country="DE", **more)
    return etree.parse(str(path)).getroot()
