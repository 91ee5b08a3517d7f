"""Geometric calibration: Denavit-Hartenberg parameters, base and tool from measured poses, points, distances."""
