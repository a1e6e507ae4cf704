"""From a start to the optimum: Levenberg and Marquardt, reweighted by the noise; the covariance there."""
