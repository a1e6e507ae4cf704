"""vibrident: from calibration records to a vibration sensor's dynamic model, with uncertainty."""

__version__ = "0.1.0"
