"""Robots in the formats of other programs; one target is one file in ``targets/``."""
