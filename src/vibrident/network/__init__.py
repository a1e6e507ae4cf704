"""The paper's network: one layer a sample, weights that are the physics, unrolled in time."""
