"""Departures, one a file."""
