"""Torque errors of models, and the data and filters they refer to: split of the data, choice of filters, scores."""
