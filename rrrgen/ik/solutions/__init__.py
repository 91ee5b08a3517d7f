"""Closed-form solutions: one module per family of arms (spherical, parallel, planar, ...) and the shared equations."""
