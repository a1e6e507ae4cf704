"""Parts in series or parallel to a sensor, one a file; each holds a :class:`vibrident.physics.models.base.AddOn`."""
