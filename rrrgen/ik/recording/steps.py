"""The steps of a recorded derivation: one class for each operation of the builder interface.

A step computes ``results`` from ``operands``; :meth:`Step.play` repeats the operation on another builder. A step with a
:class:`Stage` selects a root, and the steps after it are evaluated once for each root.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from typing import ClassVar

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import S, Vector
from rrrgen.ik.recording.builder import DerivationBuilder, Feasible, Label, Turn
from rrrgen.ik.recording.scalar import SolverScalar

Read = Callable[[SolverScalar], S]
"""Function that returns the value of a recorded scalar in the interpreter that repeats the steps."""

Scalars = tuple[SolverScalar, ...]
Triple = tuple[SolverScalar, SolverScalar, SolverScalar]


@dataclass(frozen=True)
class Stage:
    """The choice of one root of an equation, solved for the joint with the index ``joint``.

    ``label`` is its name, such as "elbow"; ``most`` the largest number of roots; ``bits`` the number of bits of the
    branch number that say which root was taken.
    """

    joint: int
    label: str
    most: int = 2
    bits: int = 1


@dataclass(frozen=True, eq=False)
class Step(ABC):
    """One recorded operation: ``results`` are the variables that it defines, ``kind`` is its name in printed text."""

    results: Scalars
    kind: ClassVar[str]

    @cached_property
    def operands(self) -> Scalars:
        """The scalars that this step needs, in the order of the fields that hold them."""
        held = [getattr(self, field.name) for field in fields(self) if field.name != "results"]
        return tuple(_scalars(held))

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints whose values this step sets."""
        return ()

    @property
    def stage(self) -> Stage | None:
        """The root selection that this step makes, or None."""
        return None

    @property
    def may_be_free(self) -> Joint | None:
        """The joint that some targets leave undetermined at this step; None if there is none."""
        return None

    @abstractmethod
    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat the operation on the builder ``b``; returns the values that ``b`` computes for ``results``.

        ``read`` converts a recorded scalar to the value that it has on ``b``.
        """


@dataclass(frozen=True, eq=False)
class TargetStep(Step):
    """The step that reads the target: 12 results for a pose (rotation row by row, then position), 3 for a position."""

    kind: ClassVar[str] = "target"

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        if len(self.results) == 3:
            return b.point()
        pose = b.pose()
        return (*pose.R[0], *pose.R[1], *pose.R[2], *pose.t)


@dataclass(frozen=True, eq=False)
class ToolStep(Step):
    """The step that reads the position of the tool in the frame of the last link: 3 results."""

    kind: ClassVar[str] = "tool"

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        return b.tool()


@dataclass(frozen=True, eq=False)
class NamedStep(Step):
    """The step that stores ``value`` under the readable name ``hint``."""

    hint: str
    value: SolverScalar
    kind: ClassVar[str] = "name"

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        return (b.name(self.hint, read(self.value)),)


@dataclass(frozen=True, eq=False)
class _Decision(Step):
    """A step that sets one joint."""

    joint: Joint

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints whose values this step sets."""
        return (self.joint,)


@dataclass(frozen=True, eq=False)
class PairStep(_Decision):
    """The step that solves ``A cos(x) + B sin(x) = C`` for cosine and sine of x; ``equation`` holds (A, B, C).

    ``unit`` is the natural size of A, B and C, ``radicand`` a more accurate expression for A^2 + B^2 - C^2 if known.
    """

    equation: Triple
    label: Label
    unit: float
    radicand: SolverScalar | None
    kind: ClassVar[str] = "pair"

    @property
    def fixed(self) -> bool:
        """Whether the direction (A, B) is a constant of the robot."""
        return self.equation[0].is_const and self.equation[1].is_const

    @property
    def stage(self) -> Stage:
        """The root selection that this step makes."""
        return Stage(self.joint.index, self.label.name)

    @property
    def may_be_free(self) -> Joint | None:
        """The joint that some targets leave undetermined at this step; None if there is none."""
        return None if self.fixed else self.joint

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        A, B, C = map(read, self.equation)
        radicand = None if self.radicand is None else read(self.radicand)
        return tuple(b.pair(self.joint, A, B, C, label=self.label, unit=self.unit, radicand=radicand))


@dataclass(frozen=True, eq=False)
class SignedRootStep(Step):
    """The step that takes both square roots of ``radicand``, one root if it is small relative to ``size``.

    The roots get the name ``hint`` and belong to an equation for ``joint``; ``unit`` is their natural size.
    """

    hint: str
    radicand: SolverScalar
    size: SolverScalar
    joint: Joint
    label: Label
    unit: float
    kind: ClassVar[str] = "signed root"

    @property
    def stage(self) -> Stage:
        """The root selection that this step makes."""
        return Stage(self.joint.index, self.label.name)

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        radicand, size = read(self.radicand), read(self.size)
        return (b.signed_root(self.hint, radicand, size=size, joint=self.joint, label=self.label, unit=self.unit),)


@dataclass(frozen=True, eq=False)
class QuarticStep(_Decision):
    """The step that solves ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0`` for cosine and sine of x."""

    k: tuple[SolverScalar, SolverScalar, SolverScalar, SolverScalar, SolverScalar]
    label: Label
    kind: ClassVar[str] = "quartic"

    @property
    def stage(self) -> Stage:
        """The root selection that this step makes."""
        return Stage(self.joint.index, self.label.name, 4, 2)

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        k0, k1, k2, k3, k4 = map(read, self.k)
        return tuple(b.quartic(self.joint, (k0, k1, k2, k3, k4), label=self.label))


@dataclass(frozen=True, eq=False)
class PolynomialStep(_Decision):
    """The step that solves ``k0 + k1 x + k2 x^2 + ... = 0`` (degree 2 or 4) for a displacement x."""

    k: Scalars
    label: Label
    unit: float
    kind: ClassVar[str] = "polynomial"

    @property
    def stage(self) -> Stage:
        """The root selection that this step makes."""
        most = len(self.k) - 1
        return Stage(self.joint.index, self.label.name, most, 1 if most == 2 else 2)

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        return (b.polynomial(self.joint, tuple(map(read, self.k)), label=self.label, unit=self.unit),)


@dataclass(frozen=True, eq=False)
class TurnStep(_Decision):
    """The step that computes the cosine and sine of the angle ``atan2(s, c)``."""

    s: SolverScalar
    c: SolverScalar
    kind: ClassVar[str] = "turn"

    @property
    def may_be_free(self) -> Joint:
        """The joint that some targets leave undetermined at this step; None if there is none."""
        return self.joint

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        return tuple(b.turn(self.joint, read(self.s), read(self.c)))


@dataclass(frozen=True, eq=False)
class OntoStep(_Decision):
    """The step that computes the cosine and sine of the angle about z that rotates ``v`` onto ``u``.

    ``unit`` is the natural size of both vectors; ``feasible`` holds the terms of a :class:`Feasible` condition.
    """

    v: Triple
    u: Triple
    unit: float
    feasible: tuple[SolverScalar, SolverScalar, SolverScalar, SolverScalar, SolverScalar] | None
    kind: ClassVar[str] = "onto"

    @property
    def may_be_free(self) -> Joint:
        """The joint that some targets leave undetermined at this step; None if there is none."""
        return self.joint

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        bounds = None if self.feasible is None else Feasible(*map(read, self.feasible))
        return tuple(b.onto(self.joint, _vector(self.v, read), _vector(self.u, read), unit=self.unit, feasible=bounds))


@dataclass(frozen=True, eq=False)
class SlideStep(_Decision):
    """The step that sets a joint to a value: a displacement, or an angle that follows from others."""

    value: SolverScalar
    kind: ClassVar[str] = "slide"

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        return (b.slide(self.joint, read(self.value)),)


@dataclass(frozen=True, eq=False)
class GivenStep(_Decision):
    """The step that reads the joint that the caller prescribes: its cosine and sine, or its displacement."""

    kind: ClassVar[str] = "given"

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        value = b.redundancy_parameter(self.joint)
        return tuple(value) if isinstance(value, Turn) else (value,)


@dataclass(frozen=True, eq=False)
class WristStep(Step):
    """The step that solves a spherical wrist, the joints ``three`` with perpendicular axes, for cosines and sines.

    There are two solutions. ``signs`` are those of the two twists, +1 for pi/2 and -1 for -pi/2.
    """

    three: tuple[Joint, Joint, Joint]
    columns: tuple[Triple, Triple]
    """The first and the last column of the rotation that the wrist must produce."""
    signs: tuple[int, int]
    kind: ClassVar[str] = "wrist"

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints whose values this step sets."""
        return self.three

    @property
    def stage(self) -> Stage:
        """The root selection that this step makes."""
        return Stage(self.three[1].index, "wrist")

    @property
    def may_be_free(self) -> Joint:
        """The joint that some targets leave undetermined at this step; None if there is none."""
        return self.three[0]

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        (ax, ay, az), (bx, by, bz) = (_vector(column, read) for column in self.columns)
        turns = b.wrist(self.three, ((ax, 0, bx), (ay, 0, by), (az, 0, bz)), self.signs)
        return tuple(value for turn in turns for value in turn)


@dataclass(frozen=True, eq=False)
class ResidualStep(Step):
    """The step that records quantities which are zero at a solution: lengths, and cosines or sines."""

    lengths: Scalars
    cosines: Scalars
    kind: ClassVar[str] = "residual"

    def play(self, b: DerivationBuilder, read: Read) -> tuple[S, ...]:
        """Repeat this operation on the builder ``b``; ``read`` gives it operands. Returns the values of ``results``."""
        b.residual(tuple(map(read, self.lengths)), tuple(map(read, self.cosines)))
        return ()


def _vector(v: Triple, read: Read) -> Vector:
    x, y, z = map(read, v)
    return (x, y, z)


def _scalars(value: object) -> Iterator[SolverScalar]:
    """The scalars in ``value``, one after the other: itself, or those in the tuples that it consists of."""
    if isinstance(value, SolverScalar):
        yield value
    elif isinstance(value, tuple | list):
        for part in value:
            yield from _scalars(part)
