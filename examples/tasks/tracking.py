"""Follow a sensor after its calibration, block by block, and hear when it changes."""

import vibrident

new = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
aged = {**new, "sensitivity": 0.098}


def motion(parameters, seed):
    """Return 0.6 s of random motion, and the sensor's response to it, as a calibration."""
    options = {"samples": 12000, "sampling_rate_hz": 20e3, "response_noise": 1e-2, "seed": seed}
    return vibrident.simulate(("accelerometer", parameters), "random", antialias=True, **options)


tracker = vibrident.SensorTracker(vibrident.identify(motion(new, 1)), sampling_rate_hz=20e3)
for seed, parameters in enumerate((new, new, aged, aged), start=2):
    block = motion(parameters, seed).records[0]
    tracker.feed(block.reference, block.response, new_record=True)
print(tracker.finish().values)
for alarm in tracker.alarms:
    print(f"{alarm.time_s:.2f} s: {alarm.parameter} {alarm.before:.4g} → {alarm.after:.4g}")
