"""Estimation of the dynamic parameters on the controller itself, (14.21)-(14.23): gradient, recursive least squares."""
