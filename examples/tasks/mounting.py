"""Tell a mounting's resonance from the sensor's by two mountings, and predict a third."""

import vibrident

sensor = {"sensitivity": 1e-3, "natural_frequency": 45e3, "damping_ratio": 0.02}


def calibration(mounting_hz: float, seed: int) -> vibrident.Calibration:
    """Return a calibration on a coupling with this mounting frequency."""
    mounting = {"mounting_frequency": mounting_hz, "mounting_damping": 0.03}
    return vibrident.simulate(
        ("accelerometer+mounting:0.1", sensor | mounting),
        frequencies_hz=[1e3, 5e3, 10e3, 15e3, 20e3, 25e3, 30e3, 35e3, 40e3],
        sampling_rate_hz=204800.0,
        samples=4000,
        response_noise=1e-3,
        seed=seed,
    )


glued, waxed = vibrident.identify_together([calibration(60e3, 1), calibration(30e3, 2)])
print(waxed.summary())
stiffer = vibrident.predict_mounted(waxed, stiffness=1.5, frequencies_hz=[10e3])
print(f"At 10 kHz the sensitivity changes by {100 * stiffer.change[0]:.1f} %.")
