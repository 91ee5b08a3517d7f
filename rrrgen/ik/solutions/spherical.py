"""Six-joint arms with a spherical triple: three consecutive revolute axes through one point, anywhere in the chain.

The loop equation is numbered so that the triple comes last. The triple does not move its centre, so the other three
joints must carry that point to a known place (:mod:`rrrgen.ik.solutions.position`). Then the triple supplies the
remaining rotation.
"""

from __future__ import annotations

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.loop import Closing, Loop, Motion, apply, rotated_back, straightened, turned, unwind
from rrrgen.ik.geometry.rigid_transforms import (
    Crossing,
    Rotation,
    S,
    Vector,
    dot,
    is_zero,
    minus,
    product,
    rotate_x,
    rotate_z,
    total,
)
from rrrgen.ik.recording.builder import Builder, Label
from rrrgen.ik.solutions.position import Arm, solve_position


def is_spherical(loop: Loop, k: int) -> bool:
    """Whether joints k, k+1, k+2 of ``loop`` are revolute and their axes meet exactly in one point."""
    joints, links = loop.started(k).joints[:3], loop.started(k).links[:2]
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


def derive_spherical(b: Builder, loop: Loop, k: int, length: float) -> None:
    """Derive all joints of a six-joint loop with a spherical triple at joints k, k+1, k+2; ``length`` is the reach."""
    loop = straightened(loop.started((k + 3) % 6))
    arm = arm_of(loop)
    motions = solve_position(b, arm, length)
    moved: list[Motion] = [motions[joint.index] for joint in loop.joints[:3]]
    path = unwind([(moved[i], turned_matrix(loop, i)) for i in range(3)], b.name)
    closing = loop.links[5].inverse()
    columns = [rotated_back(path, turned(closing, axis)) for axis in ((1, 0, 0), (0, 0, 1))]
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
    b: Builder, joints: tuple[Joint, Joint, Joint], first: Crossing, second: Crossing, mx: Vector, mz: Vector
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
