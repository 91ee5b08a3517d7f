"""Readers of optional sections of a robot file: fixed transforms, own base parameters, provenance, reversed joints."""
