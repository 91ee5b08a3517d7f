"""Building emitted C, loading it through cffi, and calling it with checked NumPy arrays."""
