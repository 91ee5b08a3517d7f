"""Common part of the C code of every inverse kinematics: inputs, named values, loops, angles, function body."""

from __future__ import annotations

from collections.abc import Sequence

from rrrgen.base.errors import InternalError
from rrrgen.base.templates import render
from rrrgen.emit.c.ik.kernels import KernelDialect, KernelSettings, specialize
from rrrgen.emit.c.ik.loop_nest import (
    ARC,
    RESERVED,
    STOP,
    ArcTangent,
    Flip,
    Item,
    Leaf,
    LoopNest,
    LoopPass,
    RootLoop,
    Statement,
)
from rrrgen.emit.c.ik.statements import CBody, print_nest
from rrrgen.emit.c.language import CTarget, Dialect, LibmSinCos
from rrrgen.emit.interface import Target
from rrrgen.emit.printing import Names, Statements
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import Rigid, S, Vector, square, total
from rrrgen.ik.plan import ARM_ANGLE, SolverPlan
from rrrgen.ik.recording.builder import Turn, users_turn
from rrrgen.ik.recording.newton_step import error_program, newton_program
from rrrgen.ik.recording.scalar import Pool, SolverScalar, fresh_name
from rrrgen.program import Op, Program

# ------------------------------------------------------------------------------------------------------------------
# The Newton step as C: loops whose every pass refines one branch, so that compilers can vectorize over branches.
# ------------------------------------------------------------------------------------------------------------------


def newton_text(plan: SolverPlan, dialect: Dialect, chosen: KernelSettings) -> str:
    """The C functions ``ik_newton``, a Newton step of several configurations, and ``ik_missed``, their errors."""
    step = _body(newton_program(plan.chain, plan.locked), plan.locked, dialect)
    missed = _body(error_program(plan.chain), plan.locked, dialect)
    return specialize(render("c/ik/newton.c.j2", step=step, missed=missed), chosen)


def _body(program: Program, locked: int | None, dialect: Dialect) -> list[str]:
    """The statements of ``program`` for the configuration in lane i; a step is added to all joints but ``locked``."""
    target = CTarget(KernelDialect(dialect.prefix, dialect.real), LibmSinCos())
    inputs = ("x[{}][i]", "T[{}]")
    names = Names(target.reserved, ("T", "x", "i", "error", "moved", "inverse", "det"))
    printed = Statements(program, target, names, lambda port, element: inputs[port].format(element))
    printed.write()
    lines = list(printed.lines)
    for port, nodes in zip(program.outputs, program.results, strict=True):
        for element, node in enumerate(nodes):
            text = printed.texts[node].code
            if port.name != "step":
                lines.append(f"{port.name}[i] = {text};")
            elif element != locked:
                lines.append(f"x[{element}][i] += {text};")
    return lines


# ------------------------------------------------------------------------------------------------------------------
# Common part of the C code of every inverse kinematics
# ------------------------------------------------------------------------------------------------------------------


class Scaffold:
    """Collects the C statements of an inverse kinematics in loops over its roots; :meth:`body` prints them.

    Every statement is recorded inside all loops opened so far; passes move it from there.

    A *virtual* joint is one that the derivation adds to the chain and whose value is zero in every solution. The *tag*
    of a joint is its number from 1 as text, which ends the names of its C variables: ``c2`` and ``s2`` for joint 2.
    """

    def __init__(
        self,
        target: Target,
        joints: Sequence[Joint],
        length: float,
        *,
        position_only: bool = False,
        trusted: bool = True,
        banded: bool = False,
        margins: bool = False,
    ) -> None:
        self.pool = Pool()
        self._target = target
        self._trusted = trusted
        self._slack = "slack, band" if banded else "slack"
        self._margins = margins
        self.length = length
        self._joints = {joint.index: joint for joint in joints}
        self._position_only = position_only
        self._items: list[Item] = []
        self._loops: list[RootLoop] = []
        self._values: dict[int, SolverScalar] = {}
        self._flags: list[str] = []
        self._branch: list[tuple[str, int]] = []  # expression, bits
        self._residual: list[SolverScalar] = []
        self._taken: set[str] = set(RESERVED)
        self._needs: set[str] = set()

    # -- inputs -------------------------------------------------------------------------------------------------------

    def pose(self) -> Rigid:
        """The target pose, read from the C argument ``T``, a row-major 4x4 matrix."""
        rows = [[self.pool.var(f"T[{4 * i + j}]") for j in range(4)] for i in range(3)]
        x, y, z = ((row[0], row[1], row[2]) for row in rows)
        return Rigid((x, y, z), (rows[0][3], rows[1][3], rows[2][3]))

    def point(self) -> Vector:
        """The target position: the argument of a position solver, or the last column of the pose of a pose solver."""
        if not self._position_only:
            return self.pose().t
        return (self.pool.var("T[0]"), self.pool.var("T[1]"), self.pool.var("T[2]"))

    def tool(self) -> Vector:
        """The position of the tool, which follows that of the target in the C argument ``T``."""
        return (self.pool.var("T[3]"), self.pool.var("T[4]"), self.pool.var("T[5]"))

    def reference(self, joint: Joint) -> SolverScalar:
        """The caller's reference value of a joint, as raw variable ``sign q + offset``; q = 0 for a virtual joint."""
        if joint.index not in self._joints:
            return self.pool.of(float(joint.offset))
        return joint.sign * self.pool.var(f"ref[{joint.index}]") + float(joint.offset)

    # -- values -------------------------------------------------------------------------------------------------------

    def name(self, hint: str, x: S) -> SolverScalar:
        """Define the C constant ``const REAL hint = x;`` and return it; numbers and variables stay as they are."""
        node = self.pool.of(x)
        if node.is_plain:
            return node
        return self._define(fresh_name(hint, self._taken), "{0}", (node,))

    def names(self, hint: str, v: Vector) -> Vector:
        """Define a C constant for each coordinate of ``v`` (3,): ``<hint>x``, ``<hint>y`` and ``<hint>z``."""
        return (self.name(f"{hint}x", v[0]), self.name(f"{hint}y", v[1]), self.name(f"{hint}z", v[2]))

    def sqrt(self, x: S) -> SolverScalar:
        """The square root of ``x``; a negative ``x``, which round-off can cause, counts as zero."""
        return self.pool.clamped_sqrt(self.pool.of(x))

    # -- angles -------------------------------------------------------------------------------------------------------

    def _define_turn(self, tag: str, c: SolverScalar, s: SolverScalar) -> Turn:
        """Define the C constants ``c<tag>`` and ``s<tag>``, the cosine and sine of the joint with this tag."""
        self._taken -= {f"c{tag}", f"s{tag}"}
        return Turn(self.name(f"c{tag}", c), self.name(f"s{tag}", s))

    def _angle(self, joint: Joint, turn: Turn) -> Turn:
        """Set a joint to the angle with the cosine and sine of ``turn``, or with a common multiple of them.

        The value of a virtual joint must be zero: its distance from zero is added to the residual.
        """
        users = users_turn(joint, turn)
        if joint.index in self._joints:
            self._values[joint.index] = self._arc(joint, users)
        elif joint.index < ARM_ANGLE:
            self._residual.append(self.pool.of(total(square((1 - users.c, users.s, 0)))))
        return turn

    def _arc(self, joint: Joint, users: Turn) -> SolverScalar:
        """Define the user's angle of a joint as the arc tangent of ``users``, its cosine and sine."""
        arc = ArcTangent(self._angle_variable(joint), "{0}", "{1}")
        self._add((ARC,), (self.pool.of(users.c), self.pool.of(users.s)), calls=("arc",), arc=arc)
        return arc.angle

    def _flip(self, joint: Joint, choice: SolverScalar, other: SolverScalar | None, formula: str = "") -> None:
        """Give ``joint`` a second angle, which it has in the second pass of the loop with the variable ``choice``.

        That angle is the variable ``other``, or is computed from the first one by the C text ``formula``.
        """
        source, variable = self._values[joint.index], self._angle_variable(joint)
        if formula.startswith("ik_opposite"):
            self._needs.add("opposite")
        second = "{2}" if other is not None else formula.format("{1}")
        operands = (choice, source) if other is None else (choice, source, other)
        self._add(
            (f"const REAL {variable.text} = ({{0}} == 0) ? {{1}} : {second};",),
            operands,
            defines=(variable.text,),
            calls=("opposite",) if formula.startswith("ik_opposite") else (),
            flip=Flip(choice.text, source, other, formula),
        )
        self._values[joint.index] = variable

    def _angle_variable(self, joint: Joint) -> SolverScalar:
        return self.pool.var(fresh_name(f"q{joint.index + 1}", self._taken))

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Add lengths (m) and cosines that vanish at a true solution; candidates where they do not are dropped."""
        parts = []
        if lengths:
            parts.append(square(lengths) / (self.length * self.length))
        if cosines:
            parts.append(square(cosines))
        self._residual += [self.pool.of(part) for part in parts]

    # -- printing -----------------------------------------------------------------------------------------------------

    def body(self, passes: Sequence[LoopPass]) -> CBody:
        """Print the body of the C function that lists the candidates, rewritten by ``passes`` first.

        An equation must have been recorded for every joint.
        """
        nest = self.nest()
        for step in passes:
            nest = step(nest)
        text, operations = print_nest(nest, self._target, self._taken)
        together = {"arcs"} if nest.after else set()
        return CBody(text, frozenset(self._needs | together), operations)

    def nest(self) -> LoopNest:
        """The statements in their loops, as the derivation gave them, and the candidate that they end in."""
        missing = [j + 1 for j in self._joints if j not in self._values]
        if missing:
            raise InternalError(f"no value for joints {missing}")
        for index, value in self._values.items():
            if index not in self._joints and index < ARM_ANGLE:
                self._residual.append(value * value)  # the value of a virtual joint must be zero
        known = self._trusted and self._residual
        self._needs |= set() if known else {"unknown"}
        error = self.name("error", self.pool.of(total(*self._residual)) if known else self.pool.of(-1.0))
        branch, bit = [], 0
        for text, bits in self._branch:
            branch.append(f"({text} << {bit})" if bit else text)
            bit += bits
        joints = tuple((j, self._values[j]) for j in sorted(self._joints))
        flags = " | ".join(self._flags) or "0u"
        leaf = Leaf(len(self._loops), joints, flags, " | ".join(branch) or "0u", error)
        return LoopNest(tuple(self._loops), (*self._items, leaf))

    # -- loops, flags and names ---------------------------------------------------------------------------------------

    def _open(self, tag: str, count: SolverScalar, most: int, *, sure: bool = False) -> SolverScalar:
        """Open a C loop over the roots of one equation; returns its loop variable.

        ``count`` is the C variable with the number of roots, ``most`` its largest value. Unless at least one root is
        ``sure`` to exist, code is added that records at which equation the search failed.
        """
        k = len(self._loops)
        failed = f"if ({{0}} == 0) {{ *stage = (*stage < {k + 1}) ? {k + 1} : *stage; {STOP}}}"
        self._add(() if sure else (failed,), (count,), opens=k)
        self._loops.append(RootLoop(f"i{tag}", count.text, most, k))
        return self.pool.var(f"i{tag}")

    def _open_bit(self, joint: Joint) -> str:
        """The C text of the flag for a joint close to a singularity at which it becomes free; 0 for a virtual joint."""
        if joint.index not in self._joints:
            return "0u"
        return f"{256 << joint.index}u"

    def _free_bits(self, joint: Joint) -> str:
        """The C text of the flags that report that a joint is free: at this pose every value of it gives a solution."""
        if joint.index not in self._joints:
            return "(unsigned)IK_FREE"
        return f"(unsigned)IK_FREE | {257 * 256 << joint.index}u"

    def _add(
        self,
        lines: tuple[str, ...],
        operands: tuple[SolverScalar, ...],
        *,
        defines: tuple[str, ...] = (),
        optional: bool = False,
        beside: tuple[SolverScalar, ...] = (),
        calls: tuple[str, ...] = (),
        rare: tuple[int, ...] = (),
        arc: ArcTangent | None = None,
        flip: Flip | None = None,
        opens: int | None = None,
    ) -> tuple[SolverScalar, ...]:
        """Add a :class:`Statement` inside all open loops; returns the variables that it defines."""
        variables = tuple(map(self.pool.var, defines))
        every = variables if arc is None else (*variables, arc.angle)
        self._items.append(
            Statement(len(self._loops), lines, operands, every, optional, beside, calls, rare, arc, flip, opens)
        )
        return variables

    def _define(
        self, text: str, formula: str, operands: tuple[SolverScalar, ...], calls: tuple[str, ...] = ()
    ) -> SolverScalar:
        """Define the C constant ``text`` by ``formula``, in which ``{0}``, ... are operands; left out if unused."""
        line = f"const REAL {text} = {formula};"
        return self._add((line,), operands, defines=(text,), calls=calls, optional=True)[0]

    def _user(self, joint: Joint, raw: SolverScalar) -> SolverScalar:
        """Convert the raw joint variable ``raw`` to the user's joint value ``sign (raw - offset)``.

        An angle is reduced to (-pi, pi].
        """
        q = joint.sign * (raw - float(joint.offset))
        bare = raw if joint.sign > 0 else -raw
        if not joint.revolute or (q is bare and raw.op is Op.INPUT and raw.text[0] == "x"):
            return q
        return self._define(fresh_name(f"q{joint.index + 1}", self._taken), "ik_wrap({0})", (q,), ("wrap",))

    def _real(self, x: float) -> str:
        return f"(REAL){x!r}"

    def _tag(self, joint: Joint) -> str:
        tag = str(joint.index + 1)
        if f"c{tag}" in self._taken:
            raise InternalError(f"joint {tag} is solved twice")
        self._taken.update(f"{letter}{tag}" for letter in "abcdefgikmnsvwxy")
        return tag

    def _fresh_tag(self, hint: str) -> str:
        self._taken.add(hint)
        return f"_{hint}"
