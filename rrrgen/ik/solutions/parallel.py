"""Six-joint arms with a planar triple: three consecutive joints that move a body in a plane, anywhere in the chain.

The triple consists of parallel revolute axes, or of prismatic ones perpendicular to them. The loop equation is written
with the triple first, ``Q e1 e2 e3 E0 . N3 Ja Nab Jb Nbc Jc Nc = 1``: each J is the motion of another joint a, b or
c, and each N a link before, between or after them. A motion of the triple changes neither its normal n nor a height
along n. Hence joints a, b, c alone must map n onto itself and keep the height. With m1 the vector n in the frame behind
joint a, and m2 the same vector seen from the other end, in the frame behind joint b,

    z_b . m1(a) = z_b . m2(c),      height:  t_ab . m1(a) + t_bc . m2(c) + constants = 0

are two equations linear in cos a, sin a, cos c, sin c, where z_b is the axis of joint b, and t_ab and t_bc are the
translations of the links Nab and Nbc. Eliminating joint a through the constant link ab = Tx(a) Rx(alpha) leaves a
quartic in joint c, or two quadratic equations where a = 0 or sin alpha = 0. Then b is the angle that turns m2 onto m1,
and a planar problem for the triple remains (:mod:`rrrgen.ik.solutions.planar`).
"""

from __future__ import annotations

from dataclasses import dataclass

from rrrgen.base.errors import InternalError
from rrrgen.ik.geometry.loop import Closing, Loop, Motion, apply, factors, move, rotate_by_link, straighten
from rrrgen.ik.geometry.rigid_transforms import (
    Crossing,
    Rigid,
    S,
    Vector,
    dot,
    is_zero,
    product,
    rotate,
    rotate_z,
    screw,
    total,
)
from rrrgen.ik.recording.builder import DerivationBuilder, Feasible, Label, Turn
from rrrgen.ik.solutions.joint_functions import Moving
from rrrgen.ik.solutions.planar import Plane, Triple, anchor, orient_triple, solve_planar, triple_of
from rrrgen.ik.solutions.position import UNUSABLE

ORIGIN: Vector = (0, 0, 0)

IDENTITY = screw(1, 0)


@dataclass(frozen=True)
class Frame:
    """A loop divided into its planar triple and the remaining joints with the links around them.

    ``lead`` is the link from the triple to joint a, ``trail`` the one from joint c back to the triple. Both include the
    frames of the triple, so that its normal n is the z axis at both ends.
    """

    triple: Triple
    loop: Loop
    lead: Closing
    trail: Closing

    @staticmethod
    def of(loop: Loop, k: int) -> Frame | None:
        """Split ``loop`` at the planar triple of joints k, k+1, k+2; None where these do not move in one plane."""
        triple = triple_of(loop, k)
        if triple is None:
            return None
        others = loop.start_at((k + 3) % len(loop.joints))
        before = loop.links[(k + 2) % len(loop.joints)]
        lead = Closing((triple.E0, *factors(before)))
        trail = Closing((*factors(others.links[len(loop.joints) - 4]), triple.Q))
        return Frame(triple, others, lead, trail)


def cost(loop: Loop, k: int) -> int:
    """Degree of the hardest equation, 2 or 4, for the loop in this direction; UNUSABLE where no method applies."""
    frame = Frame.of(loop, k)
    if frame is None:
        return UNUSABLE
    kinds = frame.loop.types[:3]
    link = frame.loop.links[0]
    if kinds.count("P") > 1:
        return UNUSABLE
    if kinds in ("PRR", "RPR"):
        return 2
    if kinds == "RRP" or not isinstance(link, Crossing):
        return UNUSABLE
    if is_zero(link.a) and is_zero(link.sa):
        return UNUSABLE
    return 2 if is_zero(link.a) or is_zero(link.sa) else 4


def better(loop: Loop, k: int) -> tuple[int, Loop, int]:
    """Choose the direction of the loop with the lower degree: (cost, loop, index of the triple's first joint in it)."""
    m = len(loop.joints)
    back = loop.reverse()
    other = (m - k - 3) % m
    forward, backward = cost(loop, k), cost(back, other)
    return (forward, loop, k) if forward <= backward else (backward, back, other)


def derive_parallel(b: DerivationBuilder, loop: Loop, k: int, length: float) -> None:
    """Derive all joints of a six-joint loop with a planar triple at joints k, k+1, k+2 of an arm of size ``length``."""
    _, loop, k = better(straighten(loop), k)
    frame = Frame.of(loop, k)
    if frame is None:
        raise InternalError("there is no planar triple here")
    kinds = frame.loop.types[:3]
    if kinds == "PRR":
        motions = _slide_first(b, frame, length)
    elif kinds == "RPR":
        motions = _slide_middle(b, frame, length)
    else:
        motions = _Others(b, frame, length).solve()
    finish_plane(b, frame, motions, length)


def finish_plane(b: DerivationBuilder, frame: Frame, motions: list[Motion], length: float) -> None:
    """Derive the three joints of the planar triple from the ``motions`` of the other joints.

    The loop closes, so the displacement of the triple in its plane is the inverse of the product of the other
    transforms; the planar problem for that displacement is solved. ``length`` (m) is the size of the arm.
    """
    inverse, triple = orient_triple(frame.triple.reverse())
    start = anchor(triple)
    if inverse:  # the triple runs forward again, and e1 e2 e3 is the inverse of the rest of the loop
        point = _around(frame, motions, (start[0], start[1], 0), backwards=True)
        x = _around(frame, motions, (1, 0, 0), backwards=True, direction=True)
    else:
        point = _around(frame, motions, (start[0], start[1], 0))
        x = _around(frame, motions, (1, 0, 0), direction=True)
    point, x = b.names("g", point), b.names("h", x)
    b.residual((0, 0, point[2]), (0, 0, x[2]))
    solve_planar(b, triple, (point[0], point[1]), Turn(x[0], x[1]), length)


def _around(
    frame: Frame, motions: list[Motion], v: Vector, *, backwards: bool = False, direction: bool = False
) -> Vector:
    """Transform a point (or a direction) of the plane of the triple by the product of all other joints of the loop.

    ``motions`` are the motions of these joints in order; with ``backwards`` the inverse of the product is applied.
    """
    count = len(motions)
    links = [frame.lead, *(_closing(link) for link in frame.loop.links[: count - 1]), frame.trail]
    if backwards:
        links = [link.inverse() for link in reversed(links)]
        motions = [Turn(m.c, -m.s) if isinstance(m, Turn) else -m for m in reversed(motions)]
    for i in reversed(range(count + 1)):
        v = links[i].turn(v) if direction else links[i].apply(v)
        if i > 0:
            v = move(motions[i - 1], v, direction=direction)
    return v


def _closing(link: Crossing | Closing) -> Closing:
    return link if isinstance(link, Closing) else Closing((link.rigid(),))


@dataclass(frozen=True)
class _Others:
    """Solver for the three joints a, b, c besides the planar triple, where all three are revolute."""

    b: DerivationBuilder
    frame: Frame
    length: float

    def solve(self) -> list[Motion]:
        """Derive the angles of a, b, c. The two equations of the module's docstring are recorded as residuals."""
        b, frame, L = self.b, self.frame, self.length
        joints = frame.loop.joints[:3]
        ab = frame.loop.links[0]
        if not isinstance(ab, Crossing):
            raise InternalError("the link behind the first joint must be constant")
        n_a = b.names("n", frame.lead.inverse().turn((0, 0, 1)))
        n_c = b.names("o", frame.trail.turn((0, 0, 1)))
        bc = frame.loop.links[1]
        turn_bc = bc.rigid()
        m2 = Moving.of(joints[2], Rigid(turn_bc.R, ORIGIN), n_c)
        height = total(frame.lead.rigid().t[2], product(ab.near[2], n_a[2]), dot(n_c, frame.trail.rigid().t))
        g = m2.z.plus(-product(ab.ca, n_a[2]))
        # t_bc . m2, computed from c back to b: this uses the target pose itself and needs no inverse of it
        behind = Moving.of(joints[2], IDENTITY, n_c)
        away = apply(bc.inverse(), ORIGIN)
        f = m2.z.times(ab.far[2]).plus(height).times(-1)
        for coordinate, form in zip(away, (behind.x, behind.y, behind.z), strict=True):
            f = f + form.times(coordinate)
        if is_zero(ab.a):
            xc = f.root(b, joints[2], Label("shoulder"), L)
            at = b.names("m", m2.at(xc))
            xa = self._from_height(n_a, at, ab)
        elif is_zero(ab.sa):
            xc = g.root(b, joints[2], Label("shoulder"), 1.0)
            at = b.names("m", m2.at(xc))
            xa = b.pair(joints[0], product(ab.a, n_a[0]), product(ab.a, n_a[1]), f.at(xc), label=Label("wrist"), unit=L)
        else:
            across = total(product(n_a[0], n_a[0]), product(n_a[1], n_a[1]))
            e2, h2 = ab.sa**2, ab.a**2
            q = (f.times_itself().times(e2) + g.times_itself().times(h2)).plus(-e2 * h2 * across)
            xc = q.root(b, joints[2], Label("posture"), L**2)
            at = b.names("m", m2.at(xc))
            mx, my = f.at(xc) / ab.a, -g.at(xc) / ab.sa
            xa = b.onto(joints[0], (mx, my, 0), (n_a[0], n_a[1], 0), unit=1.0)
        m1 = rotate_z(xa.c, -xa.s, n_a)
        mb = (m1[0], total(product(ab.ca, m1[1]), product(ab.sa, m1[2])), at[2])
        xb = b.onto(joints[1], at, mb, unit=1.0, feasible=self._feasible(xa, xc))
        b.residual((0, 0, total(product(ab.a, m1[0]), -f.at(xc))), (0, 0, total(product(ab.sa, m1[1]), g.at(xc))))
        return [xa, xb, xc]

    def _from_height(self, n_a: Vector, m: Vector, ab: Crossing) -> Turn:
        """Solve z_b . m1 = z_b . m2 for the angle of joint a.

        The radicand of the solution is written so that no digits are lost where n is nearly parallel to z_b, as in the
        wrist of a UR arm.
        """
        radicand: S | None = None
        across = total(product(m[0], m[0]), product(m[1], m[1]))
        c2 = 2 * ab.ca * ab.ca
        if is_zero(total(n_a[2], -ab.ca)):
            radicand = across if is_zero(ab.ca) else across * (1 + m[2] - c2) / (1 + m[2])
        elif is_zero(total(n_a[2], ab.ca)):
            radicand = across * (1 - m[2] - c2) / (1 - m[2])
        return self.b.pair(
            self.frame.loop.joints[0],
            -product(ab.sa, n_a[1]),
            product(ab.sa, n_a[0]),
            total(m[2], -product(ab.ca, n_a[2])),
            label=Label("wrist"),
            unit=1.0,
            radicand=radicand,
        )

    def _feasible(self, xa: Turn, xc: Turn) -> Feasible | None:
        """Condition on the angle of joint b at targets that leave it free, its axis being parallel to the triple's.

        The distance that the two links of the triple must span depends on cos b and sin b. It has to lie between the
        difference and the sum of their lengths. None where the triple has a prismatic joint.
        """
        triple = self.frame.triple.reverse()
        if triple.types != "RRR":
            return None
        one, two, three = (element.at for element in triple.elements)
        loop = self.frame.loop
        y = apply(loop.links[1], move(xc, self.frame.trail.apply((three[0], three[1], 0))))
        s = _before(loop, self.frame, xa, one)
        upper, fore = _gap(one, two), _gap(two, three)
        return Feasible(
            total(product(y[0], y[0]), product(y[1], y[1]), product(s[0], s[0]), product(s[1], s[1])),
            -2 * total(product(s[0], y[0]), product(s[1], y[1])),
            -2 * total(product(s[1], y[0]), -product(s[0], y[1])),
            (upper - fore) ** 2,
            (upper + fore) ** 2,
        )


def _before(loop: Loop, frame: Frame, xa: Turn, point: Plane) -> Vector:
    """Convert a ``point``, given in the frame at the end of the triple, to the frame before joint b.

    ``xa`` is the cosine and sine of joint a, which lies between the two frames.
    """
    v = frame.lead.inverse().apply((point[0], point[1], 0))
    v = rotate_z(xa.c, -xa.s, v)
    return apply(loop.links[0].inverse(), v)


def _gap(a: Plane, b: Plane) -> S:
    return ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) ** 0.5


def _slide_first(b: DerivationBuilder, frame: Frame, L: float) -> list[Motion]:
    """Derive joints a, b, c where a is prismatic, so that it does not rotate the normal n of the triple.

    That the other two map n onto itself gives c and b; the height along n then gives the displacement of a.
    """
    joints = frame.loop.joints[:3]
    n_a = b.names("n", frame.lead.inverse().turn((0, 0, 1)))
    n_c = b.names("o", frame.trail.turn((0, 0, 1)))
    ab, bc = frame.loop.links[0], frame.loop.links[1].rigid()
    mb = b.names("l", rotate_by_link(ab.inverse(), n_a))
    m2 = Moving.of(joints[2], Rigid(bc.R, ORIGIN), n_c)
    k = m2.z.plus(-mb[2]).k
    across = total(product(mb[0], mb[0]), product(mb[1], mb[1]))
    xc = b.pair(joints[2], k[1], k[2], -k[0], label=Label("wrist"), unit=1.0, radicand=_sharp(n_c, bc, mb, across))
    at = b.names("m", m2.at(xc))
    xb = b.onto(joints[1], at, mb, unit=1.0)
    fixed = total(frame.lead.rigid().t[2], dot(n_c, frame.trail.rigid().t), dot(n_a, ab.rigid().t), dot(at, bc.t))
    xa = b.slide(joints[0], -fixed / n_a[2])
    return [xa, xb, xc]


def _sharp(n_c: Vector, bc: Rigid, mb: Vector, across: S) -> S | None:
    """An accurate expression for A^2 + B^2 - C^2 in the equation A cos x + B sin x = C for joint c.

    The difference itself loses digits where the normal n nearly coincides with the axis of joint b. Where the axis
    of joint c is perpendicular to n and to the axis of joint b, it equals the squared length ``across``, which loses
    none; otherwise the result is None.
    """
    quarter = is_zero(bc.R[2][2]) and is_zero(n_c[2])
    return across if quarter else None


def _slide_middle(b: DerivationBuilder, frame: Frame, L: float) -> list[Motion]:
    """Derive joints a, b, c where b is prismatic, so that it does not rotate the normal n of the triple.

    That the other two map n onto itself gives c and a; the height along n then gives the displacement of b.
    """
    joints = frame.loop.joints[:3]
    n_a = b.names("n", frame.lead.inverse().turn((0, 0, 1)))
    n_c = b.names("o", frame.trail.turn((0, 0, 1)))
    ab, bc = frame.loop.links[0].rigid(), frame.loop.links[1].rigid()
    both = ab @ bc
    k = Moving.of(joints[2], Rigid(both.R, ORIGIN), n_c)
    form = k.z.plus(-n_a[2])
    across = total(product(n_a[0], n_a[0]), product(n_a[1], n_a[1]))
    xc = b.pair(
        joints[2], form.k[1], form.k[2], -form.k[0], label=Label("wrist"), unit=1.0,
        radicand=_sharp(n_c, both, n_a, across),
    )  # fmt: skip
    at = b.names("k", k.at(xc))
    xa = b.onto(joints[0], at, n_a, unit=1.0)
    m2 = rotate(bc.R, rotate_z(xc.c, xc.s, n_c))
    m1 = rotate_z(xa.c, -xa.s, n_a)
    fixed = total(frame.lead.rigid().t[2], dot(n_c, frame.trail.rigid().t), dot(m1, ab.t), dot(m2, bc.t))
    xb = b.slide(joints[1], -fixed / b.name("mz", m2[2]))
    return [xa, xb, xc]
