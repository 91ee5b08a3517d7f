"""Output error over many short windows: simulation, fit, deviations."""
