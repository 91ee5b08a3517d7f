"""Readers of the sections that not every robot file has: fixed transforms, a basis of one's own, provenance."""
