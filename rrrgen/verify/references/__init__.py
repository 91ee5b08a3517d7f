"""Independent references: a built-in Newton-Euler recursion, and other libraries if they are installed."""
