"""Closed forms for arms with fewer than six joints, and for arms whose orientation depends on three joints only.

* planar arms (three joints in a plane) and planar arms with a lift (four joints: x, y, z and one rotation);
* three revolute joints that set the orientation, alone (spherical wrists) or with three prismatic joints (gantries);
* position tasks of one and two joints.
"""

from __future__ import annotations

from rrrgen.base.errors import InternalError
from rrrgen.ik.geometry.chain import Joint, KinematicChain, Matrix
from rrrgen.ik.geometry.loop import AnyLink, Closing, Loop, Motion, apply, factors, move, rotate_by_link, straighten
from rrrgen.ik.geometry.rigid_transforms import (
    Crossing,
    Rigid,
    Rotation,
    S,
    Vector,
    dot,
    is_zero,
    minus,
    product,
    rigid,
    rotate,
    screw,
    square,
    total,
    transpose,
)
from rrrgen.ik.recording.builder import DerivationBuilder, Label, Turn
from rrrgen.ik.solutions.joint_functions import JointFunction, Moving
from rrrgen.ik.solutions.parallel import Frame, finish_plane
from rrrgen.ik.solutions.planar import triple_of
from rrrgen.ik.solutions.position import solve_linear
from rrrgen.ik.solutions.spherical_triples import solve_wrist
from rrrgen.ik.tolerances import EXACT

IDENTITY = screw(1, 0)


def derive_planar(b: DerivationBuilder, loop: Loop, length: float) -> None:
    """Derive a planar arm of three joints from x, y and the angle in its plane.

    A residual checks that the target lies in the plane. ``length`` (m) is the size of the arm.
    """
    loop = straighten(loop)
    triple = triple_of(loop, 0)
    if triple is None:
        raise InternalError("there is no planar triple here")
    lead = Closing((triple.E0, *factors(loop.links[2]), triple.Q))
    frame = Frame(triple, Loop((), ()), lead, Closing((IDENTITY,)))
    upright(b, frame, [])
    finish_plane(b, frame, [], length)


def derive_lift(b: DerivationBuilder, loop: Loop, k: int, length: float) -> None:
    """Derive a SCARA arm: a planar triple at joints k, k+1, k+2 and a prismatic joint along its normal."""
    loop = straighten(loop)
    frame = Frame.of(loop, k)
    if frame is None:
        raise InternalError("there is no planar triple here")
    n = frame.lead.inverse().turn((0, 0, 1))
    fixed = total(frame.lead.rigid().t[2], dot(n, apply(frame.trail, (0, 0, 0))))
    t = b.slide(frame.loop.joints[0], -fixed / n[2])
    upright(b, frame, [t])
    finish_plane(b, frame, [t], length)


def upright(b: DerivationBuilder, frame: Frame, motions: list[Motion]) -> None:
    """Record as a residual how far the z axis of the target is from the normal of the plane of the triple.

    No joint can tilt it, or turn it over, so a target has solutions only where they agree.
    """
    v = frame.trail.turn((0, 0, 1))
    for motion in motions:
        v = move(motion, v, direction=True)
    v = frame.lead.turn(v)
    b.residual((), (v[0], v[1], total(v[2], -1)))


def turning_axes(loop: Loop) -> Loop | None:
    """Reduce a loop to the rotations of its three revolute joints, without translations.

    None where there are not three revolute joints, or where two neighbouring axes with a constant link are parallel.
    """
    places = [i for i, joint in enumerate(loop.joints) if joint.revolute]
    if len(places) != 3:
        return None
    links: list[AnyLink] = []
    for here, there in zip(places, [*places[1:], places[0] + len(loop.joints)], strict=True):
        path = [loop.links[i % len(loop.joints)] for i in range(here, there)]
        if any(isinstance(link, Closing) for link in path):
            links.append(Closing(tuple(Rigid(f.R, (0, 0, 0)) for link in path for f in factors(link))))
        else:
            rotation = factors(path[0])[0].R
            for link in path[1:]:
                rotation = (Rigid(rotation, (0, 0, 0)) @ link.rigid()).R
            crossing = decompose_rotation(rotation)
            if crossing is None:
                return None
            links.append(crossing)
    return straighten(Loop(tuple(loop.joints[i] for i in places), tuple(links)))


def decompose_rotation(R: Rotation) -> Crossing | None:
    """Decompose a constant rotation as ``Rz Rx Rz``; None where it is a rotation about z alone."""
    ca = R[2][2]
    if is_zero(R[2][1]) and is_zero(R[2][0]):
        return None
    if is_zero(R[0][2]) and is_zero(R[2][0]):  # Rx already
        return Crossing((1, 0, 0), 0, ca, R[2][1], (1, 0, 0))
    sa = (R[0][2] ** 2 + R[1][2] ** 2) ** 0.5
    if sa < EXACT:
        return None
    near = (-R[1][2] / sa, R[0][2] / sa, 0)
    far = (R[2][1] / sa, R[2][0] / sa, 0)
    return Crossing(near, 0, ca, sa, far)


def derive_orientation(b: DerivationBuilder, loop: Loop, length: float) -> None:
    """Derive three revolute joints from the orientation, then three prismatic ones (if any) from linear equations."""
    axes = turning_axes(loop)
    if axes is None:
        raise InternalError("the rotation is not decided by three joints")
    first, second, closing = axes.links
    if not isinstance(first, Crossing) or not isinstance(second, Crossing):
        raise InternalError("two of the axes that decide the rotation are parallel")
    back = closing.inverse()
    mx, mz = b.names("m", rotate_by_link(back, (1, 0, 0))), b.names("n", rotate_by_link(back, (0, 0, 1)))
    turns = solve_wrist(b, (axes.joints[0], axes.joints[1], axes.joints[2]), first, second, mx, mz)
    if len(loop.joints) == 3:
        b.residual(apply(loop.links[2], (0, 0, 0)) if not isinstance(loop.links[2], Crossing) else (0, 0, 0))
        return
    offsets = {a.index: a.offset - j.offset for a in axes.joints for j in loop.joints if j.index == a.index}
    motions = [
        _subtract_offset(turns[joint.index], offsets[joint.index]) if joint.revolute else 0 for joint in loop.joints
    ]
    v: Vector = (0, 0, 0)
    directions: list[Vector] = []
    for i in reversed(range(len(loop.joints))):
        joint = loop.joints[i]
        v = move(motions[i], apply(loop.links[i], v))
        directions = [move(motions[i], rotate_by_link(loop.links[i], d), direction=True) for d in directions]
        if not joint.revolute:
            directions.insert(0, (0, 0, 1))
    v = b.names("d", v)
    columns = tuple(b.names("z", d) for d in directions)
    right: Vector = (-v[0], -v[1], -v[2])
    sliding = [joint for joint in loop.joints if not joint.revolute]
    solution = solve_linear((columns[0], columns[1], columns[2]), right)
    moved = [b.slide(joint, x) for joint, x in zip(sliding, solution, strict=True)]
    rest = [total(v[i], *(product(x, z[i]) for x, z in zip(moved, columns, strict=True))) for i in range(3)]
    b.residual((rest[0], rest[1], rest[2]))


def _subtract_offset(motion: Motion, offset: S) -> Motion:
    """Subtract ``offset`` (rad) from the angle of ``motion``; a displacement is returned as it is.

    Straightening a loop (:func:`rrrgen.ik.geometry.loop.straighten`) has added the offset to the joint's angle.
    """
    from math import cos, sin

    if not isinstance(motion, Turn) or is_zero(offset):
        return motion
    c, s = cos(float(offset)), sin(float(offset))
    return Turn(total(product(c, motion.c), product(s, motion.s)), total(product(c, motion.s), -product(s, motion.c)))


def derive_point(b: DerivationBuilder, chain: KinematicChain, length: float, last_link: Matrix | None = None) -> None:
    """Derive one or two joints from the position of the tip.

    The conditions that the target lies on the curve or surface traced by the tip become residuals. With a
    ``last_link``, the tip is the tool that the builder has as an input, carried by that transform.
    """
    base, stated = rigid(chain.base), rigid(chain.tip).t
    c = stated if last_link is None else b.names("c", rigid(last_link).apply(b.tool()))
    p = b.names("p", rotate(transpose(base.R), minus(b.point(), base.t)))
    if chain.n == 1:
        joint = chain.joints[0]
        if joint.revolute:
            b.onto(joint, c, p, unit=length)
        else:
            b.slide(joint, total(p[2], -c[2]))
            b.residual((total(c[0], -p[0]), total(c[1], -p[1]), 0))
        return
    one, two = chain.joints
    link = Crossing.of(chain.links[0]).rigid()
    w, like = Moving.of(two, link, c), Moving.of(two, link, stated)
    if one.revolute:
        x2 = _best(b, two, [(w.z.plus(-p[2]), like.z, length), (w.length2.plus(-square(p)), like.length2, length**2)])
        at = b.names("w", w.at(x2))
        b.onto(one, at, p, unit=length)
    else:
        x2 = _best(b, two, [(w.x.plus(-p[0]), like.x, length), (w.y.plus(-p[1]), like.y, length)])
        at = b.names("w", w.at(x2))
        b.slide(one, total(p[2], -at[2]))
        b.residual((total(at[0], -p[0]), total(at[1], -p[1]), 0))


def _best(b: DerivationBuilder, joint: Joint, equations: list[tuple[JointFunction, JointFunction, float]]) -> Motion:
    """Solve for ``joint`` the one of several equations that depends most strongly on it.

    ``equations`` holds (form, like, unit): the function of the joint that must vanish, a function with the same
    dependence on the joint in the numbers of the robot file, and the natural size of the terms.
    """

    def slope(entry: tuple[JointFunction, JointFunction, float]) -> float:
        _, form, unit = entry
        first = sum(abs(float(k)) for k in form.k[1 : 2 if not form.turning else 3])
        length = unit if len(form.k) == 2 else unit**0.5
        return first / unit if form.turning else first * length / unit

    form, _, unit = max(equations, key=slope)
    return form.root(b, joint, Label("elbow"), unit)
