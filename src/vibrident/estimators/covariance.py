"""The inverse of a normal matrix, as the estimators know it."""

from vibrident.information import SMALLEST, inverse_normal

__all__ = ["SMALLEST", "inverse_normal"]
