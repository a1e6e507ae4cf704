"""Plan a calibration: which five frequencies tell most, and what uncertainty to expect."""

import vibrident

plan = vibrident.plan(
    "accelerometer",
    {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182},
    frequencies_hz=vibrident.one_third_octave(20.0, 2000.0),
    recording=vibrident.Recording(sampling_rate_hz=51200.0, samples=4000, response_noise=1e-3),
    best=5,
    repeats=True,
)
for frequency_hz, times in zip(plan.frequency_hz, plan.uses):
    print(f"{frequency_hz:.1f} Hz × {times}")
for name, parameter in plan.parameters.items():
    print(f"{name}: u = {parameter.standard_uncertainty:.2g} {parameter.unit}")
