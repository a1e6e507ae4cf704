"""Descent from a start to the optimum, reweighted by the noise; the covariance there."""
