"""What every derivation in C stands on: inputs, named values, loops, angles, and the finished body."""

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
    """Collects statements between loops over roots; :meth:`body` prints them."""

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
        """The target: ``T`` is a row-major 4x4 matrix."""
        rows = [[self.pool.var(f"T[{4 * i + j}]") for j in range(4)] for i in range(3)]
        x, y, z = ((row[0], row[1], row[2]) for row in rows)
        return Rigid((x, y, z), (rows[0][3], rows[1][3], rows[2][3]))

    def point(self) -> Vector:
        """The target position: a position solver receives three numbers, a pose solver the last column."""
        if not self._position_only:
            return self.pose().t
        return (self.pool.var("T[0]"), self.pool.var("T[1]"), self.pool.var("T[2]"))

    def reference(self, joint: Joint) -> Scalar:
        """The raw reference value of a joint: zero for a virtual one."""
        if joint.index not in self._joints:
            return self.pool.of(float(joint.offset))
        return joint.sign * self.pool.var(f"ref[{joint.index}]") + float(joint.offset)

    # -- values -------------------------------------------------------------------------------------------------------

    def name(self, hint: str, x: S) -> Scalar:
        """``const REAL hint = x;``."""
        node = self.pool.of(x)
        if node.is_plain:
            return node
        text = self._fresh(hint)
        variable = self.pool.var(text, node.level)
        self._items.append(Statement(node.level, (f"const REAL {text} = {{0}};",), (node,), variable))
        return variable

    def names(self, hint: str, v: Vector) -> Vector:
        """Three named coordinates."""
        return (self.name(f"{hint}x", v[0]), self.name(f"{hint}y", v[1]), self.name(f"{hint}z", v[2]))

    def sqrt(self, x: S) -> Scalar:
        """The square root; round-off below zero counts as zero."""
        return self.pool.clamped_sqrt(self.pool.of(x))

    # -- angles -------------------------------------------------------------------------------------------------------

    def _turned(self, tag: str, c: Scalar, s: Scalar) -> Turn:
        """The cosine and sine of a joint under its own names."""
        self._taken -= {f"c{tag}", f"s{tag}"}
        return Turn(self.name(f"c{tag}", c), self.name(f"s{tag}", s))

    def _angle(self, joint: Joint, turn: Turn, outside: int | None = None) -> Turn:
        """Keep the angle of a joint: its arc is taken behind the loops. A virtual joint must stand at zero.

        The loop opened last is the joint's own where ``outside``, the level of its equation, is given.
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
        """A slot with the cosine and sine of an angle."""
        slot = self._arcs.slot(loops)
        at = slot.text()
        self._add(level, (f"cosine[{at}] = {{0}};", f"sine[{at}] = {{1}};"), tuple(map(self.pool.of, users)))
        return slot

    def _level(self, turn: Turn) -> int:
        return max(self.pool.of(turn.c).level, self.pool.of(turn.s).level)

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Quantities that vanish at a solution; a solution is kept only if they do."""
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
        """Open a loop over the roots of a choice; unless there is ``sure`` to be one, none fails this stage."""
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
        """The inner flag of a joint that may be free; 0 for a virtual one, which stands at zero then."""
        if joint.index not in self._joints:
            return "0u"
        return f"{256 << joint.index}u"

    def _free_bits(self, joint: Joint) -> str:
        """The flags of a joint that is free."""
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
        """The user's joint value of a raw one, wrapped where an offset can push it out of (-pi, pi]."""
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
