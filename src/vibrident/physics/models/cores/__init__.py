"""One sensor a file; each holds a :class:`vibrident.physics.models.Model` in the file's name."""
