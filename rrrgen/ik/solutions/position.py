"""Solver of the position problem: three joints of any kind carry a given point c to a given point p.

    J1(x1) L1 J2(x2) L2 J3(x3) c = p,     L1 = Tx(a) Rx(alpha) constant

Let v = L2 J3 c, u = J2 v and w = L1 u, so that J1 w = p. A revolute first joint changes neither the z coordinate of w
nor its distance from the origin:

    sa u_y + ca u_z = p_z,     |u|^2 + 2 a u_x + a^2 = |p|^2      (sa, ca: sine and cosine of alpha)

A prismatic first joint does not change w_x and w_y. Eliminating x2 from the two equations gives one equation in x3. It
is a quartic in general and splits into quadratics where a = 0, sin alpha = 0, cos alpha = 0 or axes are parallel. The
problem can also be stated from the other end of the chain. The solver uses the direction whose first link is constant
and whose equation is simpler.
"""

from __future__ import annotations

from dataclasses import dataclass

from rrrgen.base.errors import InternalError
from rrrgen.ik.geometry.chain import Joint, backwards, joint_types
from rrrgen.ik.geometry.rigid_transforms import (
    Crossing,
    Rigid,
    S,
    Vector,
    is_zero,
    minus,
    plus,
    product,
    rotate_z,
    screw,
    square,
    total,
)
from rrrgen.ik.recording.builder import DerivationBuilder, Label, Turn
from rrrgen.ik.solutions.joint_functions import Moving


@dataclass(frozen=True)
class Arm:
    """A position problem: find the three joint variables with ``J1 L1 J2 L2 J3 c = p``.

    ``first`` and ``second`` are the links L1 and L2, c and p points (3,) in m. A link that is constant is a
    :class:`Crossing`; one that depends on the target or on a prescribed joint is a :class:`Rigid`. ``nominal`` are the
    numbers of c where c is an input: they decide which root is labelled plus.
    """

    joints: tuple[Joint, Joint, Joint]
    first: Crossing | Rigid
    second: Crossing | Rigid
    c: Vector
    p: Vector
    nominal: Vector | None = None

    @property
    def types(self) -> str:
        """The kinds of the three joints, for example ``"RRP"``."""
        return joint_types(self.joints)

    def reverse(self) -> Arm:
        """State the problem from the other end: ``J3^-1 L2^-1 J2^-1 L1^-1 J1^-1 p = c``, joint variables negated."""
        return Arm(
            tuple(backwards(joint) for joint in reversed(self.joints)),  # type: ignore[arg-type]
            self.second.inverse(),
            self.first.inverse(),
            self.p,
            self.c,
        )


UNUSABLE = 9
"""Cost of a problem that the equations of its family cannot solve; larger than every other cost."""


def _cost(arm: Arm) -> int:
    """Rank the hardest equation of a problem: 0 (simplest) to 2 without a quartic, 4 or 5 with one, or UNUSABLE."""
    first = arm.first
    if not isinstance(first, Crossing):
        return UNUSABLE
    parallel, meet = is_zero(first.sa), is_zero(first.a)
    planar = isinstance(arm.second, Crossing) and is_zero(arm.second.sa)
    match arm.types:
        case "RRR":
            if parallel and meet:
                return UNUSABLE
            return 0 if meet and planar else 1 if parallel else 2 if meet else 4
        case "RRP":
            return UNUSABLE if parallel and meet else 1 if parallel else 2 if meet else 5
        case "RPR":
            return 1 if is_zero(first.ca) else 4
        case "PRR":
            return 1 if is_zero(first.ca) or planar else 4
        case "PRP":
            return 2 if not is_zero(first.ca) else 1
        case "RPP":
            return 2
        case "PPR":
            return UNUSABLE if parallel else 1
        case _:
            return 0


def simplest(arm: Arm) -> tuple[int, Arm]:
    """Choose the cheaper of ``arm`` and the same problem stated from its other end: (cost, arm)."""
    forward, backward = _cost(arm), _cost(arm.reverse())
    return (forward, arm) if forward <= backward else (backward, arm.reverse())


def solve_position(b: DerivationBuilder, arm: Arm, length: float) -> dict[int, Turn | S]:
    """Derive the joint motions that carry c to p, by joint index and in the direction of ``arm``.

    ``length`` (m) is the reach. Raises :class:`InternalError` where :func:`simplest` returns the cost UNUSABLE, which
    the caller must exclude.
    """
    cost, form = simplest(arm)
    if cost == UNUSABLE:
        raise InternalError("the position kernel needs a constant link")
    motions = _solve(b, form, length)
    back = {joint.index: joint for joint in form.joints}
    return {
        joint.index: motion
        if joint.sign == back[joint.index].sign
        else (Turn(motion.c, -motion.s) if isinstance(motion, Turn) else -motion)
        for joint in arm.joints
        for motion in (motions[joint.index],)
    }


def _solve(b: DerivationBuilder, arm: Arm, length: float) -> dict[int, Turn | S]:
    first, joints = arm.first, arm.joints
    if not isinstance(first, Crossing):
        raise InternalError("the position kernel needs a constant link")
    cn, sn, dn = first.near
    p = b.names("p", plus(rotate_z(cn, -sn, arm.p), (0, 0, -dn)))
    second = arm.second.rigid() if isinstance(arm.second, Crossing) else arm.second
    M2 = screw(*first.far) @ second
    v = Moving.of(joints[2], M2, arm.c)
    core = _Core(b, joints, first.a, first.ca, first.sa, v, p, length, _elbow_sign(arm))
    match arm.types:
        case "PPP":
            return _linear(b, joints, first.core(), M2, arm.c, p, length)
        case "RRR" if _cost(arm) == 0:
            return core.offset_elbow(arm, v if arm.nominal is None else Moving.of(joints[2], M2, arm.nominal))
        case "RRR" | "RRP":
            return core.turn_turn()
        case "RPR" | "RPP":
            return core.turn_slide()
        case "PRR" | "PRP":
            return core.slide_turn()
        case _:
            return core.slide_slide()


def _elbow_sign(arm: Arm) -> int:
    """Sign (+1 or -1) of the shoulder's root that is labelled plus: the one where the arm reaches forward from axis 1.

    For arms whose shoulder angle is solved first.
    """
    second = arm.second
    if isinstance(arm.first, Crossing) and not is_zero(arm.first.sa):
        return -1 if float(arm.first.sa) > 0 else 1
    if isinstance(second, Crossing) and not is_zero(second.sa):
        return -1 if float(second.sa) > 0 else 1
    return 1


@dataclass(frozen=True)
class _Core:
    """The position problem reduced to ``J1 Tx(a) Rx(alpha) J2 v(x3) = p``, with one method per kind of joints.

    ``ca`` and ``sa`` are cosine and sine of alpha; ``v`` is the point c carried by joint 3 and L2, ``length`` (m) the
    size of the arm, ``front`` the sign of the shoulder's root that is labelled plus (:func:`_elbow_sign`).
    """

    b: DerivationBuilder
    joints: tuple[Joint, Joint, Joint]
    a: S
    ca: S
    sa: S
    v: Moving
    p: Vector
    length: float
    front: int

    def offset_elbow(self, arm: Arm, stated: Moving) -> dict[int, Turn | S]:
        """Derive R R R where axes 1 and 2 meet and axes 2 and 3 are parallel: two values of x1, two of x3, one of x2.

        The offset of the arm's plane from axis 1 gives x1, the distance |p| gives x3, and x2 follows. The solution is
        (14.45) in chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005), with all four of its branches.
        ``stated`` is v with the numbers of the robot file, which decide the label of the elbow's roots.
        """
        b, joints = self.b, self.joints
        u = Moving.of(backwards(joints[0]), Rigid(*_inverse_core(self.a, self.ca, self.sa)), self.p)
        height = u.z.plus(-self.v.z.k[0])
        k0, kc, ks = height.k
        x1 = b.pair(joints[0], kc, -ks, -k0, label=Label("shoulder", self.front), unit=self.length)
        r = b.name("r", square(self.p))
        k0, kc, ks = self.v.length2.plus(-r).k
        _, cosine, sine = stated.length2.k
        sign = -1 if is_zero(sine) and _negative(cosine) else 1
        x3 = b.pair(joints[2], kc, ks, -k0, label=Label("elbow", sign), unit=self.length**2)
        at = b.names("u", u.at(Turn(x1.c, -x1.s)))
        v = b.names("v", self.v.at(x3))
        x2 = b.onto(joints[1], v, at, unit=self.length)
        return {joints[0].index: x1, joints[1].index: x2, joints[2].index: x3}

    def turn_turn(self) -> dict[int, Turn | S]:
        """Derive R R and any third joint: a quartic in x3, or two quadratics if axes 1 and 2 are parallel or meet."""
        b, joints, v, p, L = self.b, self.joints, self.v, self.p, self.length
        r = b.name("r", square(p))
        A = v.length2.times(-1).plus(total(r, -product(self.a, self.a)))
        B = v.z.times(-self.ca if not is_zero(self.ca) else 0).plus(p[2])
        if is_zero(self.sa):
            x3 = B.root(b, joints[2], Label("shoulder" if joints[2].revolute else "offset", self._first_sign()), L)
            at = b.names("v", v.at(x3))
            ux = b.name("ux", A.at(x3) / (2 * self.a))
            rho2 = b.name("rho", total(product(at[0], at[0]), product(at[1], at[1])))
            uy = b.signed_root("uy", rho2 - ux * ux, size=rho2, joint=joints[1], label=Label("elbow"), unit=L)
        elif is_zero(self.a):
            x3 = A.root(b, joints[2], Label("elbow" if joints[2].revolute else "distance"), L**2)
            at = b.names("v", v.at(x3))
            uy = b.name("uy", B.at(x3) / self.sa)
            rho2 = b.name("rho", total(product(at[0], at[0]), product(at[1], at[1])))
            ux = b.signed_root("ux", rho2 - uy * uy, size=rho2, joint=joints[1], label=Label("shoulder"), unit=L)
        else:
            rho = v.length2 - v.z.times_itself()
            e2, f2 = self.sa**2, 4 * self.a**2
            q = A.times_itself().times(e2) + B.times_itself().times(f2) - rho.times(e2 * f2)
            x3 = q.root(b, joints[2], Label("posture"), L**4)
            at = b.names("v", v.at(x3))
            ux = b.name("ux", A.at(x3) / (2 * self.a))
            uy = b.name("uy", B.at(x3) / self.sa)
        x2 = b.onto(joints[1], at, (ux, uy, at[2]), unit=L)
        return self._first_turn(x2, x3, rotate_z(x2.c, x2.s, at))

    def turn_slide(self) -> dict[int, Turn | S]:
        """Derive R P and any third joint: x2 is eliminated from the equations of height and distance."""
        b, joints, v, p, L = self.b, self.joints, self.v, self.p, self.length
        r = b.name("r", square(p))
        if is_zero(self.ca):
            x3 = v.y.times(self.sa).plus(-p[2]).root(b, joints[2], Label("offset"), L)
            at = b.names("v", v.at(x3))
            rest = b.name("rest", total(r, -square((total(at[0], self.a), at[1], 0))))
            height = b.signed_root("uz", rest, size=r, joint=joints[1], label=Label("shoulder"), unit=L)
        else:
            across = v.y.times(-self.sa).plus(p[2]).times(1 / self.ca)
            q = (v.x.times_itself() + v.y.times_itself() + across.times_itself() + v.x.times(2 * self.a)).plus(
                total(product(self.a, self.a), -r)
            )
            x3 = q.root(b, joints[2], Label("posture"), L**2)
            at = b.names("v", v.at(x3))
            height = across.at(x3)
        x2 = b.slide(joints[1], total(height, -at[2]))
        return self._first_turn(x2, x3, (at[0], at[1], total(at[2], x2)))

    def slide_turn(self) -> dict[int, Turn | S]:
        """Derive P R and any third joint: x2 is eliminated from the equations of the coordinates normal to axis 1."""
        b, joints, v, p, L = self.b, self.joints, self.v, self.p, self.length
        ux = b.name("ux", total(p[0], -self.a))
        if is_zero(self.ca):
            x3 = v.z.times(self.sa).plus(p[1]).root(b, joints[2], Label("offset"), L)
            at = b.names("v", v.at(x3))
            rho2 = b.name("rho", total(product(at[0], at[0]), product(at[1], at[1])))
            uy = b.signed_root("uy", rho2 - ux * ux, size=rho2, joint=joints[1], label=Label("elbow"), unit=L)
        else:
            across = v.z.times(self.sa).plus(p[1])
            rho = v.length2 - v.z.times_itself()
            e2 = self.ca**2
            q = (across.times_itself() + rho.times(-e2)).plus(e2 * ux * ux)
            x3 = q.root(b, joints[2], Label("posture"), L**2)
            at = b.names("v", v.at(x3))
            uy = b.name("uy", across.at(x3) / self.ca)
        x2 = b.onto(joints[1], at, (ux, uy, at[2]), unit=L)
        return self._first_slide(x2, x3, rotate_z(x2.c, x2.s, at))

    def slide_slide(self) -> dict[int, Turn | S]:
        """Derive P P and any third joint: the coordinate normal to both gives x3; x2 and x1 are then linear."""
        b, joints, v, p, L = self.b, self.joints, self.v, self.p, self.length
        x3 = v.x.plus(total(self.a, -p[0])).root(b, joints[2], Label("side"), L)
        at = b.names("v", v.at(x3))
        uz = b.name("uz", total(product(self.ca, at[1]), -p[1]) / self.sa)
        x2 = b.slide(joints[1], total(uz, -at[2]))
        return self._first_slide(x2, x3, (at[0], at[1], total(at[2], x2)))

    def _after_first(self, u: Vector) -> Vector:
        """Transform u through the first link: w = Tx(a) Rx(alpha) u."""
        return self.b.names(
            "w",
            (
                total(u[0], self.a),
                total(product(self.ca, u[1]), -product(self.sa, u[2])),
                total(product(self.sa, u[1]), product(self.ca, u[2])),
            ),
        )

    def _first_turn(self, x2: Turn | S, x3: Turn | S, u: Vector) -> dict[int, Turn | S]:
        w = self._after_first(u)
        x1 = self.b.onto(self.joints[0], w, self.p, unit=self.length)
        return {joint.index: x for joint, x in zip(self.joints, (x1, x2, x3), strict=True)}

    def _first_slide(self, x2: Turn | S, x3: Turn | S, u: Vector) -> dict[int, Turn | S]:
        w = self._after_first(u)
        x1 = self.b.slide(self.joints[0], total(self.p[2], -w[2]))
        self.b.residual((total(w[0], -self.p[0]), total(w[1], -self.p[1]), 0))
        return {joint.index: x for joint, x in zip(self.joints, (x1, x2, x3), strict=True)}

    def _first_sign(self) -> int:
        """Sign (+1 or -1) of the shoulder's root that is labelled plus, for arms whose joint 3 is solved first."""
        return self.front


def _inverse_core(a: S, ca: S, sa: S) -> tuple[tuple[Vector, Vector, Vector], Vector]:
    """Rotation and translation of ``(Tx(a) Rx(alpha))^-1``."""
    return ((1, 0, 0), (0, ca, sa), (0, -sa, ca)), (-a if not is_zero(a) else 0, 0, 0)


def _negative(x: S) -> bool:
    """Whether a constant coefficient is negative (false for a symbol)."""
    value = getattr(x, "value", x)
    return isinstance(value, (int, float)) and value < 0


def _linear(
    b: DerivationBuilder, joints: tuple[Joint, Joint, Joint], L1: Rigid, L2: Rigid, c: Vector, p: Vector, length: float
) -> dict[int, Turn | S]:
    """Derive P P P: three linear equations for the displacements along the constant directions of the joint axes."""
    origin = (L1 @ L2).apply(c)
    z1: Vector = (0, 0, 1)
    z2 = (L1.R[0][2], L1.R[1][2], L1.R[2][2])
    M = L1 @ L2
    z3 = (M.R[0][2], M.R[1][2], M.R[2][2])
    rest = b.names("d", minus(p, origin))
    x1, x2, x3 = solve_linear((z1, z2, z3), rest)
    return {joint.index: b.slide(joint, x) for joint, x in zip(joints, (x1, x2, x3), strict=True)}


def solve_linear(columns: tuple[Vector, Vector, Vector], right: Vector) -> Vector:
    """Solve the 3 x 3 system ``columns x = right`` by Cramer's rule."""

    def triple(a: Vector, b: Vector, c: Vector) -> S:
        return total(
            product(a[0], total(product(b[1], c[2]), -product(b[2], c[1]))),
            product(a[1], total(product(b[2], c[0]), -product(b[0], c[2]))),
            product(a[2], total(product(b[0], c[1]), -product(b[1], c[0]))),
        )

    whole = triple(*columns)
    z1, z2, z3 = columns
    return (triple(right, z2, z3) / whole, triple(z1, right, z3) / whole, triple(z1, z2, right) / whole)
