"""Start values of a fit: a grid at the exact bins of records, or a search in a response."""
