"""Time-optimal motion along given paths in Python; the emitted C computes it."""
