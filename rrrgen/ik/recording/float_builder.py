"""Evaluation of a derivation in floats, one branch at a time: the compiler tests its equations before it emits them."""

from __future__ import annotations

from cmath import phase
from collections.abc import Callable, Sequence
from math import atan2, cos, hypot, pi, sin, sqrt
from typing import Any

from rrrgen.base.small_matrices import polynomial_roots
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import Rigid, S, Vector, dot
from rrrgen.ik.recording.builder import Feasible, Label, Turn, between
from rrrgen.ik.tolerances import BELOW_ZERO, COMPLEX, NO_CONDITION, NO_DIRECTION, SIZE_OF_NOTHING


class NoRoot(Exception):  # noqa: N818 - an answer, not an error
    """This branch has no real solution."""


class FloatBuilder:
    """Evaluate one branch of a derivation for one target.

    ``T`` is the target pose (4 x 4), ``reference`` the joint values where the target leaves a joint free, ``script``
    the index of the root taken at each choice, ``redundancy`` the prescribed joint value. After a run, ``values`` holds
    the user's joint values by joint index, ``counts`` the number of roots at each choice. ``tool`` is the position of
    the tool in the frame of the last link, for solvers that have it as an input.
    """

    def __init__(
        self,
        T: Any,
        reference: Sequence[float],
        script: list[int],
        *,
        redundancy: float = 0.0,
        tool: Vector = (0.0, 0.0, 0.0),
    ) -> None:
        self._tool = tool
        self.T, self.reference, self.script, self.redundancy = T, reference, script, redundancy
        self.counts: list[int] = []
        self.values: dict[int, float] = {}

    def pose(self) -> Rigid:
        """The target pose."""
        rows = [[float(x) for x in row] for row in self.T[:3]]
        return Rigid(tuple(tuple(row[:3]) for row in rows), tuple(row[3] for row in rows))  # type: ignore[arg-type]

    def point(self) -> Vector:
        """The target position."""
        return (float(self.T[0][3]), float(self.T[1][3]), float(self.T[2][3]))

    def tool(self) -> Vector:
        """The position of the tool in the frame of the last link."""
        return self._tool

    def name(self, hint: str, x: S) -> S:
        """Return ``x``; floats need no name."""
        return x

    def names(self, hint: str, v: Vector) -> Vector:
        """Return ``v``; floats need no name."""
        return v

    def sqrt(self, x: S) -> S:
        """The square root; round-off below zero counts as zero."""
        return sqrt(max(float(x), 0.0))

    def _choose(self, count: int) -> int:
        if count == 0:
            raise NoRoot
        self.counts.append(count)
        if len(self.counts) > len(self.script):
            self.script.append(0)
        return self.script[len(self.counts) - 1]

    def _set(self, joint: Joint, raw: float) -> None:
        self.values[joint.index] = joint.sign * (raw - float(joint.offset))

    def _reference(self, joint: Joint) -> float:
        known = self.reference[joint.index] if joint.index < len(self.reference) else 0.0
        return joint.sign * known + float(joint.offset)

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Solve ``A cos(x) + B sin(x) = C``; of the two angles the one that ``script`` selects."""
        h = hypot(A, B)
        if h <= NO_DIRECTION * unit:
            if abs(C) > NO_CONDITION * unit:
                raise NoRoot
            x = self._reference(joint)
            self._set(joint, x)
            return Turn(cos(x), sin(x))
        k = C / h
        w2 = (1 - k) * (1 + k) if radicand is None else radicand / h**2
        if w2 < -BELOW_ZERO:
            raise NoRoot
        sign = (1, -1)[self._choose(2)] * label.positive
        x = atan2(B, A) + sign * atan2(sqrt(max(w2, 0.0)), k)
        self._set(joint, x)
        return Turn(cos(x), sin(x))

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> S:
        """The square root of ``radicand`` with the sign that ``script`` selects."""
        if radicand < -BELOW_ZERO * (size + SIZE_OF_NOTHING * unit**2):
            raise NoRoot
        return (1, -1)[self._choose(2)] * label.positive * sqrt(max(radicand, 0.0))

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Solve ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0``; the root that ``script`` selects."""
        k0, kc, ks, k2c, k2s = (float(x) for x in k)
        ends, middle = complex(k2c, k2s) / 2, complex(kc, ks) / 2
        roots = polynomial_roots([ends.conjugate(), middle.conjugate(), k0, middle, ends])  # in z = exp(i x)
        angles = sorted(phase(z) for z in roots if abs(abs(z) - 1) < COMPLEX)
        x = angles[self._choose(len(angles))]
        self._set(joint, x)
        return Turn(cos(x), sin(x))

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> S:
        """Solve ``k0 + k1 x + k2 x^2 + ... = 0`` for a displacement; the root that ``script`` selects."""
        roots = polynomial_roots([float(x) for x in reversed(k)])
        real = sorted(z.real for z in roots if abs(z.imag) < COMPLEX * unit)
        if not real:
            raise NoRoot
        x = real[self._choose(len(real))] if len(k) > 2 else real[0]
        self._set(joint, x)
        return x

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """The angle ``atan2(s, c)``; the joint's value in ``reference`` where both vanish."""
        return self._directed(joint, Turn(c, s), NO_DIRECTION)

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """The angle about z that turns ``v`` onto ``u``; the value in ``reference`` where one of them lies along z."""
        return self._directed(joint, between(v, u), (NO_DIRECTION * unit) ** 2)

    def _directed(self, joint: Joint, direction: Turn, least: float) -> Turn:
        c, s = direction
        x = atan2(s, c) if hypot(c, s) > least else self._reference(joint)
        self._set(joint, x)
        return Turn(cos(x), sin(x))

    def slide(self, joint: Joint, x: S) -> S:
        """Set ``joint`` to the value ``x``: a displacement, or an angle that follows from others."""
        self._set(joint, float(x))
        return float(x)

    def given(self, joint: Joint) -> Turn | S:
        """The value of the prescribed joint, from ``redundancy``."""
        raw = joint.sign * self.redundancy + float(joint.offset)
        self.values[joint.index] = self.redundancy
        return Turn(cos(raw), sin(raw)) if joint.revolute else raw

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """Solve ``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M`` with (e4, e5) = ``signs``.

        Returns the one of the two solutions that ``script`` selects.
        """
        e4, e5 = signs
        flip = (1, -1)[self._choose(2)]
        s4, c4 = flip * e5 * M[1][2], flip * e5 * M[0][2]
        s5 = flip * hypot(s4, c4)
        x4 = atan2(s4, c4) if abs(s5) > NO_DIRECTION else self._reference(joints[0])
        x5 = atan2(s5, -e4 * e5 * M[2][2])
        c4, s4, c5, s5 = cos(x4), sin(x4), cos(x5), sin(x5)
        mx = (M[0][0], M[1][0], M[2][0])
        x6 = atan2(dot((e4 * e5 * s4, -e4 * e5 * c4, 0.0), mx), dot((c4 * c5, s4 * c5, e4 * s5), mx))
        for joint, x in zip(joints, (x4, x5, x6), strict=True):
            self._set(joint, x)
        return Turn(c4, s4), Turn(c5, s5), Turn(cos(x6), sin(x6))

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Ignore the quantities: the caller checks every solution by forward kinematics instead."""


def every_branch(run: Callable[[FloatBuilder], None], make: Callable[[list[int]], FloatBuilder]) -> list[list[float]]:
    """Evaluate every branch of a derivation: joint values per branch, not yet compared with the target.

    ``run`` plays the derivation on a builder, ``make`` creates a builder for a list of root indices.
    """
    rows: list[list[float]] = []
    script: list[int] = []
    for _ in range(64):
        builder = make(script)
        try:
            run(builder)
            rows.append([builder.values[j] for j in sorted(builder.values)])
        except (NoRoot, ZeroDivisionError):
            pass
        script = next_script(builder.script, builder.counts)
        if not script:
            break
    return rows


def next_script(script: Sequence[int], counts: Sequence[int]) -> list[int]:
    """The indices of the roots on the branch after that of ``script``, which had ``counts`` roots at its choices.

    The last choice changes first; later choices take their first root. Empty after the last branch.
    """
    following = list(script[: len(counts)])
    while following and following[-1] + 1 >= counts[len(following) - 1]:
        following.pop()
    if following:
        following[-1] += 1
    return following


def wrapped(x: float) -> float:
    """Wrap the angle ``x`` (rad) to [-pi, pi)."""
    return (x + pi) % (2 * pi) - pi
