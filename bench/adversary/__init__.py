"""Sensors, motions and defects from an exact simulator of its own, against what the package says of them."""
