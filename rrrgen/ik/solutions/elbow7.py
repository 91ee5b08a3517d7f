"""Seven-joint arms with a spherical shoulder, one elbow joint and a spherical wrist, solved for a given arm angle.

S is the centre of the shoulder, W that of the wrist, E the elbow. The upper arm S E lies along joint axis 3 and the
forearm E W along joint axis 5. Their lengths are constants of the robot; |SW| follows from the target.

The arm angle psi (rad) rotates E about the line S W, whose direction is e = (W - S)/|W - S|. It is zero where E lies
on the side of the vector k x e, with k = (e - t) x r the stereographic reference of arXiv 2307.13122 for two constant
unit vectors t and r perpendicular to each other. Here t = -z and r = x in the frame before joint 1. The reference is
undefined only at the single direction e = t.
"""

from __future__ import annotations

from rrrgen.ik.geometry.loop import Loop, apply, rotated_back, turned, unwind
from rrrgen.ik.geometry.rigid_transforms import (
    Crossing,
    Vector,
    cross,
    is_zero,
    minus,
    plus,
    product,
    rotate,
    rotate_z,
    square,
    total,
)
from rrrgen.ik.recording.builder import Builder, Label, Turn
from rrrgen.ik.solutions.spherical import is_spherical, solve_wrist


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


def derive_elbow7(b: Builder, loop: Loop, psi: Turn, length: float) -> None:
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
    mx = b.names("m", rotated_back(path, turned(back, (1, 0, 0))))
    mz = b.names("n", rotated_back(path, turned(back, (0, 0, 1))))
    solve_wrist(b, (loop.joints[4], loop.joints[5], loop.joints[6]), l5, l6, mx, mz)


def _times(factor: object, v: Vector) -> Vector:
    return (product(factor, v[0]), product(factor, v[1]), product(factor, v[2]))


def _rx(link: Crossing, v: Vector) -> Vector:
    return rotate(link.core().R, v)
