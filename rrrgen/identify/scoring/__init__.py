"""Torque errors with the data and filters they refer to: split of the data, choice of the filters, scores."""
