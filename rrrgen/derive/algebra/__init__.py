"""Exact arithmetic for the derivations: vectors, polynomials, a finite field, factorization of the mass matrix."""
