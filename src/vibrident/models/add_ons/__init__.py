"""What stands behind or beside a sensor, one a file; each holds a :class:`vibrident.models.base.AddOn`."""
