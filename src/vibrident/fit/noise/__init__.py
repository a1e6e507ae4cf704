"""The noise of a fit: the incoherent component of a residual, and what the reference adds."""
