"""The noise of a fit: the incoherent component of a residual, and the noise of the reference in it."""
