"""One sensor a file; each holds a :class:`vibrident.models.base.Core` in the file's name."""
