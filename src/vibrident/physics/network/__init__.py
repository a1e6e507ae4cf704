"""The paper's network: one layer a sample, weights given by the physics, unrolled in time."""
