"""The targets of ``rrrgen export``: every module here has an ``EXPORTER``."""
