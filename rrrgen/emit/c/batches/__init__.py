"""C that evaluates a function for many states at once: vectorized functions, and the loops that Python calls."""
