"""Fixed rows of a mechanism, which hold the small tilt between nearly parallel axes, become part of a link.

The transform ``K = L_k J_fixed L_{k+1}`` between the joints on both sides of a fixed row is constant, but no link
``Rz(theta) Tz(d) Tx(a) Rx(alpha)`` with near frames: its common perpendicular may lie kilometres away. The chain keeps
K in ``Chain.between``, which solutions are refined on; the link for its equations has parallel axes.
"""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin

import sympy as sp

from rrrgen.ik.geometry.chain import Chain, Matrix, multiply, translation
from rrrgen.ik.geometry.nearest import pierced


def without_fixed_rows(chain: Chain, S: sp.Matrix) -> tuple[Chain, sp.Matrix]:
    """Make every joint without motion part of a link: (chain of floats, its coupling ``y = S q``).

    ``S`` is the coupling of the rows of ``chain``; the row of a joint without motion is zero.
    """
    for k in reversed(range(chain.n)):
        if not any(S.row(k)) and chain.n > 1:
            chain = _without(chain, k)
            S = S.extract([i for i in range(S.rows) if i != k], list(range(S.cols)))
    return chain, S


def _without(chain: Chain, k: int) -> Chain:
    """The chain without joint ``k``, which stands at its offset."""
    base, *between, tip = chain.transforms
    x = float(chain.joints[k].offset)
    motion = _turn(x) if chain.joints[k].revolute else translation((0.0, 0.0, x))
    joints, links = [*chain.joints[:k], *chain.joints[k + 1 :]], list(chain.links)
    if k == 0:
        base = multiply(multiply(base, motion), between.pop(0))
        links.pop(0)
    elif k == chain.n - 1:
        tip = multiply(multiply(between.pop(), motion), tip)
        links.pop()
    else:
        K = multiply(multiply(between[k - 1], motion), between[k])
        link, angle, shift = pierced(K)
        turn, slide = _turn(angle), translation((0.0, 0.0, shift))
        joint = joints[k]
        joints[k] = replace(joint, offset=float(joint.offset) + (angle if joint.revolute else shift))
        left = slide if joint.revolute else turn  # commutes with the motion of the joint
        links[k - 1 : k + 1] = [link]
        between[k - 1 : k + 1] = [multiply(multiply(K, _turn(-angle)), translation((0.0, 0.0, -shift)))]
        if k < len(links):
            between[k] = multiply(left, between[k])
            behind = links[k]
            ct, st = float(behind.ct), float(behind.st)
            turned = {"ct": cos(angle) * ct - sin(angle) * st, "st": sin(angle) * ct + cos(angle) * st}
            links[k] = replace(behind, d=float(behind.d) + shift) if joint.revolute else replace(behind, **turned)
        else:
            tip = multiply(left, tip)
    numbered = tuple(replace(joint, index=i) for i, joint in enumerate(joints))
    return replace(chain, base=base, joints=numbered, links=tuple(links), tip=tip, between=tuple(between))


def _turn(angle: float) -> Matrix:
    c, s = cos(angle), sin(angle)
    return ((c, -s, 0.0, 0.0), (s, c, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


def largest_tilt(chain: Chain) -> float:
    """The largest difference (rad, or parts of the reach) of ``chain.between`` from the links."""
    found = [0.0]
    for link, true in zip(chain.links, chain.between, strict=True) if chain.between else ():
        for row, value in zip(link.matrix(), true, strict=True):
            apart = [abs(float(x) - float(y)) for x, y in zip(row, value, strict=True)]
            found += [*apart[:3], apart[3] / chain.reach]
    return max(found)
