"""Geometry of mechanisms as chains: coupled joints ``y = S q``, rows without a joint, and telescopes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import atan2, cos, gcd, hypot, lcm, pi, prod, sin
from typing import TYPE_CHECKING

import sympy as sp

from rrrgen.base.errors import DerivationError
from rrrgen.ik.geometry.chain import Joint, KinematicChain, Link, Matrix, multiply, numeric_chain, translation
from rrrgen.ik.geometry.nearly_special import parallel_link
from rrrgen.ik.tolerances import EXACT, NEARLY_PARALLEL, SHORTER
from rrrgen.robot.model.mechanism import FollowerLimits, chain_to_tip, coupling_to_tip, follower_limits

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec


# ------------------------------------------------------------------------------------------------------------------
# Fixed rows of a mechanism become part of a link.
#
# The transform ``K = L_k J_fixed L_{k+1}`` between the joints on both sides of a fixed row is constant. The common
# perpendicular of the two axes splits it as ``K = Rz(theta) Tz(d) Tx(a) Rx(alpha) Rz(angle) Tz(shift)``, a link and a
# screw that goes into the next joint: the chain has exact links again. Between nearly parallel axes the common
# perpendicular may lie kilometres away; then the link for the equations has parallel axes, and the chain keeps K in
# ``KinematicChain.between``, which solutions are refined on.
# ------------------------------------------------------------------------------------------------------------------


def without_fixed_rows(chain: KinematicChain, S: sp.Matrix) -> tuple[KinematicChain, sp.Matrix]:
    """Remove the joints that never move from ``chain``: their constant transforms become part of the links beside them.

    ``S`` (rows, n) gives the displacements ``y = S q`` of the joints of ``chain`` from the joint positions q; that of a
    joint that never moves is a row of zeros. Returns the shorter chain, in floats, and S without these rows.
    """
    for k in reversed(range(chain.n)):
        if not any(S.row(k)) and chain.n > 1:
            chain = _without(chain, k)
            S = S.extract([i for i in range(S.rows) if i != k], list(range(S.cols)))
    if chain.between == tuple(link.matrix() for link in chain.links):
        chain = replace(chain, between=())
    return chain, S


def _without(chain: KinematicChain, k: int) -> KinematicChain:
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
        tilted, joint = _is_tilted(K, chain.reach), joints[k]
        link, angle, shift = _common_perpendicular(K) if _sine(K) >= EXACT and not tilted else parallel_link(K)
        true = multiply(multiply(K, _turn(-angle)), translation((0.0, 0.0, -shift))) if tilted else link.matrix()
        if not tilted:
            joints[k - 1], link = _absorb_into_offset(joints[k - 1], link)
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


def _is_tilted(K: Matrix, reach: float) -> bool:
    """Whether the axes before and behind ``K`` are so nearly parallel that their common perpendicular is far away."""
    if not EXACT <= _sine(K) < NEARLY_PARALLEL:
        return False
    along = abs(float(K[0][2]) * float(K[0][3]) + float(K[1][2]) * float(K[1][3]))
    return along >= SHORTER * reach * _sine(K) ** 2  # it meets the second axis at along/sine^2 from the frame behind K


def _absorb_into_offset(joint: Joint, link: Link) -> tuple[Joint, Link]:
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


def largest_tilt(chain: KinematicChain) -> float:
    """The largest difference (rad, or parts of the reach) of ``chain.between`` from the links."""
    differences = [0.0]
    for link, true in zip(chain.links, chain.between, strict=True) if chain.between else ():
        for row, value in zip(link.matrix(), true, strict=True):
            apart = [abs(float(x) - float(y)) for x, y in zip(row, value, strict=True)]
            differences += [*apart[:3], apart[3] / chain.reach]
    return max(differences)


# ------------------------------------------------------------------------------------------------------------------
# Telescopes: sliding joints of a mechanism one behind the other with parallel axes, solved as one sliding joint.
#
# Their displacements move the tip along the same direction, so a pose determines only their sum, and the equations of
# the rows have no solution of their own. ``Tz(x_1) L Tz(x_2) = Tz(x_1 + c x_2) L`` where ``L`` has the twist 0 (c =
# 1) or pi (c = -1): the two rows are one joint with the sum as its displacement, whose row of ``y = S q`` is the sum
# of theirs.
# ------------------------------------------------------------------------------------------------------------------


def without_telescopes(chain: KinematicChain, S: sp.Matrix) -> tuple[KinematicChain, sp.Matrix]:
    """Join sliding joints with parallel axes, one behind the other: (chain of floats, its coupling ``y = S q``).

    ``S`` is the coupling of the rows of ``chain``. Joints are left as they are where the sum would not determine q any
    more, as for two slides with a drive each.
    """
    k = 0
    while k < chain.n - 1:
        joined = _joined_rows(chain, S, k) if _slides_on(chain, k) else S
        if joined.rows < S.rows and joined.rank() == S.rank():
            chain, S = _merge_joints(chain, k), joined
        else:
            k += 1
    return chain, S


def _slides_on(chain: KinematicChain, k: int) -> bool:
    """Whether joints ``k`` and ``k + 1`` slide along parallel axes."""
    return not chain.joints[k].revolute and not chain.joints[k + 1].revolute and float(chain.links[k].sa) == 0.0


def _joined_rows(chain: KinematicChain, S: sp.Matrix, k: int) -> sp.Matrix:
    """The coupling whose row ``k`` is the displacement along axis ``k`` by both joints, without row ``k + 1``."""
    factor = _direction(chain, k)
    rows = [S.row(i) + factor * S.row(k + 1) if i == k else S.row(i) for i in range(S.rows) if i != k + 1]
    return sp.Matrix.vstack(*rows)


def _direction(chain: KinematicChain, k: int) -> int:
    """1 or -1: how a displacement of joint ``k + 1`` counts as one of joint ``k``."""
    same = 1 if float(chain.links[k].ca) > 0.0 else -1
    return same * chain.joints[k].sign * chain.joints[k + 1].sign


def _merge_joints(chain: KinematicChain, k: int) -> KinematicChain:
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


# ------------------------------------------------------------------------------------------------------------------
# Joint positions q of a mechanism from the displacements y of its rows, ``y = S q``.
#
# The rows of the DH table from the base to the tip are solved as if each had a drive. Their displacements y belong to
# joint positions q where ``y = S q`` up to full turns of the angles. With a regular part B of S, ``q = B^-1 (y_B + 2
# pi z)`` for whole numbers z. Only finitely many z give different arms; those are kept for which q also gives the
# displacements of the rows outside B.
# ------------------------------------------------------------------------------------------------------------------

LARGEST_COUNT = 1024
"""Largest number of combinations of full turns of the rows that are tried for one solution of the chain."""

Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Coupling:
    """The relation ``y = S q`` between the chain of rows from base to tip and the joint positions q of a mechanism.

    * ``matrix``: S, (rows, n).
    * ``pivots`` and ``inverse``: indices of n linearly independent rows of S, and the inverse (n, n) of these rows.
    * ``counts``: for each pivot row the number of full turns that are tried, 0 to count - 1; more give the same q.
    * ``periods``: for each joint of q the change (rad or m) with which all angles of the rows make full turns; 0 if
      there is none.
    * ``revolute``, ``limits``: for each joint of q, whether it is revolute, and its position limits (rad or m).
    * ``followers``: the position limits of rows that follow several joints of q.
    """

    matrix: Rows
    pivots: tuple[int, ...]
    inverse: Rows
    counts: tuple[int, ...]
    periods: tuple[float, ...]
    revolute: tuple[bool, ...]
    limits: tuple[tuple[float | None, float | None], ...]
    followers: tuple[FollowerLimits, ...]

    @property
    def n(self) -> int:
        """The number of joints of q."""
        return len(self.inverse)

    @property
    def count(self) -> int:
        """The number of joint positions that give one configuration of the rows."""
        return prod(self.counts)

    def rows(self, q: Sequence[float]) -> list[float]:
        """The displacements ``y = S q`` of the rows."""
        return [sum(f * float(x) for f, x in zip(factors, q, strict=True)) for factors in self.matrix]

    def leading(self, y: Sequence[float]) -> Iterator[list[float]]:
        """Yield every q whose pivot rows have the displacements ``y`` up to full turns; other rows are not checked."""
        for z in product(*(range(count) for count in self.counts)):
            x = [float(y[p]) + 2 * pi * k for p, k in zip(self.pivots, z, strict=True)]
            yield [sum(f * value for f, value in zip(factors, x, strict=True)) for factors in self.inverse]

    def leader(self, row: int) -> int | None:
        """The one joint of q that ``row`` follows; None if it follows several."""
        leaders = [k for k, factor in enumerate(self.matrix[row]) if factor]
        return leaders[0] if len(leaders) == 1 else None


def solved_chain(spec: RobotSpec) -> tuple[KinematicChain, sp.Matrix]:
    """The chain from base to tip whose joints are solved for, and its coupling ``y = S q``.

    Its joints are the rows, without fixed ones; the slides of a telescope are one joint.
    """
    return without_fixed_rows(*without_telescopes(numeric_chain(chain_to_tip(spec)), coupling_to_tip(spec)))


def coupling_of(spec: RobotSpec, chain: KinematicChain, S: sp.Matrix) -> Coupling:
    """The coupling ``y = S q`` of the mechanism ``spec``, whose joints from base to tip are ``chain``.

    Raises DerivationError if the rows do not determine q, or if too many combinations of full turns had to be tried.
    """
    n = spec.n
    if S.rank() < n:
        missing = ", ".join(j.name for j, k in zip(spec.joints, range(n), strict=True) if not any(S[:, k]))
        raise DerivationError(f"{missing} do not move the tip" if missing else "the rows to the tip do not determine q")
    pivots = tuple(S.T.rref()[1])
    inverse = S.extract(list(pivots), list(range(n))).inv()
    turning = [i for i, joint in enumerate(chain.joints) if joint.revolute]
    turns = _full_turns(S, turning)
    counts = tuple(
        _turns_until_alike(S * inverse[:, k], inverse[:, k], turning, turns) if p in turning else 1
        for k, p in enumerate(pivots)
    )
    if prod(counts) > LARGEST_COUNT:
        raise DerivationError(
            f"with these ratios {prod(counts)} positions of the drives give one pose of the rows, and at most "
            f"{LARGEST_COUNT} are tried"
        )
    return Coupling(
        _floats(S),
        pivots,
        _floats(inverse),
        counts,
        tuple(2 * pi * float(turn) for turn in turns),
        tuple(joint.is_revolute for joint in spec.joints),
        tuple((joint.limits.lower, joint.limits.upper) for joint in spec.joints),
        follower_limits(spec),
    )


def identity_coupling(chain: KinematicChain) -> Coupling:
    """The coupling ``y = q`` of an arm, whose joints all have a drive of their own."""
    joints = chain.joints
    identity = tuple(tuple(float(i == j) for j in range(chain.n)) for i in range(chain.n))
    return Coupling(
        identity,
        tuple(range(chain.n)),
        identity,
        (1,) * chain.n,
        tuple(2 * pi * joint.revolute for joint in joints),
        tuple(joint.revolute for joint in joints),
        tuple((joint.lower, joint.upper) for joint in joints),
        (),
    )


def _floats(matrix: sp.Matrix) -> Rows:
    return tuple(tuple(float(matrix[i, j]) for j in range(matrix.cols)) for i in range(matrix.rows))


def _full_turns(S: sp.Matrix, turning: list[int]) -> list[sp.Rational]:
    """For each q the least number of turns after which all angles of the rows have made full turns; 0 if none."""
    turns: list[sp.Rational] = []
    for k in range(S.cols):
        column = {i: sp.Rational(S[i, k]) for i in turning if S[i, k] != 0}
        free = len(column) == sum(S[i, k] != 0 for i in range(S.rows))
        # the least t > 0 for which every column[i] t is whole
        ratios = [(int(abs(value.p)), int(value.q)) for value in column.values()]
        turns.append(sp.Rational(lcm(*(q for _, q in ratios)), gcd(*(p for p, _ in ratios))) if free else sp.S.Zero)
    return turns


def _turns_until_alike(rows: sp.Matrix, step: sp.Matrix, turning: list[int], turns: list[sp.Rational]) -> int:
    """Number of additions of ``step`` to q after which the pose of every row, and q up to full periods, repeat.

    ``step`` (n,) changes q in turns, and with it the rows by ``rows``, of which those in ``turning`` are angles;
    ``turns`` are the periods of q (:func:`_full_turns`).
    """
    ratios = [rows[i] for i in turning]
    ratios += [value / period for value, period in zip(step, turns, strict=True) if period]
    return lcm(*(int(sp.Rational(ratio).q) for ratio in ratios))
