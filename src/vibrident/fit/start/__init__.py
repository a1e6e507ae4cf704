"""Where a fit begins: a search in the nonparametric response, from everywhere at once."""
