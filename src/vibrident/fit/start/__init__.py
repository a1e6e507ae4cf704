"""Start values of a fit: a search in the nonparametric response, from everywhere at once."""
