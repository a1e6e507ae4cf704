"""Render for one medium a module; foreign text is escaped here and nowhere else."""
