"""One estimator a file; each holds an :class:`vibrident.estimators.base.Estimator` in the file's name."""
