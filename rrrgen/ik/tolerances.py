"""Every threshold of the inverse kinematics, with its reason.

Compile time (classification), relative to the reach of the arm for lengths, absolute for sines and cosines:

* ``EXACT``: what is nearer to zero is zero; it is the rounding of a table, invisible at run time.
* ``SPECIAL``: geometry nearer than this to a simpler case is solved as that case, and every row is refined on the true
  chain. The first guess is then off by at most 1e-9, which one Newton step removes.
* ``NEARLY``: up to here the equations of the general case (a quartic, or the elimination for six joints) come near a
  multiple root and lose about eps / distance^2. They are used together with the simpler case: a row that either finds,
  refined on the true chain, counts. Equations that split into quadratics keep their digits and need no such help.

Run time: the table of :func:`runtime`.
"""

from __future__ import annotations

EXACT = 1e-14
SPECIAL = 1e-9
NEARLY = (1e-6, 1e-3, 1e-2)
"""Tried in this order: the nearest simpler arm."""


def runtime(real: str) -> dict[str, str]:
    """The tolerances of emitted code, as C literals, for ``"double"`` or ``"float"``.

    free: a unit direction known no better than this is none; doubt: one shorter than this may be none, if the target is
    as inaccurate as is accepted; turn: a joint that the target does not decide to this angle (rad) is free; tight: rows
    are refined above it; accept: rows are dropped above it (a target out of reach by less counts as reachable); same:
    two rows nearer than this are one, since angles at a double root are only good to the root of the precision; merge =
    (same / 2)^2; slack: how far below zero a discriminant may fall and still give a candidate; orthonormal: largest
    defect of R' R - 1 and of the handedness that is repaired; tiny: below every length that matters, keeps quotients
    finite; rounding: 1.5 * 2^52 (2^23), which leaves a whole number when it is added and taken away.
    """
    if real == "float":
        return {
            "eps": "1.1920929e-07",
            "free": "2e-6",
            "doubt": "1e-2",
            "turn": "0.01",
            "merge": "2e-6",
            "same": "2e-3",
            "slack": "1e-3",
            "circle": "1e-4",
            "tight": "1e-11",
            "accept": "1e-9",
            "band": "1e-4",
            "loose": "1e-3",
            "done": "1e-13",
            "orthonormal": "1e-4",
            "limit": "1e-5",
            "tiny": "1e-30",
            "rounding": "12582912.0",
        }
    return {
        "eps": "2.220446049250313e-16",
        "free": "1e-13",
        "doubt": "1e-5",
        "turn": "0.01",
        "merge": "1e-13",
        "same": "5e-7",
        "slack": "1e-5",
        "circle": "1.6e-11",
        "tight": "1e-26",
        "accept": "1.6e-25",
        "band": "1e-5",
        "loose": "1e-4",
        "done": "1e-31",
        "orthonormal": "1e-7",
        "limit": "1e-10",
        "tiny": "1e-300",
        "rounding": "6755399441055744.0",
    }
