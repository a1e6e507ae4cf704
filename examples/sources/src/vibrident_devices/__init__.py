"""Sources of samples for ``vibrident track``."""
