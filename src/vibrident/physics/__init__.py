"""The sensor: models and add-ons, discretisation, the network unrolled in time, simulation."""
