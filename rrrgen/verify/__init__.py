"""Check a compiled model against independent dynamics: a built-in Newton-Euler, and other libraries when installed.

Nothing here comes from the compiler: the references start from the numbers of the robot's description and share no
code with the derivation they judge.
"""

from rrrgen.verify.checks import verify
from rrrgen.verify.report import Report, Row

__all__ = ["Report", "Row", "verify"]
