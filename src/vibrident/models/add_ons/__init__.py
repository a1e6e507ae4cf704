"""Parts in series with or parallel to a sensor, one per file; each holds a :class:`vibrident.models.base.AddOn`."""
