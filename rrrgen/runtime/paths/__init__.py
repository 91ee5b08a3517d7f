"""Timing of paths in Python, by the emitted C."""
