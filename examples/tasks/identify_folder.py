"""Identify a sensor from a folder: a calibration file and the data files that it names."""

import vibrident

# Stands for your own folder: CSV files, and a calibration.toml that says what their columns are.
simulated = vibrident.simulate(
    frequencies_hz=[100, 200, 400, 650, 1000], samples=2000, response_noise=1e-3, start="steady"
)
simulated.save("bench")

result = vibrident.identify("bench/calibration.toml", model="accelerometer")
print(result.summary())
result.save("bench/result.json")
