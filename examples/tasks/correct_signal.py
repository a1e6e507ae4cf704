"""Restore the acceleration behind a measured shock, with its uncertainty."""

import numpy as np

import vibrident

tones = [50, 100, 200, 400, 650, 1000]
calibration = vibrident.simulate(frequencies_hz=tones, samples=2000, response_noise=1e-3)
result = vibrident.identify(calibration)

measured = vibrident.simulate("paper", "shock", samples=4000, response_noise=1e-3, seed=2).records[
    0
]
event = vibrident.Calibration.from_arrays(
    None, measured.response, measured.sampling_rate_hz, excitation="decay"
)
restored = vibrident.correct(result, event).corrections[0]
at = np.nanargmax(np.abs(restored.acceleration))
peak, u = restored.acceleration[at], restored.standard_uncertainty[at]
print(f"peak {peak:.4g} m/s², U = {2 * u:.2g} m/s² (k = 2)")
print(f"true {np.max(measured.reference):.4g} m/s²")
