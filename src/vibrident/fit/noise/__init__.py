"""The noise of a fit: what of a residual is incoherent with the prediction, and what of it is the reference's."""
