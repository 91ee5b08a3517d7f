"""Targets of ``rrrgen export``: each module implements one format and defines its ``EXPORTER``."""
