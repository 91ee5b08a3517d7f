"""Readers of optional sections of a robot file: fixed transforms, user-defined base parameters, provenance."""
