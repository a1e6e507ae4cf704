"""Sensors, one a file, which holds a :class:`vibrident.physics.models.Model` of its name."""
