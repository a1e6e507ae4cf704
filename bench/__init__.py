"""Benchmarks of vibrident: ``python -m bench``.

Every figure is a ratio taken in one run, beside its target.
"""
