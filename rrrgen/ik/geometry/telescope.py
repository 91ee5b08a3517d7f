"""Telescopes: sliding joints of a mechanism one behind the other with parallel axes, solved as one sliding joint.

Their displacements move the tip along the same direction, so a pose determines only their sum, and the equations of the
rows have no solution of their own. ``Tz(x_1) L Tz(x_2) = Tz(x_1 + c x_2) L`` where ``L`` has the twist 0 (c = 1) or pi
(c = -1): the two rows are one joint with the sum as its displacement, whose row of ``y = S q`` is the sum of theirs.
"""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, hypot, sin

import sympy as sp

from rrrgen.ik.geometry.chain import IDENTITY, Chain, Link, Matrix, multiply, translation


def without_telescopes(chain: Chain, S: sp.Matrix) -> tuple[Chain, sp.Matrix]:
    """Join sliding joints with parallel axes, one behind the other: (chain of floats, its coupling ``y = S q``).

    ``S`` is the coupling of the rows of ``chain``. Joints are left as they are where the sum would not determine q any
    more, as for two slides with a drive each.
    """
    k = 0
    while k < chain.n - 1:
        joined = _joined_rows(chain, S, k) if _slides_on(chain, k) else S
        if joined.rows < S.rows and joined.rank() == S.rank():
            chain, S = _joined(chain, k), joined
        else:
            k += 1
    return chain, S


def _slides_on(chain: Chain, k: int) -> bool:
    """Whether joints ``k`` and ``k + 1`` slide along parallel axes."""
    return not chain.joints[k].revolute and not chain.joints[k + 1].revolute and float(chain.links[k].sa) == 0.0


def _joined_rows(chain: Chain, S: sp.Matrix, k: int) -> sp.Matrix:
    """The coupling whose row ``k`` is the displacement along axis ``k`` by both joints, without row ``k + 1``."""
    factor = _direction(chain, k)
    rows = [S.row(i) + factor * S.row(k + 1) if i == k else S.row(i) for i in range(S.rows) if i != k + 1]
    return sp.Matrix.vstack(*rows)


def _direction(chain: Chain, k: int) -> int:
    """1 or -1: how a displacement of joint ``k + 1`` counts as one of joint ``k``."""
    same = 1 if float(chain.links[k].ca) > 0.0 else -1
    return same * chain.joints[k].sign * chain.joints[k + 1].sign


def _joined(chain: Chain, k: int) -> Chain:
    """The chain with joints ``k`` and ``k + 1`` as one; frames behind them may move along and about their axes."""
    one, other, link = chain.joints[k], chain.joints[k + 1], chain.links[k].matrix()
    offset = float(one.offset) + (1 if float(chain.links[k].ca) > 0.0 else -1) * float(other.offset)
    joints = [*chain.joints[:k], replace(one, offset=offset), *chain.joints[k + 2 :]]
    links, tip = [*chain.links[:k], *chain.links[k + 2 :]], chain.tip
    if k + 2 == chain.n:
        tip = multiply(link, tip)
    else:
        between, angle, shift = _as_link(multiply(link, chain.links[k + 1].matrix()))
        links.insert(k, between)
        behind = joints[k + 1]
        rest: Matrix
        if behind.revolute:
            joints[k + 1] = replace(behind, offset=float(behind.offset) + angle)
            angle, rest = 0.0, translation((0.0, 0.0, shift))
        else:
            joints[k + 1] = replace(behind, offset=float(behind.offset) + shift)
            shift, rest = 0.0, _turn(angle)
        if k + 2 < len(joints):
            c, s, after = cos(angle), sin(angle), links[k + 1]
            ct, st = c * float(after.ct) - s * float(after.st), s * float(after.ct) + c * float(after.st)
            links[k + 1] = replace(after, d=float(after.d) + shift, ct=ct, st=st)
        else:
            tip = multiply(rest, tip)
    numbered = tuple(replace(joint, index=i) for i, joint in enumerate(joints))
    return replace(chain, joints=numbered, links=tuple(links), tip=tip)


def _turn(angle: float) -> Matrix:
    c, s = cos(angle), sin(angle)
    return ((c, -s, 0.0, 0.0), (s, c, 0.0, 0.0), IDENTITY[2])


def _as_link(M: Matrix) -> tuple[Link, float, float]:
    """The link L, the angle and the shift with ``M = L Rz(angle) Tz(shift)``."""
    R = [[float(M[i][j]) for j in range(3)] for i in range(3)]
    x, y, z = (float(row[3]) for row in M)
    sa, ca = hypot(R[0][2], R[1][2]), R[2][2]
    if sa == 0.0:
        a, shift = hypot(x, y), 0.0
        ct, st = (x / a, y / a) if a > 0.0 else (1.0, 0.0)
        d = z
    else:
        ct, st = -R[1][2] / sa, R[0][2] / sa
        a, shift = x * ct + y * st, (x * st - y * ct) / sa
        d = z - shift * ca
    across = R[0][0] * ct + R[1][0] * st, R[0][1] * ct + R[1][1] * st
    return Link(d, a, ca, sa, ct, st), atan2(-across[1], across[0]), shift
