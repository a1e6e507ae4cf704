"""Samples as they come: chunks of both channels, from records, a growing file, standard input, a device."""
