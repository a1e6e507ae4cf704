"""One sensor a file; each holds a :class:`vibrident.physics.models.base.Core` in the file's name."""
