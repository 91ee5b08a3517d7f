"""From experiment to parameters: excitation, recordings, reconstruction, estimation, validation."""
