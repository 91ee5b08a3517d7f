"""Planar triples: three consecutive joints that move a body in a plane, and the closed forms that solve them.

The axes of revolute joints are normal to the plane, those of prismatic joints lie in it. In a frame whose z axis is the
normal n the triple is a product of exponentials, ``J1 N1 J2 N2 J3 = Q e1 e2 e3 E0``: ``E0`` is the constant transform
at zero joint values, ``e`` of a revolute joint is a rotation about a point of the plane, ``e`` of a prismatic joint a
translation along a unit vector of the plane. For antiparallel axes the joint variable changes its sign.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from rrrgen.base.errors import InternalError
from rrrgen.ik.geometry.chain import Joint, backwards
from rrrgen.ik.geometry.loop import Loop, Motion
from rrrgen.ik.geometry.rigid_transforms import Crossing, Rigid, S, Vector, is_zero, product, rotate_z, screw, total
from rrrgen.ik.recording.builder import DerivationBuilder, Label, Turn
from rrrgen.ik.tolerances import EXACT

Plane = tuple[S, S]


@dataclass(frozen=True)
class PlaneMotion:
    """One joint of the triple: a rotation about the point ``at`` or a translation along the unit vector ``at``.

    ``at`` is in plane coordinates.
    """

    joint: Joint
    at: Plane


@dataclass(frozen=True)
class Triple:
    """The planar triple ``Q e1 e2 e3 E0``, where ``elements`` are the motions e1, e2, e3 of its joints in the plane.

    ``Q`` maps plane coordinates to the frame before the first joint; ``E0`` is the constant transform after the joints.
    """

    elements: tuple[PlaneMotion, PlaneMotion, PlaneMotion]
    Q: Rigid
    E0: Rigid

    @property
    def types(self) -> str:
        """The kinds of the three joints, for example ``"RPR"``."""
        return "".join("R" if element.joint.revolute else "P" for element in self.elements)

    def reverse(self) -> Triple:
        """Invert ``e1 e2 e3``: joints in reverse order with negated variables, the same ``Q`` and ``E0``."""
        turned = [replace(e, joint=backwards(e.joint)) for e in reversed(self.elements)]
        return replace(self, elements=(turned[0], turned[1], turned[2]))


def triple_of(loop: Loop, k: int) -> Triple | None:
    """Find the planar triple of joints k, k+1, k+2 of ``loop``; None where they do not move in one plane."""
    started = loop.start_at(k)
    joints, links = started.joints[:3], started.links[:2]
    if not any(joint.revolute for joint in joints):
        return None
    first, second = links
    if not (isinstance(first, Crossing) and isinstance(second, Crossing)):
        return None
    frames = [screw(1, 0), first.rigid(), first.rigid() @ second.rigid()]
    axes = [(frame.R[0][2], frame.R[1][2], frame.R[2][2]) for frame in frames]
    normal = next(axis for axis, joint in zip(axes, joints, strict=True) if joint.revolute)
    Q = _plane(normal)
    back = Q.inverse()
    elements = []
    for joint, frame in zip(joints, frames, strict=True):
        local = back @ frame
        axis = (local.R[0][2], local.R[1][2], local.R[2][2])
        if joint.revolute:
            if not (_flat(axis[0]) and _flat(axis[1])):
                return None
            sense = 1 if axis[2] > 0 else -1
            signed = joint if sense > 0 else backwards(joint)
            elements.append(PlaneMotion(signed, (local.t[0], local.t[1])))
        else:
            if not _flat(axis[2]):
                return None
            elements.append(PlaneMotion(joint, (axis[0], axis[1])))
    triple = Triple((elements[0], elements[1], elements[2]), Q, back @ frames[2])
    return triple if _moves(triple) else None


def _plane(n: Vector) -> Rigid:
    """Rotation to a frame whose z axis is the unit vector ``n``; its x axis is perpendicular to the old z axis."""
    if is_zero(n[0]) and is_zero(n[1]):
        return (
            Rigid(((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0, 0, 0))
            if n[2] > 0
            else Rigid(((1, 0, 0), (0, -1, 0), (0, 0, -1)), (0, 0, 0))
        )
    h = (n[0] * n[0] + n[1] * n[1]) ** 0.5
    x = (-n[1] / h, n[0] / h, 0)
    y = (
        total(product(n[1], x[2]), -product(n[2], x[1])),
        total(product(n[2], x[0]), -product(n[0], x[2])),
        total(product(n[0], x[1]), -product(n[1], x[0])),
    )
    return Rigid(((x[0], y[0], n[0]), (x[1], y[1], n[1]), (x[2], y[2], n[2])), (0, 0, 0))


def _flat(x: S) -> bool:
    """Whether a component of an axis is zero, up to the rounding of a product of rotations."""
    if isinstance(x, (int, float)):
        return abs(x) < EXACT
    return is_zero(x)


def _moves(triple: Triple) -> bool:
    """Whether neighbouring joints are independent: no two coincident axes, no two parallel translations."""
    a, b, c = triple.elements
    for one, other in ((a, b), (b, c)):
        if one.joint.revolute and other.joint.revolute and _same(one.at, other.at):
            return False
        if not one.joint.revolute and not other.joint.revolute and is_zero(_area(one.at, other.at)):
            return False
    return True


def _same(a: Plane, b: Plane) -> bool:
    return is_zero(total(a[0], -b[0])) and is_zero(total(a[1], -b[1]))


def _area(a: Plane, b: Plane) -> S:
    return total(product(a[0], b[1]), -product(a[1], b[0]))


def _inner(a: Plane, b: Plane) -> S:
    return total(product(a[0], b[0]), product(a[1], b[1]))


def _less(a: Plane, b: Plane) -> Plane:
    return (total(a[0], -b[0]), total(a[1], -b[1]))


def _spun(x: Turn, v: Plane) -> Plane:
    moved = rotate_z(x.c, x.s, (v[0], v[1], 0))
    return (moved[0], moved[1])


def orient_triple(triple: Triple) -> tuple[bool, Triple]:
    """Reverse the triple if that makes its last joint revolute: (whether it was reversed, triple)."""
    if triple.elements[2].joint.revolute or not triple.elements[0].joint.revolute:
        return False, triple
    return True, triple.reverse()


def anchor(triple: Triple) -> Plane:
    """The point of the plane that the last joint does not move; the origin where that joint is prismatic."""
    last = triple.elements[2]
    return last.at if last.joint.revolute else (0, 0)


def solve_planar(
    b: DerivationBuilder, triple: Triple, point: Plane, rotation: Turn, length: float
) -> dict[int, Motion]:
    """Derive the joints that rotate the plane by ``rotation`` and carry the point :func:`anchor` to ``point``.

    ``point`` is in plane coordinates (m), ``length`` (m) is the size of the arm. Returns the motions by joint index.
    """
    solver: dict[str, Callable[..., dict[int, Motion]]] = {
        "RRR": _turn_turn, "RPR": _turn_slide, "PRR": _slide_turn, "PPR": _slide_slide, "PRP": _around,
    }  # fmt: skip
    if triple.types not in solver:
        raise InternalError(f"a planar triple {triple.types} must be walked backwards")
    return solver[triple.types](b, triple, point, rotation, length)


def _last(b: DerivationBuilder, joint: Joint, rotation: Turn, *before: Turn) -> Turn:
    """Derive the last angle: the whole ``rotation`` minus the angles ``before`` it."""
    c, s = rotation
    for x in before:
        c, s = total(product(c, x.c), product(s, x.s)), total(product(s, x.c), -product(c, x.s))
    return b.turn(joint, s, c)


def _turn_turn(b: DerivationBuilder, triple: Triple, point: Plane, rotation: Turn, L: float) -> dict[int, Motion]:
    """Derive R R R: the law of cosines gives x2 from the distance of the first and the last axis; x1 and x3 follow."""
    one, two, three = triple.elements
    upper, fore = _less(two.at, one.at), _less(three.at, two.at)
    aim = _less(point, one.at)
    aim = (b.name("a_x", aim[0]), b.name("a_y", aim[1]))
    reach2 = _inner(aim, aim)
    # |upper + R(x2) fore|^2 = |aim|^2
    A, B = product(2, _inner(upper, fore)), product(-2, _area(upper, fore))
    C = total(reach2, -_inner(upper, upper), -_inner(fore, fore))
    label = Label("elbow", -1 if is_zero(B) and A < 0 else 1)
    x2 = b.pair(two.joint, A, B, C, label=label, unit=L**2)
    moved = _spun(x2, fore)
    w = (b.name("w_x", total(upper[0], moved[0])), b.name("w_y", total(upper[1], moved[1])))
    x1 = b.onto(one.joint, (*w, 0), (*aim, 0), unit=L)
    x3 = _last(b, three.joint, rotation, x1, x2)
    return {one.joint.index: x1, two.joint.index: x2, three.joint.index: x3}


def _turn_slide(b: DerivationBuilder, triple: Triple, point: Plane, rotation: Turn, L: float) -> dict[int, Motion]:
    """Derive R P R: the distance of the first and last axis gives the displacement (a quadratic); x1 and x3 follow."""
    one, two, three = triple.elements
    start, aim = _less(three.at, one.at), _less(point, one.at)
    t = b.polynomial(
        two.joint,
        (total(_inner(start, start), -_inner(aim, aim)), 2 * _inner(start, two.at), 1),
        label=Label("elbow"),
        unit=L,
    )
    w = (total(start[0], product(t, two.at[0])), total(start[1], product(t, two.at[1])))
    x1 = b.onto(one.joint, (*w, 0), (*aim, 0), unit=L)
    x3 = _last(b, three.joint, rotation, x1)
    return {one.joint.index: x1, two.joint.index: t, three.joint.index: x3}


def _slide_turn(b: DerivationBuilder, triple: Triple, point: Plane, rotation: Turn, L: float) -> dict[int, Motion]:
    """Derive P R R: the target point lies on a circle about axis 2, whose radius gives a quadratic in x1."""
    one, two, three = triple.elements
    arm, aim = _less(three.at, two.at), _less(point, two.at)
    t = b.polynomial(
        one.joint,
        (total(_inner(aim, aim), -_inner(arm, arm)), -2 * _inner(aim, one.at), 1),
        label=Label("elbow"),
        unit=L,
    )
    w = _less(aim, (product(t, one.at[0]), product(t, one.at[1])))
    x2 = b.onto(two.joint, (*arm, 0), (*w, 0), unit=L)
    x3 = _last(b, three.joint, rotation, x2)
    return {one.joint.index: t, two.joint.index: x2, three.joint.index: x3}


def _slide_slide(b: DerivationBuilder, triple: Triple, point: Plane, rotation: Turn, L: float) -> dict[int, Motion]:
    """Derive P P R: the position of the last axis gives two linear equations for the displacements x1 and x2."""
    one, two, three = triple.elements
    aim = _less(point, three.at)
    whole = _area(one.at, two.at)
    t1 = b.slide(one.joint, _area(aim, two.at) / whole)
    t2 = b.slide(two.joint, _area(one.at, aim) / whole)
    x3 = b.turn(three.joint, rotation.s, rotation.c)
    return {one.joint.index: t1, two.joint.index: t2, three.joint.index: x3}


def _around(b: DerivationBuilder, triple: Triple, point: Plane, rotation: Turn, L: float) -> dict[int, Motion]:
    """Derive P R P: the rotation gives x2; ``point``, the image of the origin, gives linear equations for x1 and x3."""
    one, two, three = triple.elements
    x2 = b.turn(two.joint, rotation.s, rotation.c)
    away = _spun(x2, two.at)
    rest = (total(point[0], -two.at[0], away[0]), total(point[1], -two.at[1], away[1]))
    direction = _spun(x2, three.at)
    whole = _area(one.at, direction)
    t1 = b.slide(one.joint, _area(rest, direction) / whole)
    t3 = b.slide(three.joint, _area(one.at, rest) / whole)
    return {one.joint.index: t1, two.joint.index: x2, three.joint.index: t3}
