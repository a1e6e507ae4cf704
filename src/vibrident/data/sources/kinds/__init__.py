"""One source a file; each holds a :class:`vibrident.data.sources.source.Source` in the file's name."""
