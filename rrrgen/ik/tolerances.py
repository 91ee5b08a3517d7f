"""Every threshold of the inverse kinematics, with its reason.

Compile time (classification), relative to the reach of the arm for lengths, absolute for sines and cosines:

* ``SPECIAL``: geometry nearer than this to a special case is solved as the special case and every row is then refined
  on the true chain. On the special side the first guess is off by the threshold, on the general side the equations of the
  general case lose about eps / threshold^2; 1e-6 leaves Newton's method a good start on both sides.

Run time: the table of :func:`runtime`.
"""

from __future__ import annotations

SPECIAL = 1e-6


def runtime(real: str) -> dict[str, str]:
    """The tolerances of emitted code, as C literals, for ``"double"`` or ``"float"``.

    free: a unit direction known no better than this is none; tight: rows are refined above it; accept: rows are dropped
    above it (a target out of reach by less counts as reachable); same: two rows nearer than this are one, since angles
    at a double root are only good to the root of the precision; merge = (same / 2)^2; slack: how far below zero a
    discriminant may fall and still give a candidate; orthonormal: largest defect of R' R - 1 and of the handedness that
    is repaired.
    """
    if real == "float":
        return {
            "eps": "1.1920929e-07",
            "free": "2e-6",
            "merge": "2e-6",
            "same": "2e-3",
            "slack": "1e-4",
            "circle": "1e-4",
            "tight": "1e-11",
            "accept": "1e-9",
            "loose": "1e-3",
            "done": "1e-13",
            "damped": "1e-5",
            "orthonormal": "1e-4",
            "limit": "1e-5",
        }
    return {
        "eps": "2.220446049250313e-16",
        "free": "1e-13",
        "merge": "1e-13",
        "same": "5e-7",
        "slack": "1e-10",
        "circle": "1.6e-11",
        "tight": "1e-26",
        "accept": "1.6e-25",
        "loose": "1e-4",
        "done": "1e-31",
        "damped": "1e-12",
        "orthonormal": "1e-7",
        "limit": "1e-10",
    }
