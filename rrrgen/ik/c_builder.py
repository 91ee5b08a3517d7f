"""The derivation as C: straight-line blocks between loops over root signs, each value as far outside as it can be."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, hypot, pi

from rrrgen.errors import InternalError
from rrrgen.ik.builder import Feasible, Label, Turn
from rrrgen.ik.c_statements import CBody, Stage, Statement, printed
from rrrgen.ik.chain import Joint
from rrrgen.ik.rigid import Rigid, S, Vector, dot, minus, square, total
from rrrgen.ik.scalar import Pool, Scalar

VIRTUAL_END = 100
"""Joint indices from n to here are virtual joints, further ones are arguments (the arm angle)."""


class CBuilder:
    """Collects statements; :meth:`body` prints them."""

    def __init__(
        self,
        prefix: str,
        joints: Sequence[Joint],
        length: float,
        *,
        position: bool = False,
        trusted: bool = True,
        banded: bool = False,
    ) -> None:
        self.pool = Pool()
        self._trusted = trusted
        self._slack = "slack, band" if banded else "slack"
        self.prefix = prefix
        self.length = length
        self._joints = {joint.index: joint for joint in joints}
        self._position = position
        self._items: list[Statement] = []
        self._loops: list[tuple[str, str, int]] = []  # loop variable, count, most roots
        self._stages: list[Stage] = []
        self._values: dict[int, Scalar] = {}
        self._flags: list[tuple[int, str]] = []
        self._branch: list[tuple[str, str, int]] = []  # label, expression, bits
        self._residual: list[Scalar] = []
        self._taken: set[str] = set()
        self._needs: set[str] = set()

    # -- inputs -------------------------------------------------------------------------------------------------------

    def pose(self) -> Rigid:
        """The target: ``T`` is a row-major 4x4 matrix."""
        rows = [[self.pool.var(f"T[{4 * i + j}]") for j in range(4)] for i in range(3)]
        x, y, z = ((row[0], row[1], row[2]) for row in rows)
        return Rigid((x, y, z), (rows[0][3], rows[1][3], rows[2][3]))

    def point(self) -> Vector:
        """The target position: a position solver receives three numbers, a pose solver the last column."""
        if not self._position:
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
        if node.op in ("const", "var") or (node.op == "neg" and node.args[0].op == "var"):
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
        self._needs.add("sqrt")
        node = self.pool.of(x)
        return node if node.is_const and node.value == 0 else self.pool.call("root0", node)

    # -- choices ------------------------------------------------------------------------------------------------------

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """See :class:`rrrgen.ik.builder.Builder`."""
        a, b, k = self.pool.of(A), self.pool.of(B), self.pool.of(C)
        tag = self._tag(joint)
        if a.is_const and b.is_const:
            return self._fixed_pair(joint, a.value, b.value, k, label, tag, radicand)
        level = max(a.level, b.level, k.level)
        w2 = "(REAL)-1" if radicand is None else "{4}"
        extra = () if radicand is None else (self.pool.of(radicand),)
        level = max([level, *(node.level for node in extra)])
        self._add(
            level,
            (
                f"REAL a{tag} = {{0}}, b{tag} = {{1}}, k{tag} = {{2}}, w{tag};",
                f"unsigned f{tag} = 0u;",
                f"const int n{tag} = {self.prefix}_linear(&a{tag}, &b{tag}, &k{tag}, {w2}, {self._real(unit)}, {{3}}, "
                f"{self._slack}, &w{tag}, &f{tag});",
                f"const REAL m{tag} = {self.prefix}_atan2(b{tag}, a{tag});",
                f"const REAL e{tag} = {self.prefix}_atan2(w{tag}, k{tag});",
            ),
            (a, b, k, self.reference(joint), *extra),
        )
        self._needs.add("linear")
        a, b, k = (self.pool.var(f"{letter}{tag}", level) for letter in "abk")
        self._flags.append((level, f"f{tag}"))
        w, x = self._loop(joint, tag, level, label)
        turn = self._turned(tag, a * k - b * w, b * k + a * w)
        self._values[joint.index] = self._user(joint, self.pool.var(f"m{tag}", level) + x)
        return turn

    def _fixed_pair(
        self, joint: Joint, a: float, b: float, k: Scalar, label: Label, tag: str, radicand: S | None
    ) -> Turn:
        """A pair whose direction (A, B) is a constant of the robot."""
        h = hypot(a, b)
        if h == 0.0:
            raise InternalError(f"the equation of joint {joint.index + 1} does not contain it")
        ca, sa, middle = a / h, b / h, atan2(b, a)
        k = k / h
        better = None if radicand is None else self.pool.of(radicand) / (h * h)
        level = k.level if better is None else max(k.level, better.level)
        cosine = self.pool.var(f"k{tag}", level)
        w2 = (1 - cosine) * (1 + cosine) if better is None else better
        self._add(level, (f"REAL k{tag} = {{0}}, w{tag};",), (k,))
        self._add(
            level,
            (
                f"unsigned f{tag} = 0u;",
                f"const int n{tag} = {self.prefix}_cosine(&k{tag}, {{0}}, {self._slack}, &w{tag}, &f{tag});",
                f"const REAL e{tag} = {self.prefix}_atan2(w{tag}, k{tag});",
            ),
            (w2,),
        )
        self._needs.add("cosine")
        self._flags.append((level, f"f{tag}"))
        w, x = self._loop(joint, tag, level, label)
        self._values[joint.index] = self._user(joint, x + middle)
        k = cosine
        return self._turned(tag, ca * k - sa * w, sa * k + ca * w)

    def _turned(self, tag: str, c: Scalar, s: Scalar) -> Turn:
        """The cosine and sine of a joint under its own names."""
        self._taken -= {f"c{tag}", f"s{tag}"}
        return Turn(self.name(f"c{tag}", c), self.name(f"s{tag}", s))

    def _loop(self, joint: Joint, tag: str, level: int, label: Label) -> tuple[Scalar, Scalar]:
        """Open the loop over the signs of ``w``; returns the signed w and the signed angle e."""
        inner = self._open(joint, tag, f"n{tag}", 2, label, level)
        first, second = ("", "-") if label.positive > 0 else ("-", "")
        self._add(
            inner,
            (
                f"const REAL v{tag} = i{tag} == 0 ? {first}w{tag} : {second}w{tag};",
                f"const REAL d{tag} = i{tag} == 0 ? {first}e{tag} : {second}e{tag};",
            ),
            (),
        )
        self._branch.append((label.name, f"(unsigned)i{tag}", 1))
        return self.pool.var(f"v{tag}", inner), self.pool.var(f"d{tag}", inner)

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> Scalar:
        """See :class:`rrrgen.ik.builder.Builder`."""
        node, big = self.pool.of(radicand), self.pool.of(size) + (1e-6 * unit) * unit
        tag = self._fresh_tag(hint)
        level = max(node.level, big.level)
        self._add(
            level,
            (
                f"REAL w{tag};",
                f"unsigned f{tag} = 0u;",
                f"const int n{tag} = {self.prefix}_root({{0}}, {{1}}, {self._slack}, &w{tag}, &f{tag});",
            ),
            (node, big),
        )
        self._needs.add("root")
        self._flags.append((level, f"f{tag}"))
        inner = self._open(joint, tag, f"n{tag}", 2, label, level)
        first, second = ("", "-") if label.positive > 0 else ("-", "")
        self._add(inner, (f"const REAL {hint} = i{tag} == 0 ? {first}w{tag} : {second}w{tag};",), ())
        self._branch.append((label.name, f"(unsigned)i{tag}", 1))
        return self.pool.var(hint, inner)

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """See :class:`rrrgen.ik.builder.Builder`."""
        tag = self._tag(joint)
        nodes = tuple(self.pool.of(x) for x in k)
        level = max(node.level for node in nodes)
        self._add(
            level,
            (
                f"REAL c{tag}_[4], s{tag}_[4], x{tag}_[4];",
                f"unsigned g{tag}[4];",
                f"const int n{tag} = {self.prefix}_quartic({{0}}, {{1}}, {{2}}, {{3}}, {{4}}, slack, "
                f"c{tag}_, s{tag}_, x{tag}_, g{tag});",
            ),
            nodes,
        )
        self._needs.update(("quartic", "near"))
        inner = self._open(joint, tag, f"n{tag}", 4, label, level)
        self._add(
            inner,
            (f"const REAL c{tag} = c{tag}_[i{tag}], s{tag} = s{tag}_[i{tag}], x{tag} = x{tag}_[i{tag}];",),
            (),
        )
        self._branch.append((label.name, f"g{tag}[i{tag}]", 2))
        self._values[joint.index] = self._user(joint, self.pool.var(f"x{tag}", inner))
        return Turn(self.pool.var(f"c{tag}", inner), self.pool.var(f"s{tag}", inner))

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> Scalar:
        """See :class:`rrrgen.ik.builder.Builder`."""
        nodes = tuple(self.pool.of(x) for x in k)
        if len(nodes) == 2:
            return self.slide(joint, -nodes[0] / nodes[1])
        tag = self._tag(joint)
        level = max(node.level for node in nodes)
        most = len(nodes) - 1
        kind = "quadratic" if most == 2 else "power4"
        slack = self._slack if most == 2 else "slack"
        slots = ", ".join(f"{{{i}}}" for i in range(len(nodes)))
        self._add(
            level,
            (
                f"REAL x{tag}_[{most}];",
                f"unsigned g{tag}[{most}], f{tag} = 0u;",
                f"const int n{tag} = {self.prefix}_{kind}({slots}, {self._real(unit)}, {slack}, "
                f"x{tag}_, g{tag}, &f{tag});",
            ),
            nodes,
        )
        self._needs.update((kind, "near"))
        self._flags.append((level, f"f{tag}"))
        inner = self._open(joint, tag, f"n{tag}", most, label, level)
        self._add(inner, (f"const REAL x{tag} = x{tag}_[i{tag}];",), ())
        self._branch.append((label.name, f"g{tag}[i{tag}]", 1 if most == 2 else 2))
        x = self.pool.var(f"x{tag}", inner)
        self._values[joint.index] = self._user(joint, x)
        return x

    # -- single answers -----------------------------------------------------------------------------------------------

    def turn(self, joint: Joint, s: S, c: S, *, unit: float, degree: int = 1, feasible: Feasible | None = None) -> Turn:
        """See :class:`rrrgen.ik.builder.Builder`."""
        tag = self._tag(joint)
        sn, cn = self.pool.of(s), self.pool.of(c)
        level = max(sn.level, cn.level)
        bounds: tuple[Scalar, ...]
        if feasible is None:
            reference, bounds = "{2}", ()
        else:
            bounds = tuple(self.pool.of(x) for x in feasible)
            level = max([level, *(node.level for node in bounds)])
            reference = f"{self.prefix}_feasible({{2}}, {{3}}, {{4}}, {{5}}, {{6}}, {{7}})"
            self._needs.add("feasible")
        self._add(
            level,
            (
                f"REAL c{tag} = {{1}}, s{tag} = {{0}};",
                self._directed(tag, self._least(unit, degree)),
                f"const REAL x{tag} = f{tag} == 0u ? {self.prefix}_atan2(s{tag}, c{tag}) : {reference};",
                f"if (f{tag} != 0u) {{ c{tag} = COS(x{tag}); s{tag} = SIN(x{tag}); }}",
            ),
            (sn, cn, self.reference(joint), *bounds),
        )
        self._needs.add("unit")
        self._flags.append((level, f"f{tag}"))
        self._values[joint.index] = self._user(joint, self.pool.var(f"x{tag}", level))
        return Turn(self.pool.var(f"c{tag}", level), self.pool.var(f"s{tag}", level))

    def slide(self, joint: Joint, x: S) -> Scalar:
        """See :class:`rrrgen.ik.builder.Builder`."""
        node = self.name(f"x{self._tag(joint)}", x)
        self._values[joint.index] = self._user(joint, node)
        return node

    def given(self, joint: Joint) -> Turn | Scalar:
        """The prescribed joint: its value is an argument of the solver."""
        raw = joint.sign * self.pool.var("lock") + float(joint.offset)
        self._values[joint.index] = self.pool.var("lock")
        if not joint.revolute:
            return raw
        tag = self._tag(joint)
        self._add(0, (f"const REAL c{tag} = COS({{0}}), s{tag} = SIN({{0}});",), (raw,))
        return Turn(self.pool.var(f"c{tag}"), self.pool.var(f"s{tag}"))

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """An orthogonal wrist: x5 from the third column of M, x6 from what is left after x4 and x5, then the flip."""
        first, middle, last = (self._tag(joint) for joint in joints)
        e4, e5 = signs
        nodes = tuple(self.pool.of(x) for x in (e5 * M[0][2], e5 * M[1][2], -e4 * e5 * M[2][2]))
        mx = (self.name("mx", M[0][0]), self.name("my", M[1][0]), self.name("mz", M[2][0]))
        level = max(node.level for node in (*nodes, *mx))
        reference = self.reference(joints[0])
        self._add(
            level,
            (
                f"REAL c{first} = {{0}}, s{first} = {{1}};",
                f"const REAL s{middle} = SQRT(c{first} * c{first} + s{first} * s{first}), c{middle} = {{2}};",
                self._directed(first, self._least(1.0, 1)),
                f"const REAL x{first} = f{first} == 0u ? {self.prefix}_atan2(s{first}, c{first}) : {{3}};",
                f"if (f{first} != 0u) {{ c{first} = COS(x{first}); s{first} = SIN(x{first}); }}",
            ),
            (*nodes, reference),
        )
        self._needs.update(("unit", "wrist"))
        c4, s4, c5, s5 = (self.pool.var(text, level) for text in (f"c{first}", f"s{first}", f"c{middle}", f"s{middle}"))
        column0 = (self.name("ux", c4 * c5), self.name("uy", s4 * c5), e4 * s5)
        column1 = (e4 * e5 * s4, -(e4 * e5) * c4, 0)
        c6, s6 = self._turned(last, self.pool.of(dot(column0, mx)), self.pool.of(dot(column1, mx)))
        self._add(
            level,
            (
                f"const REAL x{middle} = {self.prefix}_atan2(s{middle}, c{middle});",
                f"const REAL x{last} = {self.prefix}_atan2({{0}}, {{1}});",
            ),
            (self.pool.of(s6), self.pool.of(c6)),
        )
        built = tuple(total(c6 * u, s6 * v) for u, v in zip(column0, column1, strict=True))
        self.residual((), minus(built, mx))
        self._flags.append((level, f"f{first}"))
        tag = f"{first}f"
        self._add(level, (f"const int n{tag} = f{first} == 0u ? 2 : 1;",), ())
        inner = self._open(joints[1], tag, f"n{tag}", 2, Label("wrist"), level)
        self._branch.append(("wrist", f"(unsigned)i{tag}", 1))
        for joint, name, flipped in (
            (joints[0], first, f"{self.prefix}_opposite(x{first})"),
            (joints[1], middle, f"-x{middle}"),
            (joints[2], last, f"{self.prefix}_opposite(x{last})"),
        ):
            text = f"y{name}"
            self._add(inner, (f"const REAL {text} = i{tag} == 0 ? x{name} : {flipped};",), ())
            self._values[joint.index] = self._user(joint, self.pool.var(text, inner))
        if all(index in self._values for index in self._joints):
            return Turn(c4, s4), Turn(c5, s5), Turn(c6, s6)
        self._add(inner, (f"const REAL g{tag} = i{tag} == 0 ? (REAL)1 : (REAL)-1;",), ())
        g = self.pool.var(f"g{tag}", inner)
        return Turn(g * c4, g * s4), Turn(c5, g * s5), Turn(g * c6, g * s6)

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """See :class:`rrrgen.ik.builder.Builder`."""
        parts = []
        if lengths:
            parts.append(square(lengths) / (self.length * self.length))
        if cosines:
            parts.append(square(cosines))
        self._residual += [self.pool.of(part) for part in parts]

    # -- printing -----------------------------------------------------------------------------------------------------

    def body(self) -> CBody:
        """The branch function's body; every joint must have been given a value."""
        missing = [j + 1 for j in self._joints if j not in self._values]
        if missing:
            raise InternalError(f"no value for joints {missing}")
        deepest = len(self._loops)
        for index, value in self._values.items():
            if index not in self._joints and index < VIRTUAL_END:
                self._residual.append(value * value)  # a virtual joint must stand at zero
        known = self._trusted and self._residual
        error = self.pool.of(total(*self._residual)) if known else self.pool.of(-1.0)
        error = self.name("error", error)
        leaf: list[str] = []
        operands: list[Scalar] = []
        for j in sorted(self._values):
            where = f"q[rows][{j}]" if j in self._joints else ""
            if where:
                leaf.append(f"{where} = {{{len(operands)}}};")
                operands.append(self._values[j])
        flags = " | ".join(text for _, text in self._flags) or "0u"
        leaf.append(f"info[rows].flags = {flags};")
        branch, bit = [], 0
        labels = []
        for name, text, bits in self._branch:
            branch.append(f"({text} << {bit})" if bit else text)
            labels.append((name, bit, bits))
            bit += bits
        leaf.append(f"info[rows].branch = {' | '.join(branch) or '0u'};")
        leaf.append(f"info[rows].error = {{{len(operands)}}};")
        operands.append(error)
        leaf.append("++rows;")
        self._add(deepest, tuple(leaf), tuple(operands))
        rows = 1
        for _, _, most in self._loops:
            rows *= most
        return CBody(
            printed(self._items, self._loops, self._taken),
            rows,
            tuple(self._stages),
            frozenset(self._needs),
            tuple(labels),
        )

    # -- small change -------------------------------------------------------------------------------------------------

    def _open(self, joint: Joint, tag: str, count: str, most: int, label: Label, level: int) -> int:
        self._stages.append(Stage(joint.index, label.name, most))
        k = len(self._stages)
        failed = "return 0; " if level == 0 else ""
        self._add(level, (f"if ({count} == 0) {{ *stage = *stage < {k} ? {k} : *stage; {failed}}}",), ())
        self._loops.append((f"i{tag}", count, most))
        return len(self._loops)

    def _add(self, level: int, lines: tuple[str, ...], operands: tuple[Scalar, ...]) -> None:
        self._items.append(Statement(level, lines, operands))

    def _user(self, joint: Joint, raw: Scalar) -> Scalar:
        """The user's joint value of a raw one, wrapped where an offset can push it out of (-pi, pi]."""
        q = joint.sign * (raw - float(joint.offset))
        bare = raw if joint.sign > 0 else -raw
        if not joint.revolute or (q is bare and raw.op == "var" and raw.text[0] in "xy"):
            return q
        if q.op == "var" and q.text[0] == "d":
            return q
        self._needs.add("wrap")
        return self.pool.call("wrap", q)

    def _directed(self, tag: str, least: str) -> str:
        return f"const unsigned f{tag} = {self.prefix}_unit(&c{tag}, &s{tag}, {least}) ? 0u : FREE;"

    def _least(self, unit: float, degree: int) -> str:
        """The size below which a product of ``degree`` directions of size ``unit`` has none."""
        one = f"{self.prefix.upper()}_TOL_FREE * {self._real(unit)}"
        return one if degree == 1 else " * ".join([f"({one})"] * degree)

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


def wrapped(x: float) -> float:
    """``x`` in (-pi, pi]."""
    return x - 2 * pi * round(x / (2 * pi))
