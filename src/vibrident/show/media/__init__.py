"""One renderer a medium; text of others is made harmless here and nowhere else."""
