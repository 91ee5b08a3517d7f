"""Readers of recorded tables with a common interface, one format per module."""
