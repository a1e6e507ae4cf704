"""A sensor model, an estimator, a reader and an export for vibrident."""
