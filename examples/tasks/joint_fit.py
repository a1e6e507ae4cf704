"""Identify one sensor from two calibrations at once: by sine and by shock."""

import vibrident

sine = vibrident.simulate(
    frequencies_hz=[100, 200, 400], samples=2000, response_noise=1e-3, start="steady", seed=1
)
shock = vibrident.simulate("paper", "shock", samples=2000, response_noise=1e-3, seed=2)
by_sine, by_shock = vibrident.identify_together([sine, shock])
alone = vibrident.identify(sine)
for name in ("sensitivity", "natural_frequency", "damping_ratio"):
    before, after = (result.parameters[name].standard_uncertainty for result in (alone, by_sine))
    print(f"{name}: u = {before:.2g} by sine alone, {after:.2g} together")
