"""Departures from a fit: the columns that each adds to the response, and one score test for all."""
