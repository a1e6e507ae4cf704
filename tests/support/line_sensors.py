"""Sensors that the network at the lines is tried with: cores and add-ons."""

SENSORS = {
    "accelerometer": {"sensitivity": 0.104, "natural_frequency": 352.0, "damping_ratio": 0.182},
    "velocity-pickup": {"generator_constant": 28.0, "natural_frequency": 45.0, "damping_ratio": 0.56},
}
ADDED = {
    "delay": {"delay": 137e-6},
    "highpass": {"highpass_frequency": 12.0},
    "mode2": {"mode2_frequency": 1800.0, "mode2_damping": 0.03, "mode2_gain": 0.04},
}


def values_of(model):
    core, *add_ons = model.split("+")
    return {**SENSORS[core], **{name: v for addon in add_ons for name, v in ADDED[addon].items()}}
