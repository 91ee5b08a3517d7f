"""Base parameters: which combinations of inertial parameters the dynamics depend on, as exact expressions."""
