"""Common part of the C code of every inverse kinematics: inputs, named values, loops, angles, function body."""

from __future__ import annotations

from collections.abc import Sequence

from rrrgen.backends.c.solver.arcs import RESERVED, Arcs, Slot, kept_count
from rrrgen.backends.c.solver.counting import CALLS, sum_of
from rrrgen.backends.c.solver.statements import CBody, Loop, Statement, position, printed
from rrrgen.backends.interface import Target
from rrrgen.errors import InternalError
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid import Rigid, S, Vector, square, total
from rrrgen.ik.recording.builder import Turn, users_turn
from rrrgen.ik.recording.scalar import Pool, Scalar
from rrrgen.program import Op

VIRTUAL_END = 100
"""Joint indices from n to here are virtual joints, further ones are arguments (the arm angle)."""


class Scaffold:
    """Collects the C statements of an inverse kinematics in loops over its roots; :meth:`body` prints them.

    A *virtual* joint is one that the derivation adds to the chain and that stands at zero in every solution.
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
    ) -> None:
        self.pool = Pool()
        self._target = target
        self._trusted = trusted
        self._slack = "slack, band" if banded else "slack"
        self.length = length
        self._joints = {joint.index: joint for joint in joints}
        self._position_only = position_only
        self._items: list[Statement] = []
        self._loops: list[Loop] = []
        self._values: dict[int, Scalar] = {}
        self._arcs = Arcs()
        self._flags: list[str] = []
        self._branch: list[tuple[str, int]] = []  # expression, bits
        self._residual: list[Scalar] = []
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

    def reference(self, joint: Joint) -> Scalar:
        """The reference value of a joint as the derivation counts it, with sign and offset; q = 0 if virtual."""
        if joint.index not in self._joints:
            return self.pool.of(float(joint.offset))
        return joint.sign * self.pool.var(f"ref[{joint.index}]") + float(joint.offset)

    # -- values -------------------------------------------------------------------------------------------------------

    def name(self, hint: str, x: S) -> Scalar:
        """Define the C constant ``const REAL hint = x;`` and return it; numbers and variables stay as they are."""
        node = self.pool.of(x)
        if node.is_plain:
            return node
        text = self._fresh(hint)
        variable = self.pool.var(text, node.level)
        self._items.append(Statement(node.level, (f"const REAL {text} = {{0}};",), (node,), variable))
        return variable

    def names(self, hint: str, v: Vector) -> Vector:
        """Define a C constant for each coordinate of ``v`` (3,): ``<hint>x``, ``<hint>y`` and ``<hint>z``."""
        return (self.name(f"{hint}x", v[0]), self.name(f"{hint}y", v[1]), self.name(f"{hint}z", v[2]))

    def sqrt(self, x: S) -> Scalar:
        """The square root of ``x``; a negative ``x``, which round-off can cause, counts as zero."""
        return self.pool.clamped_sqrt(self.pool.of(x))

    # -- angles -------------------------------------------------------------------------------------------------------

    def _turned(self, tag: str, c: Scalar, s: Scalar) -> Turn:
        """Define the C constants ``c<tag>`` and ``s<tag>``, the cosine and sine of the joint with this tag."""
        self._taken -= {f"c{tag}", f"s{tag}"}
        return Turn(self.name(f"c{tag}", c), self.name(f"s{tag}", s))

    def _angle(self, joint: Joint, turn: Turn, outside: int | None = None) -> Turn:
        """Store the cosine and sine of a joint's angle, from which the arc tangent is taken after all loops.

        A virtual joint must stand at zero: its distance from zero is added to the residual. ``outside`` is the loop
        level at which the joint's own equation is solved; the loop opened last then runs over the roots of that
        equation.
        """
        users = users_turn(joint, turn)
        level = self._level(turn)
        if joint.index in self._joints:
            loops = self._loops[:level] if outside is None else [*self._loops[:outside], self._loops[-1]]
            self._arcs.joints[joint.index] = self._written(level, loops, users)
        elif joint.index < VIRTUAL_END:
            self._residual.append(self.pool.of(total(square((1 - users.c, users.s, 0)))))
        return turn

    def _written(self, level: int, loops: Sequence[Loop], users: Turn) -> Slot:
        """Reserve an array slot for the angle of ``users``, and store its cosine and sine there."""
        slot = self._arcs.slot(loops)
        at = slot.text()
        self._add(level, (f"cosine[{at}] = {{0}};", f"sine[{at}] = {{1}};"), tuple(map(self.pool.of, users)))
        return slot

    def _level(self, turn: Turn) -> int:
        return max(self.pool.of(turn.c).level, self.pool.of(turn.s).level)

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Add lengths (m) and cosines that vanish at a true solution; candidates where they do not are dropped."""
        parts = []
        if lengths:
            parts.append(square(lengths) / (self.length * self.length))
        if cosines:
            parts.append(square(cosines))
        self._residual += [self.pool.of(part) for part in parts]

    # -- printing -----------------------------------------------------------------------------------------------------

    def body(self) -> CBody:
        """The branch function's body; every joint must have been given a value."""
        missing = [j + 1 for j in self._joints if j not in self._values and j not in self._arcs.joints]
        if missing:
            raise InternalError(f"no value for joints {missing}")
        deepest = len(self._loops)
        for index, value in self._values.items():
            if index not in self._joints and index < VIRTUAL_END:
                self._residual.append(value * value)  # a virtual joint must stand at zero
        known = self._trusted and self._residual
        error = self.pool.of(total(*self._residual)) if known else self.pool.of(-1.0)
        self._needs |= set() if known else {"unknown"}
        error = self.name("error", error)
        before, behind = self._arcs.finished(self._loops)
        self._needs |= {"arcs"} if behind else set()
        leaf: list[str] = []
        operands: list[Scalar] = []
        for j in sorted(self._values):
            where = f"found->q[rows][{j}]" if j in self._joints else ""
            if where:
                leaf.append(f"{where} = {{{len(operands)}}};")
                operands.append(self._values[j])
        flags = " | ".join(self._flags) or "0u"
        leaf.append(f"found->flags[rows] = {flags};")
        branch, bit = [], 0
        for text, bits in self._branch:
            branch.append(f"({text} << {bit})" if bit else text)
            bit += bits
        leaf.append(f"found->branch[rows] = {' | '.join(branch) or '0u'};")
        leaf.append(f"found->residual[rows] = {{{len(operands)}}};")
        operands.append(error)
        leaf.append("++rows;")
        self._add(deepest, tuple(leaf), tuple(operands))
        loops, counted = printed(self._items, self._loops, self._target, self._taken)
        text = "\n".join([*(f"    {line}" for line in before), loops, *(f"    {line}" for line in behind)])
        arcs = [CALLS[name] for name in self._arcs.calls]
        return CBody(text, frozenset(self._needs), sum_of([counted, *arcs]))

    # -- loops, flags and names ---------------------------------------------------------------------------------------

    def _open(self, tag: str, count: str, most: int, level: int, *, sure: bool = False) -> int:
        """Open a C loop over the roots of one equation and return its depth.

        ``count`` is the C variable with the number of roots, ``most`` its largest value, ``level`` the depth at which
        it is computed. Unless at least one root is ``sure`` to exist, code is added that records at which equation the
        search failed.
        """
        if not sure:
            k = len(self._loops) + 1
            failed = "return 0; " if level == 0 else ""
            self._add(level, (f"if ({count} == 0) {{ *stage = *stage < {k} ? {k} : *stage; {failed}}}",), ())
        loop = Loop(f"i{tag}", count, most, level)
        if level > 0:
            self._add(level, (f"{kept_count(loop)}[{' + '.join(position(self._loops[:level])[0])}] = {count};",), ())
        self._loops.append(loop)
        return len(self._loops)

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
        level: int,
        lines: tuple[str, ...],
        operands: tuple[Scalar, ...],
        *,
        calls: tuple[str, ...] = (),
        rare: tuple[int, ...] = (),
    ) -> None:
        self._items.append(Statement(level, lines, operands, calls=calls, rare=rare))

    def _user(self, joint: Joint, raw: Scalar) -> Scalar:
        """The user's joint value for the value ``raw`` of the derivation: without offset, in (-pi, pi] for an angle."""
        q = joint.sign * (raw - float(joint.offset))
        bare = raw if joint.sign > 0 else -raw
        if not joint.revolute or (q is bare and raw.op is Op.INPUT and raw.text[0] == "x"):
            return q
        text = self._fresh(f"q{joint.index + 1}")
        wrapped = self.pool.var(text, q.level)
        self._items.append(Statement(q.level, (f"const REAL {text} = ik_wrap({{0}});",), (q,), wrapped, ("wrap",)))
        return wrapped

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

    def _fresh(self, hint: str) -> str:
        text, serial = hint, 1
        while text in self._taken:
            serial += 1
            text = f"{hint}_{serial}"
        self._taken.add(text)
        return text
