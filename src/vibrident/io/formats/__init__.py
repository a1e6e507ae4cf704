"""One data format a file; each holds a :class:`vibrident.io.reader.Reader` in the file's name."""
