"""What a sensor is: models and add-ons, discretisation, the network unrolled in time, simulation."""
