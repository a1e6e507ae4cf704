"""Estimators that the paper compares with the network, one a file."""
