"""The closed loop of a chain: ``J1 L1 J2 L2 ... Jm Lm = 1``, with the target folded into the last link.

The numbering may begin at any joint and run in either direction without changing the problem. Therefore a spherical or
planar triple at the base, in the middle or at the tip of an arm is solved by the same equations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan2

from rrrgen.ik.geometry.chain import Joint, KinematicChain, backwards, joint_types
from rrrgen.ik.geometry.rigid_transforms import (
    Crossing,
    Rigid,
    Rotation,
    S,
    Vector,
    is_one,
    is_zero,
    plus,
    product,
    rigid,
    rotate,
    rotate_z,
    screw,
    total,
    transpose,
)
from rrrgen.ik.recording.builder import DerivationBuilder, Turn


@dataclass(frozen=True)
class Closing:
    """The link of the loop that contains the target pose, kept as a product of its ``factors``.

    A vector is transformed by one factor after the other, which takes fewer operations than forming the product.
    """

    factors: tuple[Rigid, ...]

    def apply(self, v: Vector) -> Vector:
        """Transform the point ``v``."""
        for factor in reversed(self.factors):
            v = factor.apply(v)
        return v

    def turn(self, v: Vector) -> Vector:
        """Rotate the direction ``v``, without the translation."""
        for factor in reversed(self.factors):
            v = rotate(factor.R, v)
        return v

    def inverse(self) -> Closing:
        """The inverse of the link: the inverse factors in reverse order."""
        return Closing(tuple(factor.inverse() for factor in reversed(self.factors)))

    def rigid(self) -> Rigid:
        """The product of the factors as one transform."""
        result = self.factors[0]
        for factor in self.factors[1:]:
            result = result @ factor
        return result


AnyLink = Crossing | Closing


def apply(link: AnyLink, v: Vector) -> Vector:
    """Transform the point ``v`` by ``link``."""
    return link.apply(v) if isinstance(link, Closing) else link.rigid().apply(v)


def rotate_by_link(link: AnyLink, v: Vector) -> Vector:
    """Rotate the direction ``v`` by ``link``, without its translation."""
    return link.turn(v) if isinstance(link, Closing) else rotate(link.rigid().R, v)


@dataclass(frozen=True)
class Loop:
    """A closed chain of joints and links, the target in its last link: the product of all transforms is 1.

    ``links[i]`` follows ``joints[i]``; the last link leads back to the first joint.
    """

    joints: tuple[Joint, ...]
    links: tuple[AnyLink, ...]

    def start_at(self, k: int) -> Loop:
        """The same loop numbered from joint ``k``."""
        return Loop(self.joints[k:] + self.joints[:k], self.links[k:] + self.links[:k])

    def reverse(self) -> Loop:
        """The same loop in the opposite direction: the last joint comes first, links are inverted."""
        links = [link.inverse() for link in self.links]
        return Loop(tuple(backwards(j) for j in reversed(self.joints)), (*reversed(links[:-1]), links[-1]))

    @property
    def types(self) -> str:
        """The joint types in order, for example ``"RRRPRR"``."""
        return joint_types(self.joints)


def close(b: DerivationBuilder, chain: KinematicChain) -> Loop:
    """Close ``chain`` to a loop with the target pose T of the builder ``b``: the last link is tip T^-1 base."""
    closing = Closing((rigid(chain.tip), b.pose().inverse(), rigid(chain.base)))
    return Loop(chain.joints, (*(Crossing.of(link) for link in chain.links), closing))


def lock(b: DerivationBuilder, loop: Loop, k: int) -> Loop:
    """Remove joint ``k``, whose value the caller prescribes: its transform becomes part of the link before it."""
    joint = loop.joints[k]
    value = b.redundancy_parameter(joint)
    middle = screw(value.c, value.s) if isinstance(value, Turn) else screw(1, 0, value)
    before, after = loop.links[k - 1], loop.links[k]
    merged = Closing((*factors(before), middle, *factors(after)))
    links = list(loop.links)
    links[k - 1] = merged
    del links[k]
    return Loop(loop.joints[:k] + loop.joints[k + 1 :], tuple(links))


def factors(link: AnyLink) -> tuple[Rigid, ...]:
    """The transforms whose product is ``link``."""
    return link.factors if isinstance(link, Closing) else (link.rigid(),)


def straighten(loop: Loop) -> Loop:
    """Move the rotations about z at the ends of constant links into the offsets of the neighbouring revolute joints."""
    joints, links = list(loop.joints), list(loop.links)
    for i, link in enumerate(links):
        if not isinstance(link, Crossing):
            continue
        near, far = link.near, link.far
        after = (i + 1) % len(joints)
        if joints[i].revolute and not _plain(near):
            joints[i] = replace(joints[i], offset=joints[i].offset + atan2(near[1], near[0]))
            near = (1, 0, near[2])
        if joints[after].revolute and not _plain(far):
            joints[after] = replace(joints[after], offset=joints[after].offset + atan2(far[1], far[0]))
            far = (1, 0, far[2])
        links[i] = replace(link, near=near, far=far)
    return Loop(tuple(joints), tuple(links))


def _plain(end: tuple[S, S, S]) -> bool:
    return bool(end[0] == 1 and end[1] == 0)


def commute_joints(loop: Loop, i: int, direction: int) -> Loop | None:
    """Exchange prismatic joint ``i`` with a neighbouring revolute joint of parallel axis; None where not possible.

    The neighbour is the next joint if ``direction`` is positive, otherwise the one before. Tz commutes with Rz and, up
    to its sign, with every link between parallel axes.
    """
    if direction < 0:
        m = len(loop.joints)
        moved = commute_joints(loop.reverse(), m - 1 - i, 1)
        return None if moved is None else moved.reverse()
    if i + 1 >= len(loop.joints):
        return None
    slider, neighbour = loop.joints[i], loop.joints[i + 1]
    before, between = loop.links[i - 1], loop.links[i]
    if slider.revolute or not neighbour.revolute or not isinstance(between, Crossing) or not is_zero(between.sa):
        return None
    merged: AnyLink | None
    if i == 0:
        merged = Closing((*factors(before), between.rigid()))
    else:
        merged = Crossing.planar(before.rigid() @ between.rigid()) if isinstance(before, Crossing) else None
    if merged is None:
        return None
    joints, links = list(loop.joints), list(loop.links)
    joints[i], joints[i + 1] = neighbour, slider if between.ca > 0 else backwards(slider)
    links[i - 1] = merged
    links[i] = Crossing((1, 0, 0), 0, 1, 0, (1, 0, 0))
    return Loop(tuple(joints), tuple(links))


Motion = Turn | S


def move(motion: Motion, v: Vector, *, direction: bool = False) -> Vector:
    """Transform a point (or a direction) by the motion of a joint: a rotation about z, or a translation along z.

    ``motion`` is the cosine and sine of the angle, or the displacement.
    """
    if isinstance(motion, Turn):
        return rotate_z(motion.c, motion.s, v)
    return v if direction else plus(v, (0, 0, motion))


def unwind(steps: list[tuple[Motion | None, Rotation | None]], name: Callable[[str, S], S]) -> list[Turn | Rotation]:
    """List the rotations of a sequence of joints and links, with consecutive rotations about z merged into one.

    ``steps`` holds (motion of the joint or None, rotation of the link or None); ``name`` stores an intermediate value
    under a readable name.
    """
    merged: list[Turn | Rotation] = []
    for motion, rotation in steps:
        if isinstance(motion, Turn):
            if merged and isinstance(merged[-1], Turn):
                last = merged[-1]
                merged[-1] = Turn(
                    name("c", total(product(last.c, motion.c), -product(last.s, motion.s))),
                    name("s", total(product(last.s, motion.c), product(last.c, motion.s))),
                )
            else:
                merged.append(motion)
        if rotation is not None and not _identity(rotation):
            merged.append(rotation)
    return merged


def _identity(R: Rotation) -> bool:
    return all(is_one(R[i][j]) if i == j else is_zero(R[i][j]) for i in range(3) for j in range(3))


def rotated_back(path: list[Turn | Rotation], v: Vector) -> Vector:
    """Components of the direction ``v`` in the frame at the end of the sequence: the inverse rotations are applied."""
    for part in path:
        v = rotate_z(part.c, -part.s, v) if isinstance(part, Turn) else rotate(transpose(part), v)
    return v
