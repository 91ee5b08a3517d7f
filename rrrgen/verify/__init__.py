"""Verification of a compiled model against independent dynamics: a built-in Newton-Euler recursion, other libraries.

The references start from the numbers of the robot's description and share no code with the derivation that they check.
"""

from rrrgen.verify.checks import verify
from rrrgen.verify.report import Report, Row

__all__ = ["Report", "Row", "verify"]
