"""Writes a recorded inverse kinematics as C: a nest of loops over the roots of its equations, which passes improve."""

from __future__ import annotations

from math import hypot

from rrrgen.base.errors import InternalError
from rrrgen.emit.c.ik.common_code import Scaffold
from rrrgen.emit.c.ik.loop_nest import ARC, ArcTangent
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import S, Vector, dot, minus, square, total
from rrrgen.ik.recording.builder import Feasible, Label, Turn, between, users_turn
from rrrgen.ik.recording.scalar import SolverScalar
from rrrgen.ik.tolerances import SIZE_OF_NOTHING, USUAL_RATIO


class CBuilder(Scaffold):
    """The builder that prints a recorded solver as C statements, with a loop over the roots of each equation."""

    # -- choices ------------------------------------------------------------------------------------------------------

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Print the solution of ``A cos(x) + B sin(x) = C`` and a loop over both angles x."""
        a, b, k = self.pool.of(A), self.pool.of(B), self.pool.of(C)
        tag = self._tag(joint)
        if a.is_const and b.is_const:
            return self._fixed_pair(joint, a.value, b.value, k, label, tag, radicand, unit)
        w2 = "(REAL)-1" if radicand is None else "{4}"
        extra = () if radicand is None else (self.pool.of(radicand),)
        a, b, k, w, n = self._add(
            (
                *(f"REAL {letter}{tag} = {{{slot}}};" for slot, letter in enumerate("abk")),
                f"REAL w{tag};",
                f"unsigned f{tag} = 0u;",
                f"const int n{tag} = ik_linear(&a{tag}, &b{tag}, &k{tag}, {w2}, {self._real(unit)}, {{3}}, "
                f"least, {self._open_bit(joint)}, {self._free_bits(joint)}, {self._slack}, &w{tag}, &f{tag});",
            ),
            (a, b, k, self.reference(joint), *extra),
            defines=tuple(f"{letter}{tag}" for letter in "abkwn"),
            calls=("linear" if radicand is None else "linear_given",),
            rare=(3,),
        )
        self._needs.add("linear")
        self._flags.append(f"f{tag}")
        v = self._loop(tag, n, w, label, f"v{tag}")
        return self._angle(joint, self._define_turn(tag, a * k - b * v, b * k + a * v))

    def _fixed_pair(
        self, joint: Joint, a: float, b: float, k: SolverScalar, label: Label, tag: str, radicand: S | None, unit: float
    ) -> Turn:
        """Print the solution of ``a cos(x) + b sin(x) = k`` with constant a and b, and a loop over both angles."""
        h = hypot(a, b)
        if h == 0.0:
            raise InternalError(f"the equation of joint {joint.index + 1} does not contain it")
        ca, sa = a / h, b / h
        k = k / h
        better = None if radicand is None else self.pool.of(radicand) / (h * h)
        cosine, w = self._add(
            (f"REAL k{tag} = {{0}};", f"REAL w{tag};"),
            (k,),
            defines=(f"k{tag}", f"w{tag}"),
            beside=() if better is None else (better,),
        )
        w2 = (1 - cosine) * (1 + cosine) if better is None else better
        (n,) = self._add(
            (
                f"unsigned f{tag} = 0u;",
                f"const int n{tag} = ik_cosine(&k{tag}, {{0}}, {self._cosine_tolerance(unit / h)}, &w{tag}, &f{tag});",
            ),
            (w2, cosine),
            defines=(f"n{tag}",),
            calls=("cosine",),
        )
        self._needs.add("cosine")
        self._flags.append(f"f{tag}")
        v = self._loop(tag, n, w, label, f"v{tag}")
        return self._angle(joint, self._define_turn(tag, ca * cosine - sa * v, sa * cosine + ca * v))

    def _cosine_tolerance(self, ratio: float) -> str:
        """The C text of the tolerance by which a computed cosine may exceed 1 in magnitude.

        The cosine is a quotient of terms that are ``ratio`` times as large as the divisor. Where solutions of a special
        arm are refined on one nearby, the tolerance grows in proportion to a ratio above ``USUAL_RATIO``.
        """
        if not self._margins or ratio <= USUAL_RATIO:
            return self._slack
        return self._slack.replace("slack", f"{self._real(ratio / USUAL_RATIO)} * slack", 1)

    def _root_tolerance(self, size: str, unit: float) -> str:
        """The C text of the tolerance up to which a negative discriminant counts as zero.

        ``size`` is the C text of the size of its terms (m^2). Where solutions of a special arm are refined on one
        nearby, the tolerance is wider if that size is small relative to ``unit`` (m) squared.
        """
        if not self._margins:
            return self._slack
        wide = f"(least > IK_TOL_FREE) ? ik_wide(slack, {size}, {self._real(unit)}) : slack"
        return self._slack.replace("slack", wide, 1)

    def _loop(self, tag: str, n: SolverScalar, w: SolverScalar, label: Label, name: str) -> SolverScalar:
        """Open a loop over ``n`` = 1 or 2 roots, ``w`` and ``-w``; returns the root of a pass, called ``name`` in C."""
        i = self._open(tag, n, 2)
        first, second = ("", "-") if label.positive > 0 else ("-", "")
        self._branch.append((f"(unsigned)i{tag}", 1))
        return self._add(
            (f"const REAL {name} = (i{tag} == 0) ? {first}w{tag} : {second}w{tag};",), (i, w), defines=(name,)
        )[0]

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> SolverScalar:
        """Print the square root of ``radicand`` and a loop over both signs.

        ``size`` is the magnitude of the terms of ``radicand``: a negative value that is only rounding of terms of that
        size counts as zero.
        """
        node, big = self.pool.of(radicand), self.pool.of(size) + (SIZE_OF_NOTHING * unit) * unit
        tag = self._fresh_tag(hint)
        w, n = self._add(
            (
                f"REAL w{tag};",
                f"unsigned f{tag} = 0u;",
                f"const int n{tag} = ik_root({{0}}, {{1}}, {self._root_tolerance('{1}', unit)}, &w{tag}, &f{tag});",
            ),
            (node, big),
            defines=(f"w{tag}", f"n{tag}"),
            calls=("root_constant" if big.is_const else "root",),
        )
        self._needs.add("root")
        self._flags.append(f"f{tag}")
        return self._loop(tag, n, w, label, hint)

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Print the solution of ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0``, a loop over its roots."""
        tag = self._tag(joint)
        nodes = tuple(self.pool.of(x) for x in k)
        *arrays, n = self._add(
            (
                *(f"REAL {letter}{tag}_[4];" for letter in "csx"),
                f"unsigned g{tag}[4];",
                f"const int n{tag} = ik_quartic({{0}}, {{1}}, {{2}}, {{3}}, {{4}}, slack, "
                f"c{tag}_, s{tag}_, x{tag}_, g{tag});",
            ),
            nodes,
            defines=(f"c{tag}_", f"s{tag}_", f"x{tag}_", f"n{tag}"),
            calls=("quartic",),
        )
        self._needs.update(("quartic", "near"))
        i = self._open(tag, n, 4)
        c, s, x = self._add(
            tuple(f"const REAL {letter}{tag} = {letter}{tag}_[i{tag}];" for letter in "csx"),
            (*arrays, i),
            defines=(f"c{tag}", f"s{tag}", f"x{tag}"),
        )
        self._branch.append((f"g{tag}[i{tag}]", 2))
        self._values[joint.index] = self._user(joint, x)
        return Turn(c, s)

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> SolverScalar:
        """Print C that solves ``k0 + k1 x + k2 x^2 + ... = 0`` for the position x of a slide and loops over its roots.

        Real roots count, of which there are at most four.
        """
        nodes = tuple(self.pool.of(x) for x in k)
        if len(nodes) == 2:
            return self.slide(joint, -nodes[0] / nodes[1])
        tag = self._tag(joint)
        most = len(nodes) - 1
        kind = "quadratic" if most == 2 else "power4"
        slack = self._slack if most == 2 else "slack"
        slots = ", ".join(f"{{{i}}}" for i in range(len(nodes)))
        roots, n = self._add(
            (
                f"REAL x{tag}_[{most}];",
                f"unsigned g{tag}[{most}];",
                f"unsigned f{tag} = 0u;",
                f"const int n{tag} = ik_{kind}({slots}, {self._real(unit)}, {slack}, x{tag}_, g{tag}, &f{tag});",
            ),
            nodes,
            defines=(f"x{tag}_", f"n{tag}"),
            calls=(kind,),
        )
        self._needs.update((kind, "near"))
        self._flags.append(f"f{tag}")
        i = self._open(tag, n, most)
        (x,) = self._add((f"const REAL x{tag} = x{tag}_[i{tag}];",), (roots, i), defines=(f"x{tag}",))
        self._branch.append((f"g{tag}[i{tag}]", 1 if most == 2 else 2))
        self._values[joint.index] = self._user(joint, x)
        return x

    # -- single answers -----------------------------------------------------------------------------------------------

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """Print the angle ``atan2(s, c)``; where both vanish it is the caller's reference value of the joint."""
        tag = self._tag(joint)
        arc = self._arc_before_scaling(joint, tag)
        turn = Turn(
            *self._add(
                (f"REAL c{tag} = {{1}};", f"REAL s{tag} = {{0}};", *self._scale_to_unit(joint, tag, "{2}", arc)),
                (self.pool.of(s), self.pool.of(c), self.reference(joint)),
                defines=(f"c{tag}", f"s{tag}"),
                calls=("unit",) if arc is None else ("unit", "arc"),
                rare=(2,),
                arc=arc,
            )
        )
        return turn if arc is not None else self._angle(joint, turn)

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """Print the angle about z that rotates ``v`` to the direction of ``u``; the reference if one is along z.

        A rotation about z changes neither the length nor the height of ``v``, so any difference in them is added to the
        residual. The arc tangent uses the unscaled direction; the division is left to values that need cosine and sine.
        """
        tag = self._tag(joint)
        before, after = (self._length(f"{hint}{tag}", x) for hint, x in (("from", v), ("onto", u)))
        size = self.name(f"size{tag}", before * after)
        direction = [self.pool.of(x) for x in between(v, u)]
        bounds = () if feasible is None else tuple(self.pool.of(x) for x in feasible)
        reference = "{3}"
        if feasible is not None:
            reference = "ik_feasible({3}, {4}, {5}, {6}, {7}, {8})"
            self._needs.add("feasible")
        bit, scale = self._open_bit(joint), "" if unit == 1.0 else f" * {self._real(unit)}"
        doubt, free = f"(IK_TOL_DOUBT{scale})", f"(least{scale})"
        doubtful = f"{{2}} <= ({doubt} * {doubt})"
        if self._margins:  # `least` may be larger than what is doubtful otherwise
            doubtful = f"({doubtful}) || ({{2}} <= ({free} * {free}))"
        self._flags.append(f"f{tag}")
        a, b, f = self._add(
            (
                f"REAL a{tag} = {{0}};",
                f"REAL b{tag} = {{1}};",
                f"unsigned f{tag} = 0u;",
                f"if ({doubtful}) {{",
                f"    f{tag} = {bit};",
                f"    if ({{2}} <= ({free} * {free})) {{",
                f"        const REAL x{tag} = {reference};",
                f"        f{tag} = {self._free_bits(joint)};",
                f"        a{tag} = COS(x{tag});",
                f"        b{tag} = SIN(x{tag});",
                "    }",
                "}",
            ),
            (*direction, size, self.reference(joint), *bounds),
            defines=(f"a{tag}", f"b{tag}", f"f{tag}"),
            rare=tuple(range(3, 4 + len(bounds))),
        )
        inverse = f"((f{tag} & (unsigned)IK_FREE) != 0u) ? (REAL)1 : ((REAL)1 / {{0}})"
        g = self._define(f"g{tag}", inverse, (size, f), ("inverse",))
        turn = self._define_turn(tag, a * g, b * g)
        self._angle(joint, Turn(a, b) if joint.index in self._joints else turn)
        self._residual.append(self.pool.of(square((before - after, total(v[2], -u[2]), 0)) / (unit * unit)))
        return turn

    def _length(self, hint: str, v: Vector) -> SolverScalar:
        """Name the length of ``v`` perpendicular to z, ``sqrt(x^2 + y^2)``."""
        return self.name(hint, self.pool.sqrt(self.pool.of(square((v[0], v[1], 0)))))

    def _arc_before_scaling(self, joint: Joint, tag: str) -> ArcTangent | None:
        """The arc tangent of a joint without offset, computed from (c, s) before these are scaled to a unit vector.

        That way it does not have to wait for the square root and the division of the scaling. None for other joints.
        """
        if joint.index not in self._joints or joint.offset:
            return None
        angle = self._values[joint.index] = self._angle_variable(joint)
        return ArcTangent(angle, f"c{tag}", f"{'-' if joint.sign < 0 else ''}s{tag}")

    def _scale_to_unit(self, joint: Joint, tag: str, reference: str, arc: ArcTangent | None) -> tuple[str, ...]:
        """C lines that scale (c, s) to a unit vector; where both vanish, it is that of the reference angle."""
        self._needs.add("unit")
        self._flags.append(f"f{tag}")
        return (
            *([] if arc is None else [ARC]),
            f"const unsigned f{tag} = ik_unit(&c{tag}, &s{tag}, least, "
            f"{self._open_bit(joint)}, {self._free_bits(joint)});",
            f"if ((f{tag} & (unsigned)IK_FREE) != 0u) {{",
            f"    const REAL x{tag} = {reference};",
            f"    c{tag} = COS(x{tag});",
            f"    s{tag} = SIN(x{tag});",
            *([] if arc is None else [f"    {ARC}"]),
            "}",
        )

    def slide(self, joint: Joint, x: S) -> SolverScalar:
        """Set a prismatic joint to the displacement ``x``, or a joint that depends on others to the angle ``x``."""
        node = self.name(f"x{self._tag(joint)}", x)
        self._values[joint.index] = self._user(joint, node)
        return node

    def redundancy_parameter(self, joint: Joint) -> Turn | SolverScalar:
        """The joint whose value the caller prescribes, an argument of the solver; returns its displacement or angle."""
        raw = joint.sign * self.pool.var("lock") + float(joint.offset)
        self._values[joint.index] = self.pool.var("lock")
        if not joint.revolute:
            return raw
        tag = self._tag(joint)
        lines = (f"const REAL c{tag} = COS({{0}});", f"const REAL s{tag} = SIN({{0}});")
        return Turn(*self._add(lines, (raw,), defines=(f"c{tag}", f"s{tag}"), calls=("angle",)))

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """Print both solutions of an orthogonal wrist, ``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M``.

        The third column of M gives x4 and x5, and the rotation that remains after them gives x6. The second solution
        follows from the first (:meth:`_flip_wrist`).
        """
        first, middle, last = (self._tag(joint) for joint in joints)
        e4, e5 = signs
        nodes = tuple(self.pool.of(x) for x in (e5 * M[0][2], e5 * M[1][2], -e4 * e5 * M[2][2]))
        mx = (self.name("mx", M[0][0]), self.name("my", M[1][0]), self.name("mz", M[2][0]))
        arc = self._arc_before_scaling(joints[0], first)
        c4, s4, c5, s5, f = self._add(
            (
                f"REAL c{first} = {{0}};",
                f"REAL s{first} = {{1}};",
                f"const REAL s{middle} = SQRT((c{first} * c{first}) + (s{first} * s{first}));",
                f"const REAL c{middle} = {{2}};",
                *self._scale_to_unit(joints[0], first, "{3}", arc),
            ),
            (*nodes, self.reference(joints[0])),
            defines=(f"c{first}", f"s{first}", f"c{middle}", f"s{middle}", f"f{first}"),
            calls=("length", "unit") if arc is None else ("length", "unit", "arc"),
            rare=(3,),
            arc=arc,
        )
        self._needs.add("wrist")
        column0 = (self.name("ux", c4 * c5), self.name("uy", s4 * c5), e4 * s5)
        column1 = (e4 * e5 * s4, -(e4 * e5) * c4, 0)
        c6, s6 = self._define_turn(last, self.pool.of(dot(column0, mx)), self.pool.of(dot(column1, mx)))
        built = tuple(total(c6 * u, s6 * v) for u, v in zip(column0, column1, strict=True))
        self.residual((), minus(built, mx))
        line = f"const int n{first}f = 1 + (int)((f{first} & (unsigned)IK_FREE) == 0u);"
        (n,) = self._add((line,), (f,), defines=(f"n{first}f",))
        turns = (Turn(c4, s4), Turn(c5, s5), Turn(self.pool.of(c6), self.pool.of(s6)))
        return self._flip_wrist(joints, turns, f"{first}f", n)

    def _flip_wrist(
        self, joints: tuple[Joint, Joint, Joint], turns: tuple[Turn, Turn, Turn], tag: str, n: SolverScalar
    ) -> tuple[Turn, Turn, Turn]:
        """Print a loop over both solutions of a wrist: in the second x4 and x6 are rotated by pi, and x5 is negated."""
        middle = joints[1]
        real = [joint for joint in joints if joint.index in self._joints]
        for joint, turn in zip(joints, turns, strict=True):
            if joint in real and joint.index not in self._values:
                self._angle(joint, turn)
        x4, x5, x6 = turns
        other = None
        if middle in real and middle.offset:
            other = self._arc(middle, users_turn(middle, Turn(x5.c, -x5.s)))
        i = self._open(tag, n, 2, sure=True)
        self._branch.append((f"(unsigned){i.text}", 1))
        for joint in real:
            if joint is middle:
                self._flip(joint, i, other, "" if other is not None else "-{}")
            else:
                self._flip(joint, i, None, "ik_opposite({})")
        virtual = [joint for joint in joints if joint not in real]
        if not virtual and all(index in self._values for index in self._joints):
            return turns
        g = self._define(f"g{tag}", "({0} == 0) ? (REAL)1 : (REAL)-1", (i,))
        flipped = (Turn(g * x4.c, g * x4.s), Turn(x5.c, g * x5.s), Turn(g * x6.c, g * x6.s))
        for joint, turn in zip(joints, flipped, strict=True):
            if joint in virtual:
                self._angle(joint, turn)
        return flipped
