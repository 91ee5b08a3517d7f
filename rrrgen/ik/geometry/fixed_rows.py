"""Fixed rows of a mechanism become part of a link.

The transform ``K = L_k J_fixed L_{k+1}`` between the joints on both sides of a fixed row is constant. The common
perpendicular of the two axes splits it as ``K = Rz(theta) Tz(d) Tx(a) Rx(alpha) Rz(angle) Tz(shift)``, a link and a
screw that goes into the next joint: the chain has exact links again. Between nearly parallel axes the common
perpendicular may lie kilometres away; then the link for the equations has parallel axes, and the chain keeps K in
``Chain.between``, which solutions are refined on.
"""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, hypot, sin

import sympy as sp

from rrrgen.ik.geometry.chain import Chain, Joint, Link, Matrix, multiply, translation
from rrrgen.ik.geometry.nearest import pierced
from rrrgen.ik.tolerances import EXACT, NEARLY_PARALLEL, SHORTER


def without_fixed_rows(chain: Chain, S: sp.Matrix) -> tuple[Chain, sp.Matrix]:
    """Make every joint without motion part of a link: (chain of floats, its coupling ``y = S q``).

    ``S`` is the coupling of the rows of ``chain``; the row of a joint without motion is zero.
    """
    for k in reversed(range(chain.n)):
        if not any(S.row(k)) and chain.n > 1:
            chain = _without(chain, k)
            S = S.extract([i for i in range(S.rows) if i != k], list(range(S.cols)))
    if chain.between == tuple(link.matrix() for link in chain.links):
        chain = replace(chain, between=())
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
        tilted, joint = _tilted(K, chain.reach), joints[k]
        link, angle, shift = _common_perpendicular(K) if _sine(K) >= EXACT and not tilted else pierced(K)
        true = multiply(multiply(K, _turn(-angle)), translation((0.0, 0.0, -shift))) if tilted else link.matrix()
        if not tilted:
            joints[k - 1], link = _begun(joints[k - 1], link)
            true = link.matrix()
        joints[k] = replace(joint, offset=float(joint.offset) + (angle if joint.revolute else shift))
        left = translation((0.0, 0.0, shift)) if joint.revolute else _turn(angle)  # commutes with the joint's motion
        links[k - 1 : k + 1], between[k - 1 : k + 1] = [link], [true]
        if k < len(links):
            behind, exact = links[k], between[k] == links[k].matrix()
            ct, st = float(behind.ct), float(behind.st)
            turned = {"ct": cos(angle) * ct - sin(angle) * st, "st": sin(angle) * ct + cos(angle) * st}
            links[k] = replace(behind, d=float(behind.d) + shift) if joint.revolute else replace(behind, **turned)
            between[k] = links[k].matrix() if exact else multiply(left, between[k])
        else:
            tip = multiply(left, tip)
    numbered = tuple(replace(joint, index=i) for i, joint in enumerate(joints))
    return replace(chain, base=base, joints=numbered, links=tuple(links), tip=tip, between=tuple(between))


def _sine(K: Matrix) -> float:
    """The sine of the angle between the axes before and behind ``K``."""
    return hypot(float(K[0][2]), float(K[1][2]))


def _tilted(K: Matrix, reach: float) -> bool:
    """Whether the axes before and behind ``K`` are so nearly parallel that their common perpendicular is far away."""
    if not EXACT <= _sine(K) < NEARLY_PARALLEL:
        return False
    along = abs(float(K[0][2]) * float(K[0][3]) + float(K[1][2]) * float(K[1][3]))
    return along >= SHORTER * reach * _sine(K) ** 2  # it meets the second axis at along/sine^2 from the frame behind K


def _begun(joint: Joint, link: Link) -> tuple[Joint, Link]:
    """Move the rotation, of a revolute ``joint``, or shift with which ``link`` begins into the offset of the joint."""
    if joint.revolute:
        turn = atan2(float(link.st), float(link.ct))
        return replace(joint, offset=float(joint.offset) + turn), replace(link, ct=1.0, st=0.0)
    return replace(joint, offset=float(joint.offset) + float(link.d)), replace(link, d=0.0)


def _common_perpendicular(K: Matrix) -> tuple[Link, float, float]:
    """Split ``K = link Rz(angle) Tz(shift)`` at the common perpendicular of both axes: (link, angle, shift)."""
    (_, _, zx, x), (_, _, zy, y), (third_x, third_y, ca, z) = (tuple(map(float, row)) for row in K)
    sa = hypot(zx, zy)
    ct, st = -zy / sa, zx / sa  # the second axis is Rz(theta) Rx(alpha) (0, 0, 1) = (st sa, -ct sa, ca)
    shift = (x * st - y * ct) / sa
    return Link(z - shift * ca, x * ct + y * st, ca, sa, ct, st), atan2(third_x, third_y), shift


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
