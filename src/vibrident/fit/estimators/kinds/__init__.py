"""One estimator a file; each holds an :class:`vibrident.fit.estimators.base.Estimator` in the file's name."""
