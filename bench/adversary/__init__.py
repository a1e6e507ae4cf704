"""Sensors, motions and defects from an exact simulator, against what the package says of them."""
