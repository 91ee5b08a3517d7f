"""Recursions over the links of a robot: motion, wrenches, composite bodies, regressors.

They are written once for numbers of any kind: recorded scalars, polynomials, elements of a finite field.
"""
