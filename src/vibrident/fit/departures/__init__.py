"""What departs from a fit: columns that a departure adds to the response, and one score test for all."""
