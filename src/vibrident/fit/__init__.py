"""Estimation, from data to result: ``identification`` is the path on one screen."""
