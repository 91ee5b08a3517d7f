"""Estimation of parameters from the rows of the regressor, and how far the data determine them."""
