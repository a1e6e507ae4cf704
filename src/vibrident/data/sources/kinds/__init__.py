"""Sources of samples; each file holds a :class:`vibrident.data.sources.source.Source`."""
