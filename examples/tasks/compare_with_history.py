"""Compare a calibration with those of earlier years, and ask when the sensor is due again."""

import datetime

import vibrident

with vibrident.History("laboratory.db") as history:
    for year, sensitivity in ((2023, 0.1000), (2024, 0.1001), (2025, 0.1002)):
        true = {"sensitivity": sensitivity, "natural_frequency": 650.0, "damping_ratio": 0.18}
        data = vibrident.simulate(
            ("accelerometer", true),
            frequencies_hz=[100, 160, 400, 650, 1000],
            samples=1000,
            response_noise=1e-3,
            start="steady",
            seed=year,
        )
        date = datetime.date(year, 3, 1)
        history.add(vibrident.identify(data), serial_number="0042", date=date)
    life = history.show("0042", quantity="sensitivity", tolerance=0.01)
for calibration in life["calibrations"]:
    print(calibration["date"], calibration["value"])
print("due:", life["due"])
