"""Base parameters: the combinations of inertial parameters on which the dynamics depend, as exact expressions."""
