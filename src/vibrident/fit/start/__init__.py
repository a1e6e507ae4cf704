"""Start values of a fit: a grid at the exact bins of records, a search in a response for the rest."""
