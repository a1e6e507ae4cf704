"""Parts in series with or parallel to a sensor, one a file.

Each file holds a :class:`vibrident.physics.models.base.AddOn`.
"""
