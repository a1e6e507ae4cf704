"""Many sensors, and their years."""
