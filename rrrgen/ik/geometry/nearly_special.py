"""The special arm nearest to a chain: nearly parallel axes made parallel where the arm is, small geometry set to zero.

The common perpendicular of nearly parallel axes may lie hundreds of metres away, and d and a of their rows say little
about the arm. Frames are therefore moved along their axes first, to where the axis pierces the plane of the frame
before it.
"""

from __future__ import annotations

from dataclasses import replace
from math import acos, atan2, cos, hypot, pi, sin
from random import Random

import sympy as sp

from rrrgen.ik.geometry.chain import KinematicChain, Link, Matrix, Number
from rrrgen.ik.tolerances import NEARLY_PARALLEL, SHORTER

# ------------------------------------------------------------------------------------------------------------------
# Replacement of nearly special geometry by the special one: small lengths, sines and cosines become exactly zero.
# ------------------------------------------------------------------------------------------------------------------


def snap_chain(chain: KinematicChain, tolerance: float) -> KinematicChain:
    """Set the lengths below ``tolerance`` times the reach, and sines and cosines below ``tolerance``, to zero."""
    least = tolerance * chain.reach
    return replace(chain, links=tuple(_snap(link, least, tolerance) for link in chain.links), between=())


def _snap(link: Link, least: float, tolerance: float) -> Link:
    ca, sa = _direction(float(link.ca), float(link.sa), tolerance)
    ct, st = _direction(float(link.ct), float(link.st), tolerance)
    d, a = (0.0 if abs(float(x)) < least else float(x) for x in (link.d, link.a))
    return Link(d, a, ca, sa, ct, st)


def _direction(c: float, s: float, tolerance: float) -> tuple[float, float]:
    if abs(s) < tolerance:
        return (1.0 if c > 0 else -1.0), 0.0
    if abs(c) < tolerance:
        return 0.0, (1.0 if s > 0 else -1.0)
    return c, s


def exact_like(exact: KinematicChain, decided: KinematicChain) -> KinematicChain:
    """Copy the zeros and ones of the numeric chain ``decided`` into ``exact``, the same arm in exact numbers.

    The closed form was chosen for the zeros of ``decided``, so the exact chain must have the same ones.
    """

    def number(x: Number, value: float) -> Number:
        return sp.Integer(int(value)) if value in (0.0, 1.0, -1.0) else x

    fields = ("d", "a", "ca", "sa", "ct", "st")
    links = tuple(
        Link(*(number(getattr(link, f), float(getattr(like, f))) for f in fields))
        for link, like in zip(exact.links, decided.links, strict=True)
    )
    return replace(exact, links=links)


# ------------------------------------------------------------------------------------------------------------------
# The special arm nearest to a chain
# ------------------------------------------------------------------------------------------------------------------


def with_near_frames(chain: KinematicChain) -> KinematicChain:
    """Move frames that lie far from the arm to it, along their joint axes; other chains are returned unchanged.

    The displacements are recorded in the field ``slides`` of the result.
    """
    level, slides = _level_axes(chain)
    return replace(chain, slides=slides) if level.reach * SHORTER < chain.reach else chain


def nearest_special(chain: KinematicChain, tolerance: float) -> KinematicChain:
    """The special arm near ``chain``: lengths (over the reach), sines and cosines below ``tolerance`` become zero.

    Where frames lie far away, nearly parallel axes become parallel whatever the tolerance is.
    """
    return snap_chain(_level_axes(chain)[0] if chain.slides else chain, tolerance)


def _level_axes(chain: KinematicChain) -> tuple[KinematicChain, tuple[float, ...]]:
    """The chain with nearly parallel axes made parallel, and the displacement of each frame along its axis (m)."""
    links, slides = [], [0.0]
    c, s, shift = 1.0, 0.0, 0.0  # what is left of the link before: Rz Tz in the frame of the joint
    for i, link in enumerate(chain.links):
        ct, st = c * float(link.ct) - s * float(link.st), s * float(link.ct) + c * float(link.st)
        moved = replace(link, d=float(link.d) + shift, ct=ct, st=st)
        c, s, shift = 1.0, 0.0, 0.0
        if abs(float(link.sa)) < NEARLY_PARALLEL and chain.joints[i].revolute and chain.joints[i + 1].revolute:
            moved, rest, shift = parallel_link(moved.matrix())
            c, s = cos(rest), sin(rest)
        links.append(moved)
        slides.append(-shift)
    tip = tuple(
        (c * float(x) - s * float(y), s * float(x) + c * float(y), float(z)) for x, y, z in zip(*chain.tip, strict=True)
    )
    rows = [list(row) for row in zip(*tip, strict=True)]
    rows[2][3] += shift
    level = replace(chain, links=tuple(links), tip=tuple(map(tuple, rows)), slides=())
    return level, tuple(slides)


def parallel_link(M: Matrix) -> tuple[Link, float, float]:
    """Replace the transform ``M`` between nearly parallel axes by a link between parallel axes: (link, angle, shift).

    The link ends where the second axis pierces the plane of the first frame. ``Rz(angle) Tz(shift)`` leads from there
    to where ``M`` ends.
    """
    shift = float(M[2][3]) / float(M[2][2])
    x, y = (float(M[i][3]) - shift * float(M[i][2]) for i in range(2))
    a = hypot(x, y)
    ct, st = (x / a, y / a) if a > 0.0 else (1.0, 0.0)
    ca = 1.0 if float(M[2][2]) > 0 else -1.0
    rest = atan2(ca * (float(M[1][0]) * ct - float(M[0][0]) * st), float(M[0][0]) * ct + float(M[1][0]) * st)
    return Link(0.0, a, ca, 0.0, ct, st), rest, shift


def deviation(chain: KinematicChain, special: KinematicChain) -> float:
    """The largest difference of the tip poses of two arms at 40 random configurations.

    It is the angle between the orientations (rad) or the distance of the positions over the reach, whichever is more.
    """
    draw, most = Random(23), 0.0
    for _ in range(40):
        q = [draw.uniform(-pi, pi) for _ in chain.joints]
        for joint in chain.joints:
            if not joint.revolute:
                q[joint.index] *= chain.reach / pi
        pairs = list(zip(chain.tip_pose(q), special.tip_pose(q), strict=True))  # of rows
        trace = sum(T[k] * S[k] for T, S in pairs for k in range(3))  # that of R_T' R_S, the sum over its diagonal
        angle = acos(min(1.0, max(-1.0, 0.5 * (trace - 1))))
        most = max(most, angle, hypot(*(T[3] - S[3] for T, S in pairs)) / chain.reach)
    return most


def changes(chain: KinematicChain, special: KinematicChain) -> tuple[str, ...]:
    """Describe the differences of the arms: one phrase for each length or angle that is special in ``special`` only.

    A phrase says by how much ``chain`` is off, as in "axes 2 and 3 parallel (off by 0.001 rad)".
    """
    phrases = []
    level = _level_axes(chain)[0] if chain.slides else chain
    for k, (link, level_link, snap) in enumerate(zip(chain.links, level.links, special.links, strict=True), 1):
        if float(link.sa) and not float(snap.sa):
            phrases.append(f"axes {k} and {k + 1} parallel (off by {abs(float(link.sa)):.2g} rad)")
        if float(link.ca) and not float(snap.ca):
            phrases.append(f"axes {k} and {k + 1} at a right angle (off by {abs(float(link.ca)):.2g} rad)")
        if float(level_link.a) and not float(snap.a):
            phrases.append(f"axes {k} and {k + 1} meeting (off by {abs(float(level_link.a)):.2g} m)")
        if float(level_link.d) and not float(snap.d):
            phrases.append(f"no offset along axis {k} (off by {abs(float(level_link.d)):.2g} m)")
    return tuple(phrases)
