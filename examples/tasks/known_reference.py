"""Identify with a reference accelerometer that is no ideal one: its certificate is a table."""

import numpy as np

import vibrident

simulated = vibrident.simulate("paper", "random", samples=4000, response_noise=1e-3, seed=1)
motion, rate_hz = simulated.records[0].reference, simulated.records[0].sampling_rate_hz
spectrum_hz = np.fft.rfftfreq(motion.size, 1 / rate_hz)
true = 0.01 / (1 - (spectrum_hz / 60e3) ** 2)  # V per m/s²: a resonance at 60 kHz
volt = np.fft.irfft(np.fft.rfft(motion) * true, motion.size)

hz = np.geomspace(1.0, 0.5 * rate_hz, 80)  # the certificate
stated = 0.01 / (1 - (hz / 60e3) ** 2)
reference_channel = vibrident.KnownResponse.from_table(
    hz, stated, np.zeros(80), magnitude_uncertainty=0.002 * stated, channel_unit="V"
)
response = simulated.records[0].response
calibration = vibrident.Calibration.from_arrays(
    volt, response, rate_hz, excitation="random", reference_known_response=reference_channel
)
print(vibrident.identify(calibration).summary())
