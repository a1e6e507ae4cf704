"""Discretisation: state space → network weights W1…W4, and samples → inputs of the network.

One family: over a step the input is a polynomial Σ_j c_j P_j(2x − 1), x = t/Ts in [0, 1], P_j
Legendre; the method defines the c_j and the step.

| method | inputs a step | step | order |
|---|---|---|---|
| ``euler`` | a_k | (I + Ts A): the paper's | 1 |
| ``tustin`` | mean of a_k, a_{k+1} | trapezoidal rule | 2 |
| ``zoh`` | a_k held | exact exponential | 1 (exact for held signals) |
| ``foh`` | line through a_k, a_{k+1} | exact exponential | 2 (exact for piecewise linear signals) |
| ``bandlimited`` | coefficients of the band-limited signal | exact exponential | spectral |
"""

from vibrident.physics.discretisation.inputs import StepInputs, band_limited_inputs, sampled_inputs
from vibrident.physics.discretisation.weights import METHODS, Method, Weights, method

__all__ = [
    "METHODS",
    "Method",
    "StepInputs",
    "Weights",
    "band_limited_inputs",
    "method",
    "sampled_inputs",
]
