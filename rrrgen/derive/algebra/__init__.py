"""Exact arithmetic under the derivations: vectors, polynomials, a finite field, factors of the mass matrix."""
