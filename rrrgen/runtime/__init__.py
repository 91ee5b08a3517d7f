"""Builds the emitted C, loads it through cffi, and calls it with checked NumPy arrays."""
