"""Export a sensor as C99: a filter that predicts its response and one that takes it out."""

import vibrident

tones = [50, 100, 200, 400, 650, 1000]
calibration = vibrident.simulate(frequencies_hz=tones, samples=2000, response_noise=1e-3)
result = vibrident.identify(calibration)
files = vibrident.export(result, "c", "firmware", rate_hz=12800.0, band_hz=(10.0, 1000.0))
for file in files:
    print(file, len(file.read_text(encoding="utf-8").splitlines()), "lines")
