"""Readers of optional sections of a robot file: transforms, basis, mechanisms, provenance, reversed joints."""
