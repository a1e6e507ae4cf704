"""Estimators, one a file.

Each module holds a :class:`vibrident.fit.estimators.base.Estimator` in the file's name.
"""
