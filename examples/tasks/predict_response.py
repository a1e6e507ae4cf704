"""Predict what an identified sensor answers to another motion, and compare with what it did."""

import vibrident

tones = [50, 100, 200, 400, 650, 1000]
calibration = vibrident.simulate(frequencies_hz=tones, samples=2000, response_noise=1e-3)
result = vibrident.identify(calibration)

sweep = vibrident.simulate("paper", "sweep", samples=4000, response_noise=1e-3, seed=2)
prediction = vibrident.predict(result, sweep).predictions[0]
print(f"rmse {prediction.rmse:.3g} V, {prediction.nrmse:.2%} of the response")
