"""Estimation of parameters from the rows of the regressor, and of how well the data determine them."""
