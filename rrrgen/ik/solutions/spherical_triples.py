"""Six-joint arms with a spherical triple: three consecutive revolute axes through one point, anywhere in the chain.

The loop equation is numbered so that the triple comes last. The triple does not move its centre, so the other three
joints must carry that point to a known place (:mod:`rrrgen.ik.solutions.position`). Then the triple supplies the
remaining rotation.
"""

from __future__ import annotations

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.loop import Closing, Loop, Motion, apply, rotate_by_link, rotated_back, straighten, unwind
from rrrgen.ik.geometry.rigid_transforms import (
    Crossing,
    Rotation,
    S,
    Vector,
    cross,
    dot,
    is_zero,
    minus,
    plus,
    product,
    rotate,
    rotate_x,
    rotate_z,
    square,
    total,
)
from rrrgen.ik.recording.builder import DerivationBuilder, Label, Turn
from rrrgen.ik.solutions.position import Arm, solve_position


def is_spherical(loop: Loop, k: int) -> bool:
    """Whether joints k, k+1, k+2 of ``loop`` are revolute and their axes meet exactly in one point."""
    joints, links = loop.start_at(k).joints[:3], loop.start_at(k).links[:2]
    if not all(joint.revolute for joint in joints) or not all(isinstance(link, Crossing) for link in links):
        return False
    first, second = links
    assert isinstance(first, Crossing)
    assert isinstance(second, Crossing)
    meet = is_zero(first.a) and is_zero(second.a) and is_zero(total(first.far[2], second.near[2]))
    return meet and not is_zero(first.sa) and not is_zero(second.sa)


def arm_of(loop: Loop) -> Arm:
    """Position problem of the first three joints of a loop whose last three joints are the spherical triple."""
    first, second = loop.links[3], loop.links[4]
    assert isinstance(first, Crossing)
    assert isinstance(second, Crossing)
    c = apply(loop.links[2], (0, 0, first.near[2]))
    p = apply(loop.links[5].inverse(), (0, 0, -second.far[2] if not is_zero(second.far[2]) else 0))
    links = tuple(link.rigid() if isinstance(link, Closing) else link for link in loop.links[:2])
    return Arm((loop.joints[0], loop.joints[1], loop.joints[2]), links[0], links[1], c, p)


def derive_spherical(b: DerivationBuilder, loop: Loop, k: int, length: float) -> None:
    """Derive all joints of a six-joint loop with a spherical triple at joints k, k+1, k+2; ``length`` is the reach."""
    loop = straighten(loop.start_at((k + 3) % 6))
    arm = arm_of(loop)
    motions = solve_position(b, arm, length)
    moved: list[Motion] = [motions[joint.index] for joint in loop.joints[:3]]
    path = unwind([(moved[i], turned_matrix(loop, i)) for i in range(3)], b.name)
    closing = loop.links[5].inverse()
    columns = [rotated_back(path, rotate_by_link(closing, axis)) for axis in ((1, 0, 0), (0, 0, 1))]
    mx, mz = b.names("m", columns[0]), b.names("n", columns[1])
    first, second = loop.links[3], loop.links[4]
    assert isinstance(first, Crossing)
    assert isinstance(second, Crossing)
    wrist = (loop.joints[3], loop.joints[4], loop.joints[5])
    solve_wrist(b, wrist, first, second, mx, mz)


def turned_matrix(loop: Loop, i: int) -> Rotation:
    """Rotation matrix of link ``i`` of the loop."""
    return loop.links[i].rigid().R


def solve_wrist(
    b: DerivationBuilder, joints: tuple[Joint, Joint, Joint], first: Crossing, second: Crossing, mx: Vector, mz: Vector
) -> dict[int, Motion]:
    """Derive the angles of a spherical triple from the rotation that it must produce: two solutions.

    ``Rz(x4) Rx(alpha4) Rz(x5) Rx(alpha5) Rz(x6) = M``, where ``mx`` and ``mz`` are the first and third columns of M;
    ``first`` and ``second`` are the links with the angles alpha4 and alpha5. Returns the motions by joint index.
    """
    if is_zero(first.ca) and is_zero(second.ca):
        signs = (1 if _positive(first.sa) else -1, 1 if _positive(second.sa) else -1)
        M = tuple((mx[i], 0, mz[i]) for i in range(3))
        turns = b.wrist(joints, (M[0], M[1], M[2]), signs)
        return {joint.index: turn for joint, turn in zip(joints, turns, strict=True)}
    c4, s4, c5, s5 = first.ca, first.sa, second.ca, second.sa
    A = -product(s4, s5)
    C = total(mz[2], -product(c4, c5))
    across = total(product(mz[0], mz[0]), product(mz[1], mz[1]))
    radicand: S | None = None
    if is_zero(total(c4, -c5)):
        radicand = across * (1 - 2 * c4 * c4 + mz[2]) / (1 + mz[2])
    elif is_zero(total(c4, c5)):
        radicand = across * (1 - 2 * c4 * c4 - mz[2]) / (1 - mz[2])
    sign = -1 if not _positive(A) else 1
    x5 = b.pair(joints[1], A, 0, C, label=Label("wrist", sign), unit=1.0, radicand=radicand)
    axis = rotate_x(c4, s4, rotate_z(x5.c, x5.s, (0, -s5, c5)))
    x4 = b.onto(joints[0], axis, mz, unit=1.0)
    columns = [rotate_z(x4.c, x4.s, rotate_x(c4, s4, rotate_z(x5.c, x5.s, v))) for v in ((1, 0, 0), (0, c5, s5))]
    x6 = b.turn(joints[2], dot(columns[1], mx), dot(columns[0], mx))
    built: Vector = tuple(
        total(product(x6.c, u), product(x6.s, v)) for u, v in zip(columns[0], columns[1], strict=True)
    )
    b.residual((), minus(built, mx))
    return {joint.index: turn for joint, turn in zip(joints, (x4, x5, x6), strict=True)}


def _positive(x: S) -> bool:
    return bool(x > 0)


# ------------------------------------------------------------------------------------------------------------------
# Seven-joint arms with a spherical shoulder, one elbow joint and a spherical wrist, solved for a given arm angle.
#
# S is the centre of the shoulder, W that of the wrist, E the elbow. The upper arm S E lies along joint axis 3 and the
# forearm E W along joint axis 5. Their lengths are constants of the robot; |SW| follows from the target.
#
# The arm angle psi (rad) rotates E about the line S W, whose direction is e = (W - S)/|W - S|. It is zero where E
# lies on the side of the vector k x e, with k = (e - t) x r the stereographic reference of arXiv 2307.13122 for two
# constant unit vectors t and r perpendicular to each other. Here t = -z and r = x in the frame before joint 1. The
# reference is undefined only at the single direction e = t.
# ------------------------------------------------------------------------------------------------------------------


def is_elbow7(loop: Loop) -> bool:
    """Whether joints 1-3 and 5-7 are spherical triples and the elbow axis meets axes 3 and 5 at one point."""
    if len(loop.joints) != 7 or "P" in loop.types:
        return False
    if not (is_spherical(loop, 0) and is_spherical(loop, 4)):
        return False
    third, fourth = loop.links[2], loop.links[3]
    assert isinstance(third, Crossing)
    assert isinstance(fourth, Crossing)
    flat = is_zero(third.a) and is_zero(fourth.a) and is_zero(fourth.near[2])
    flat = flat and not is_zero(third.sa) and not is_zero(fourth.sa)
    lengths = not is_zero(third.near[2]) and not is_zero(loop.links[4].near[2])  # type: ignore[union-attr]
    return flat and lengths


def derive_elbow7(b: DerivationBuilder, loop: Loop, psi: Turn, length: float) -> None:
    """Derive all seven joints for the arm angle ``psi`` (its cosine and sine).

    Elbow, shoulder and wrist have two solutions each, eight in all. ``length`` (m), the size of the arm, is not used.
    """
    j1, j2, j3, j4 = loop.joints[:4]
    l1, l2, l3, l4, l5, l6 = (link for link in loop.links[:6] if isinstance(link, Crossing))
    upper, fore = l3.near[2], l5.near[2]  # signed: along z3 from S to E, along z5 from E to W
    S_: Vector = (0, 0, l1.near[2])
    back = loop.links[6].inverse()
    W = apply(back, (0, 0, 0))
    sw = b.names("p", minus(W, S_))
    r2 = b.name("r", square(sw))
    # |SW|^2 = upper^2 + fore^2 + 2 upper fore (z3 . z5), and z5 is Rx(alpha3) Rz(x4) Rx(alpha4) e_z behind joint 3
    bend = b.name("k", total(r2, -(upper**2), -(fore**2)) / (2 * upper * fore))
    A = -product(l3.sa, l4.sa)
    sign = 1 if A > 0 else -1
    x4 = b.pair(j4, A, 0, total(bend, -product(l3.ca, l4.ca)), label=Label("elbow", sign), unit=1.0)
    size = b.name("w", b.sqrt(r2))
    e = b.names("e", (sw[0] / size, sw[1] / size, sw[2] / size))
    # reference direction k = (e - t) x r with t = -z, r = x of the frame before joint 1
    k = cross((e[0], e[1], total(e[2], 1)), (1, 0, 0))
    n = cross(k, e)
    n_size = b.name("n", b.sqrt(square(n)))
    y = b.names("y", (n[0] / n_size, n[1] / n_size, n[2] / n_size))
    z = b.names("z", cross(e, y))
    across = plus(_times(psi.c, y), _times(psi.s, z))
    # elbow position E = S + along e + high across
    along = b.name("along", (upper**2 + upper * fore * bend) / size)
    high = b.name("high", abs(upper * fore) * b.sqrt((1 - bend) * (1 + bend)) / size)
    elbow = b.names("f", plus(_times(along / abs(upper), e), _times(high / abs(upper), across)))
    sense = 1 if upper > 0 else -1
    z3: Vector = (sense * elbow[0], sense * elbow[1], sense * elbow[2])
    # shoulder: z3 = Rz(x1) Rx(a1) Rz(x2) Rx(a2) e_z
    A2 = -product(l1.sa, l2.sa)
    C2 = total(z3[2], -product(l1.ca, l2.ca))
    flat = total(product(z3[0], z3[0]), product(z3[1], z3[1]))
    radicand = flat if is_zero(l1.ca) and is_zero(l2.ca) else None
    x2 = b.pair(j2, A2, 0, C2, label=Label("shoulder", 1 if A2 > 0 else -1), unit=1.0, radicand=radicand)
    axis = _rx(l1, rotate_z(x2.c, x2.s, _rx(l2, (0, 0, 1))))
    x1 = b.onto(j1, axis, z3, unit=1.0)
    # x3 turns the forearm of the zero position onto its direction as seen from link 2
    path = unwind([(x1, l1.core().R), (x2, l2.core().R)], b.name)
    fore_dir = _times(1 / fore, minus(sw, _times(upper, z3)))
    seen = b.names("g", rotated_back(path, fore_dir))
    behind = _rx(l3, rotate_z(x4.c, x4.s, _rx(l4, (0, 0, 1))))
    x3 = b.onto(j3, behind, seen, unit=1.0)
    path = unwind([(x1, l1.core().R), (x2, l2.core().R), (x3, l3.core().R), (x4, l4.core().R)], b.name)
    mx = b.names("m", rotated_back(path, rotate_by_link(back, (1, 0, 0))))
    mz = b.names("n", rotated_back(path, rotate_by_link(back, (0, 0, 1))))
    solve_wrist(b, (loop.joints[4], loop.joints[5], loop.joints[6]), l5, l6, mx, mz)


def _times(factor: object, v: Vector) -> Vector:
    return (product(factor, v[0]), product(factor, v[1]), product(factor, v[2]))


def _rx(link: Crossing, v: Vector) -> Vector:
    return rotate(link.core().R, v)
