"""C for batches: the same programs over SIMD lanes, and the loops that the Python extension calls."""
