"""Identify a sensor by a model of your own: its response as a formula of s."""

import numpy as np

import vibrident

hydrophone = vibrident.Model(
    "piezo-hydrophone",
    lambda s, sensitivity, corner: sensitivity * s / (s + 2 * np.pi * corner),
    [vibrident.ParameterSpec("sensitivity", "V/Pa"), vibrident.ParameterSpec("corner", "Hz")],
)
hz = np.geomspace(1.0, 1000.0, 40)
response = hydrophone.response(2j * np.pi * hz, sensitivity=2e-4, corner=25.0)
table = vibrident.ResponseTable(
    hz, np.abs(response), np.angle(response), 0.002 * np.abs(response), np.full(40, 0.002)
)
calibration = vibrident.Calibration(table=table, quantity="drive", reference_unit="Pa")
result = vibrident.identify(calibration, model=hydrophone)
print(result.summary())
