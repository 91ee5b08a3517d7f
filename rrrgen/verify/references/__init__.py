"""Independent dynamics: a Newton-Euler recursion of its own, and other libraries where they are installed."""
