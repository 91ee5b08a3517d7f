"""Virtual joints: joints that are added to an arm with too few, so that the equations for six (or three) joints apply.

Only solutions in which every virtual joint has the value zero are solutions of the arm itself.
"""

from __future__ import annotations

from dataclasses import replace

from rrrgen.ik.geometry.chain import Chain, Joint, Link, Matrix, multiply


def extended(chain: Chain, count: int, *, at_base: bool, shift: float, turn: int) -> Chain:
    """Extend ``chain`` by ``count`` virtual revolute joints after its last joint (or before its first, ``at_base``).

    Each axis meets its neighbour at a right angle and two of them meet in one point, so that together with a revolute
    neighbour they form an orthogonal wrist, which is regular at zero. ``shift`` (m) places that point on the
    neighbour's axis, ``turn`` (quarter turns) chooses the direction about it.
    """
    quarter = {"ct": float(turn == 0), "st": float(turn == 1)}
    upright = [Link(ca=0.0, sa=1.0, ct=0.0, st=1.0) for _ in range(count - 1)]
    n = max(joint.index for joint in chain.joints) + 1
    joints = tuple(Joint(n + i, True, name=f"virtual {i + 1}") for i in range(count))
    if at_base:
        links = [Link(ca=0.0, sa=1.0, **quarter), *upright]
        base = chain.base
        for link in reversed(links):
            base = multiply(base, inverse(link.matrix()))
        return replace(chain, joints=joints + chain.joints, links=(*links, *chain.links), base=base)
    links = [Link(d=shift, ca=0.0, sa=1.0, **quarter), *upright]
    tip = chain.tip
    for link in links:
        tip = multiply(inverse(link.matrix()), tip)
    return replace(chain, joints=chain.joints + joints, links=(*chain.links, *links), tip=tip)


def inverse(M: Matrix) -> Matrix:
    """The inverse of a rigid 3x4 transform."""
    R = [[M[j][i] for j in range(3)] for i in range(3)]
    t = [-sum(R[i][j] * M[j][3] for j in range(3)) for i in range(3)]
    return tuple((*R[i], t[i]) for i in range(3))
