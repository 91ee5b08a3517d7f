"""The builder that records the operations of a derivation as a :class:`rrrgen.ik.recording.solver.Solver`."""

from __future__ import annotations

from rrrgen.base.errors import InternalError
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import Rigid, S, Vector
from rrrgen.ik.recording import steps
from rrrgen.ik.recording.builder import Feasible, Label, Turn
from rrrgen.ik.recording.scalar import Pool, SolverScalar, fresh_name
from rrrgen.ik.recording.solver import Solver


class Recorder:
    """Builder that appends one :class:`rrrgen.ik.recording.steps.Step` for each operation of a derivation."""

    def __init__(self, pool: Pool | None = None) -> None:
        self.pool = pool or Pool()
        self._steps: list[steps.Step] = []
        self._taken: set[str] = set()
        self._solved: set[int] = set()
        self._level = 0
        self._target: tuple[SolverScalar, ...] = ()

    def solver(self, n: int) -> Solver:
        """The recorded solver of an arm with ``n`` joints; raises InternalError where a joint has no value."""
        missing = [j + 1 for j in range(n) if j not in self._solved]
        if missing:
            raise InternalError(f"no value for joints {missing}")
        return Solver(n, tuple(self._steps))

    # -- inputs -------------------------------------------------------------------------------------------------------

    def pose(self) -> Rigid:
        """The target pose, as twelve variables."""
        if not self._target:
            entries = [*(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), "px", "py", "pz"]
            self._target = self._variables(entries, 0)
            self._steps.append(steps.TargetStep(self._target))
        r11, r12, r13, r21, r22, r23, r31, r32, r33, x, y, z = self._target
        return Rigid(((r11, r12, r13), (r21, r22, r23), (r31, r32, r33)), (x, y, z))

    def point(self) -> Vector:
        """The target position, as three variables."""
        results = self._variables(["px", "py", "pz"], 0)
        self._steps.append(steps.TargetStep(results))
        return (results[0], results[1], results[2])

    def tool(self) -> Vector:
        """The position of the tool, as three variables."""
        results = self._variables(["tx", "ty", "tz"], 0)
        self._steps.append(steps.ToolStep(results))
        return (results[0], results[1], results[2])

    # -- values -------------------------------------------------------------------------------------------------------

    def name(self, hint: str, x: S) -> SolverScalar:
        """Give ``x`` a name, unless it is a number or a variable already."""
        node = self.pool.of(x)
        if node.is_plain:
            return node
        results = self._variables([hint], node.level)
        self._steps.append(steps.NamedStep(results, hint, node))
        return results[0]

    def names(self, hint: str, v: Vector) -> Vector:
        """Name the coordinates of the vector ``v`` in the emitted code: ``hint`` followed by x, y or z."""
        return (self.name(f"{hint}x", v[0]), self.name(f"{hint}y", v[1]), self.name(f"{hint}z", v[2]))

    def sqrt(self, x: S) -> SolverScalar:
        """The square root; round-off below zero counts as zero."""
        return self.pool.sqrt(self.pool.of(x))

    # -- choices ------------------------------------------------------------------------------------------------------

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Record the equation ``A cos(x) + B sin(x) = C`` with its two roots."""
        a, b, c = self._nodes(A, B, C)
        if a.is_const and b.is_const and a.value == b.value == 0:
            raise InternalError(f"the equation of joint {joint.index + 1} does not contain it")
        better = None if radicand is None else self.pool.of(radicand)
        results = self._turn(joint, self._open_level())
        self._steps.append(steps.PairStep(results, joint, (a, b, c), label, unit, better))
        return Turn(*results)

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> SolverScalar:
        """Record the choice between the two square roots of ``radicand``."""
        node, big = self._nodes(radicand, size)
        results = self._variables([hint], self._open_level())
        self._steps.append(steps.SignedRootStep(results, hint, node, big, joint, label, unit))
        return results[0]

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Record the equation ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0`` with up to four roots."""
        k0, k1, k2, k3, k4 = self._nodes(*k)
        results = self._turn(joint, self._open_level())
        self._steps.append(steps.QuarticStep(results, joint, (k0, k1, k2, k3, k4), label))
        return Turn(*results)

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> SolverScalar:
        """Record the equation ``k0 + k1 x + k2 x^2 + ... = 0`` with up to four roots; with degree 1 as a quotient."""
        nodes = self._nodes(*k)
        if len(nodes) == 2:
            return self.slide(joint, -nodes[0] / nodes[1])
        results = self._displacement(joint, self._open_level())
        self._steps.append(steps.PolynomialStep(results, joint, nodes, label, unit))
        return results[0]

    # -- single answers -----------------------------------------------------------------------------------------------

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """Record the angle ``atan2(s, c)``; where both vanish it is the caller's reference value of the joint."""
        nodes = self._nodes(s, c)
        results = self._turn(joint, _deepest(nodes))
        self._steps.append(steps.TurnStep(results, joint, *nodes))
        return Turn(*results)

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """Record the angle about z that turns ``v`` onto ``u``; the caller's reference where one lies along z."""
        vx, vy, vz, ux, uy, uz = self._nodes(*v, *u)
        bounds = None
        if feasible is not None:
            mean, cosine, sine, lower, upper = self._nodes(*feasible)
            bounds = (mean, cosine, sine, lower, upper)
        results = self._turn(joint, _deepest((vx, vy, vz, ux, uy, uz, *(bounds or ()))))
        self._steps.append(steps.OntoStep(results, joint, (vx, vy, vz), (ux, uy, uz), unit, bounds))
        return Turn(*results)

    def slide(self, joint: Joint, x: S) -> SolverScalar:
        """Set ``joint`` to the value ``x``: a displacement, or an angle that follows from others."""
        node = self.pool.of(x)
        results = self._displacement(joint, node.level)
        self._steps.append(steps.SlideStep(results, joint, node))
        return results[0]

    def redundancy_parameter(self, joint: Joint) -> Turn | SolverScalar:
        """The joint that the caller prescribes: the redundancy parameter."""
        results = self._turn(joint, 0) if joint.revolute else self._displacement(joint, 0)
        self._steps.append(steps.GivenStep(results, joint))
        return Turn(*results) if joint.revolute else results[0]

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """Record ``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M``, (e4, e5) = ``signs``, with two solutions."""
        ax, ay, az, bx, by, bz = self._nodes(*(row[0] for row in M), *(row[2] for row in M))
        level = self._open_level()
        turns = [self._turn(joint, level) for joint in joints]
        results = tuple(value for turn in turns for value in turn)
        self._steps.append(steps.WristStep(results, joints, ((ax, ay, az), (bx, by, bz)), signs))
        return Turn(*turns[0]), Turn(*turns[1]), Turn(*turns[2])

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Record quantities that are zero at a solution; a candidate is kept only if they are zero."""
        self._steps.append(steps.ResidualStep((), self._nodes(*lengths), self._nodes(*cosines)))

    # -- variables ----------------------------------------------------------------------------------------------------

    def _nodes(self, *values: S) -> tuple[SolverScalar, ...]:
        return tuple(self.pool.of(x) for x in values)

    def _open_level(self) -> int:
        """Begin one more root selection, nested in those before it; returns the level of values that depend on it."""
        self._level += 1
        return self._level

    def _turn(self, joint: Joint, level: int) -> tuple[SolverScalar, ...]:
        self._solves(joint)
        return self._variables([f"c{joint.index + 1}", f"s{joint.index + 1}"], level)

    def _displacement(self, joint: Joint, level: int) -> tuple[SolverScalar, ...]:
        self._solves(joint)
        return self._variables([f"x{joint.index + 1}"], level)

    def _solves(self, joint: Joint) -> None:
        if joint.index in self._solved:
            raise InternalError(f"joint {joint.index + 1} is solved twice")
        self._solved.add(joint.index)

    def _variables(self, hints: list[str], level: int) -> tuple[SolverScalar, ...]:
        return tuple(self.pool.var(fresh_name(hint, self._taken), level) for hint in hints)


def _deepest(nodes: tuple[SolverScalar, ...]) -> int:
    return max(node.level for node in nodes)
