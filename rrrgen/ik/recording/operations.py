"""What one call of a solver computes, counted from its record: every choice with all its roots, nothing singular.

Counted is what the equations of all candidate rows take: a value is computed once, as far outside the choices as it can
be, and a choice multiplies what depends on it. The formulas of the root stages are those of
``templates/c/ik/roots.c``. The check of the target, joint limits and refinement are not counted; roots of quartics
are found by iteration and counted apart.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from math import hypot, prod

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid import Rigid, S, Vector, dot, minus, square, total
from rrrgen.ik.recording.builder import Feasible, Label, Turn, between, users_turn
from rrrgen.ik.recording.scalar import Pool, Scalar
from rrrgen.ik.recording.solver import Solver
from rrrgen.ik.tolerances import SIZE_OF_NOTHING
from rrrgen.program import Op

_NAMES = {Op.ADD: "add", Op.SUB: "add", Op.MUL: "mul", Op.DIV: "div", Op.SQRT: "sqrt"}


@dataclass(frozen=True)
class SolverOperations:
    """Arithmetic of one call with all its rows.

    ``sincos`` counts angles, ``atan2`` arc tangents, ``quartics`` equations of degree four, each solved by at most 40
    iterations.
    """

    mul: int = 0
    add: int = 0
    div: int = 0
    sqrt: int = 0
    sincos: int = 0
    atan2: int = 0
    quartics: int = 0

    def as_dict(self) -> dict[str, int]:
        """For the manifest."""
        return asdict(self)

    def __str__(self) -> str:
        parts = [f"{value} {name}" for name, value in self.as_dict().items() if value or name in ("mul", "add")]
        return ", ".join(parts)


def count_solver(solver: Solver, length: float) -> SolverOperations:
    """Operations of one call for a target at which every choice has all its roots and no joint is free.

    ``length`` is the reach, by which lengths are divided.
    """
    counter = _Counter(solver, length)
    solver.play(counter)
    return counter.operations()


def sum_of(counts: Iterable[SolverOperations]) -> SolverOperations:
    """The sums, name by name."""
    tally: Counter[str] = Counter()
    for each in counts:
        tally.update(each.as_dict())
    return SolverOperations(**tally)


class _Counter:
    """Interprets a record as the operations that it takes."""

    def __init__(self, solver: Solver, length: float) -> None:
        self.pool = Pool()
        self._n, self._length = solver.n, length
        self._turns = [prod(stage.most for stage in solver.stages[:k]) for k in range(len(solver.stages) + 1)]
        self._tally: Counter[str] = Counter()
        self._defined: dict[int, Scalar] = {}
        self._needed: list[Scalar] = []
        self._errors: list[Scalar] = []
        self._directions: list[tuple[int, Scalar]] = []
        self._level = self._serial = 0

    def operations(self) -> SolverOperations:
        """What was counted."""
        self._needed.append(self.pool.of(total(*self._errors)))
        seen: set[int] = set()
        for node in self._needed:
            self._count(node, seen)
        for level, length in self._directions:
            if id(length) in seen:
                self._add(level, div=1)
        return SolverOperations(**self._tally)

    def _count(self, node: Scalar, seen: set[int]) -> None:
        if id(node) in seen:
            return
        seen.add(id(node))
        if id(node) in self._defined:
            self._count(self._defined[id(node)], seen)
        if node.op in _NAMES:
            self._add(node.level, **{_NAMES[node.op]: 1})
        for arg in node.args:
            self._count(arg, seen)

    def _add(self, level: int, **operations: int) -> None:
        for name, number in operations.items():
            self._tally[name] += number * self._turns[level]

    def _need(self, *values: S) -> int:
        """These values are computed; the level at which all are known."""
        nodes = [self.pool.of(x) for x in values]
        self._needed += nodes
        return max((node.level for node in nodes), default=0)

    def _variable(self, level: int) -> Scalar:
        self._serial += 1
        return self.pool.var(f"v{self._serial}", level)

    def _opened(self) -> int:
        self._level += 1
        return self._level

    # -- inputs and values --------------------------------------------------------------------------------------------

    def pose(self) -> Rigid:
        """The target pose of the tip in the base frame."""
        x, y, z, t = (self._three() for _ in range(4))
        return Rigid((x, y, z), t)

    def point(self) -> Vector:
        """The target position of the tip in the base frame."""
        return self._three()

    def _three(self) -> Vector:
        return (self._variable(0), self._variable(0), self._variable(0))

    def name(self, hint: str, x: S) -> Scalar:
        """A value that is computed once."""
        node = self.pool.of(x)
        if node.is_plain:
            return node
        variable = self._variable(node.level)
        self._defined[id(variable)] = node
        return variable

    def names(self, hint: str, v: Vector) -> Vector:
        """A vector, kept under the names hint + x, y, z."""
        return (self.name(hint, v[0]), self.name(hint, v[1]), self.name(hint, v[2]))

    def sqrt(self, x: S) -> Scalar:
        """The square root of a quantity that cannot be negative."""
        return self.pool.sqrt(self.pool.of(x))

    # -- choices ------------------------------------------------------------------------------------------------------

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Both angles with ``A cos(x) + B sin(x) = C``."""
        a, b, k = self.pool.of(A), self.pool.of(B), self.pool.of(C)
        if a.is_const and b.is_const:
            h = hypot(a.value, b.value)
            k, a, b = k / h, self.pool.of(a.value / h), self.pool.of(b.value / h)
            better = None if radicand is None else self.pool.of(radicand) / (h * h)
            level = self._need(k) if better is None else self._need(k, better)
            k = self._variable(level)
            self._need(*([(1 - k) * (1 + k)] if better is None else []))
            self._add(level, sqrt=1)
        else:
            level = self._need(a, b, k, *([] if radicand is None else [radicand]))
            self._add(level, mul=6, add=2, div=1, sqrt=1)
            if radicand is not None:
                self._add(level, mul=-1, add=-1)
            a, b, k = (self._variable(level) for _ in range(3))
        w = self._variable(self._opened())
        turn = Turn(self.name("c", a * k - b * w), self.name("s", b * k + a * w))
        return self._angle(joint, turn, 2 * self._turns[level])

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> Scalar:
        """Both square roots of ``radicand``."""
        big = self.pool.of(size) + (SIZE_OF_NOTHING * unit) * unit
        self._add(self._need(radicand, big), mul=int(not big.is_const), sqrt=1)
        return self._variable(self._opened())

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Up to four angles with ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0``."""
        self._add(self._need(*k), quartics=1)
        level = self._opened()
        self._user(joint, self._variable(level))
        return Turn(self._variable(level), self._variable(level))

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> Scalar:
        """Up to four displacements with ``k0 + k1 x + k2 x^2 + ... = 0``."""
        level = self._need(*k)
        if len(k) == 3:
            self._add(level, mul=9, add=3, div=2, sqrt=1)
        else:
            self._add(level, quartics=1)
        x = self._variable(self._opened())
        self._user(joint, x)
        return x

    # -- single answers -----------------------------------------------------------------------------------------------

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """The one angle ``atan2(s, c)``; the reference where both vanish."""
        level = self._need(s, c)
        self._add(level, mul=4, add=1, div=1, sqrt=1)
        return self._angle(joint, Turn(self._variable(level), self._variable(level)))

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """The one angle about z that turns ``v`` onto ``u``; limits of a free angle cost nothing where none is free."""
        before, after = (self.name("", self.pool.sqrt(self.pool.of(square((*x[:2], 0))))) for x in (v, u))
        level = self._need(before * after, *between(v, u))
        a, b, g = (self._variable(level) for _ in range(3))
        self._directions.append((level, g))
        self._errors.append(self.pool.of(square((before - after, total(v[2], -u[2]), 0)) / (unit * unit)))
        turn = Turn(self.name("c", a * g), self.name("s", b * g))
        self._angle(joint, Turn(a, b) if joint.index < self._n else turn)
        return turn

    def slide(self, joint: Joint, x: S) -> Scalar:
        """The displacement of a prismatic joint, or an angle that follows from others."""
        node = self.name("x", x)
        self._user(joint, node)
        return node

    def given(self, joint: Joint) -> Turn | Scalar:
        """The joint that the caller prescribes: the redundancy parameter."""
        raw = joint.sign * self._variable(0) + float(joint.offset)
        if not joint.revolute:
            return raw
        self._need(raw)
        self._add(0, sincos=1)
        return Turn(self._variable(0), self._variable(0))

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """Both solutions of ``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M`` with e = ``signs``."""
        e4, e5 = signs
        mx = (self.name("m", M[0][0]), self.name("m", M[1][0]), self.name("m", M[2][0]))
        level = self._need(M[0][2], M[1][2], M[2][2], *mx)
        self._add(level, mul=6, add=2, div=1, sqrt=2)
        c4, s4, c5, s5 = (self._variable(level) for _ in range(4))
        column0 = (self.name("u", c4 * c5), self.name("u", s4 * c5), e4 * s5)
        column1 = (e4 * e5 * s4, -(e4 * e5) * c4, 0)
        c6, s6 = self.name("c", dot(column0, mx)), self.name("s", dot(column1, mx))
        built = (
            total(c6 * column0[0], s6 * column1[0]),
            total(c6 * column0[1], s6 * column1[1]),
            c6 * column0[2],
        )
        self.residual((), minus(built, mx))
        return self._flipped(joints, (Turn(c4, s4), Turn(c5, s5), Turn(c6, s6)), level)

    def _flipped(
        self, joints: tuple[Joint, Joint, Joint], turns: tuple[Turn, Turn, Turn], level: int
    ) -> tuple[Turn, Turn, Turn]:
        for joint, turn in zip(joints, turns, strict=True):
            if joint.index < self._n:
                self._angle(joint, turn)
                self._add(level, add=int(joint is not joints[1]))  # half a turn on
        if joints[1].offset and joints[1].index < self._n:
            self._angle(joints[1], Turn(turns[1].c, -turns[1].s))
        inner = self._opened()
        if all(joint.index < self._n for joint in joints):
            return turns
        g = self._variable(inner)
        x4, x5, x6 = turns
        flipped = (Turn(g * x4.c, g * x4.s), Turn(x5.c, g * x5.s), Turn(g * x6.c, g * x6.s))
        for joint, turn in zip(joints, flipped, strict=True):
            if joint.index >= self._n:
                self._angle(joint, turn)
        return flipped

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Quantities that vanish at a solution; a solution is kept only if they do."""
        if lengths:
            self._errors.append(self.pool.of(square(lengths) / (self._length * self._length)))
        if cosines:
            self._errors.append(self.pool.of(square(cosines)))

    # -- joints -------------------------------------------------------------------------------------------------------

    def _angle(self, joint: Joint, turn: Turn, arcs: int | None = None) -> Turn:
        """The user's angle: its arc, or of a virtual joint what it is off zero."""
        users = users_turn(joint, turn)
        if joint.index < self._n:
            level = self._need(*users)
            self._tally["atan2"] += self._turns[level] if arcs is None else arcs
        else:
            self._errors.append(self.pool.of(total(square((1 - users.c, users.s, 0)))))
        return turn

    def _user(self, joint: Joint, raw: Scalar) -> None:
        """The user's displacement, or an angle brought into (-pi, pi]; of a virtual joint the square."""
        q = joint.sign * (raw - float(joint.offset))
        if joint.index >= self._n:
            self._errors.append(q * q)
        else:
            self._add(self._need(q), **({"mul": 1, "add": 2} if joint.revolute else {}))
