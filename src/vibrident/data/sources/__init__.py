"""Sources of samples in chunks: records, a growing file, standard input, a device."""
