"""Identify a production lot: one table, a row a sensor."""

import vibrident

for number in range(3):
    true = {"sensitivity": 0.1 + 0.001 * number, "natural_frequency": 650.0, "damping_ratio": 0.18}
    sensor = vibrident.simulate(
        ("accelerometer", true),
        frequencies_hz=[100, 160, 400, 650, 1000],
        samples=1000,
        response_noise=1e-3,
        start="steady",
        seed=number,
    )
    sensor.save(f"lot/{number:03}")

fleet = vibrident.Fleet("lot", "fleet", model="accelerometer")
outcome = fleet.identify(workers=1)
print(fleet.to_dataframe()[["calibration", "status", "sensitivity", "sensitivity_u"]])
print("computed:", outcome.computed)
