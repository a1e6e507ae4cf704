"""The paper's network: one layer a sample, weights given by the physics, unrolled in time.

To be read in this order: ``cell`` is the definition, one layer after the other; ``unroll`` computes
the same for many records at once; ``sensitivity`` adds the derivative that trains it; ``readback``
goes from trained weights back to the physics. ``forced`` is the network of a sensor with a
nonlinear spring, ``residual`` the small network that learns what the physics leaves.
"""
