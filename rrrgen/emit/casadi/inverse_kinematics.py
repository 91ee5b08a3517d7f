"""The closed-form inverse kinematics as CasADi Functions: one configuration per branch, smooth off singularities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import DerivationError
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.classify import plan_with_tool
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import Rigid, S, Vector, dot
from rrrgen.ik.recording.builder import Feasible, Label, Turn, between
from rrrgen.ik.tolerances import ON_COUPLING

if TYPE_CHECKING:
    from rrrgen.ik.geometry.mechanism import Coupling
    from rrrgen.ik.plan import SolverPlan
    from rrrgen.robot.spec import RobotSpec


MOST_CHOICES = 8
"""Signs for a first run of a solver, which counts those it asks for: more than any closed form has."""


class CasadiBuilder:
    """Evaluates a recorded inverse kinematics in CasADi's SX; roots take their signs from ``branch_signs``."""

    def __init__(self, target: Any, branch: Any, redundancy: Any, *, position: bool) -> None:
        import casadi

        self.ca, self.target, self.branch, self.redundancy, self._position = (
            casadi,
            target,
            branch,
            redundancy,
            position,
        )
        self.labels: list[str] = []
        self.values: dict[int, Any] = {}

    def pose(self) -> Rigid:
        """The target pose, the 4x4 input of the function, as rotation and translation."""
        rows = [[self.target[i, j] for j in range(4)] for i in range(3)]
        x, y, z = ((row[0], row[1], row[2]) for row in rows)
        return Rigid((x, y, z), (rows[0][3], rows[1][3], rows[2][3]))

    def point(self) -> Vector:
        """The target position (3,): the input of a position solver, or the last column of the target pose."""
        if not self._position:
            return self.pose().t
        return (self.target[0], self.target[1], self.target[2])

    def tool(self) -> Vector:
        """The position of the tool, which follows that of the target."""
        return (self.target[3], self.target[4], self.target[5])

    def name(self, hint: str, x: S) -> S:
        """Return ``x`` unchanged: in CasADi intermediate values need no names."""
        return x

    def names(self, hint: str, v: Vector) -> Vector:
        """Return ``v`` unchanged: in CasADi intermediate values need no names."""
        return v

    def sqrt(self, x: S) -> S:
        """The square root of ``x``, NaN for negative ``x``."""
        return self.ca.sqrt(x)

    def _sign(self, label: Label) -> Any:
        self.labels.append(label.name)
        sign = self.branch[len(self.labels) - 1]
        return sign if label.positive > 0 else -sign

    def _set(self, joint: Joint, raw: Any) -> None:
        q = joint.sign * (raw - float(joint.offset))
        if joint.revolute and float(joint.offset) != 0.0:
            q = self.ca.atan2(self.ca.sin(q), self.ca.cos(q))
        self.values[joint.index] = q

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """The angle x with ``A cos(x) + B sin(x) = C`` on the branch that the next entry of ``branch_signs`` names."""
        h2 = A * A + B * B
        w = self._sign(label) * self.ca.sqrt(h2 - C * C if radicand is None else radicand)
        c, s = (A * C - B * w) / h2, (B * C + A * w) / h2
        self._set(joint, self.ca.atan2(s, c))
        return Turn(c, s)

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> S:
        """The square root of ``radicand`` with the sign that the next entry of ``branch_signs`` selects."""
        return self._sign(label) * self.ca.sqrt(radicand)

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Raise DerivationError: the roots of a quartic have no formula that stays smooth along a branch."""
        raise DerivationError(
            f"joint {joint.index + 1} solves a quartic, whose roots have no smooth formula; use the emitted C"
        )

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> S:
        """The displacement x with ``k0 + k1 x + k2 x^2 = 0``; raises DerivationError for a higher degree."""
        if len(k) == 2:
            return self.slide(joint, -k[0] / k[1])
        if len(k) > 3:
            raise DerivationError(
                f"joint {joint.index + 1} solves a quartic, whose roots have no smooth formula; use the emitted C"
            )
        root = self._sign(Label(label.name)) * self.ca.sqrt(k[1] * k[1] - 4 * k[0] * k[2])
        return self.slide(joint, (-k[1] + root) / (2 * k[2]))

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """The single angle ``atan2(s, c)``; its cosine and sine are NaN where both arguments vanish."""
        h = self.ca.sqrt(s * s + c * c)
        self._set(joint, self.ca.atan2(s, c))
        return Turn(c / h, s / h)

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """The angle about z that rotates ``v`` to the direction of ``u``, undefined (NaN) if one of them is along z."""
        c, s = between(v, u)
        return self.turn(joint, s, c)

    def slide(self, joint: Joint, x: S) -> S:
        """Set a prismatic joint to the displacement ``x``, or a joint that depends on others to the angle ``x``."""
        self._set(joint, x)
        return x

    def redundancy_parameter(self, joint: Joint) -> Turn | S:
        """The joint whose value the caller prescribes, the input ``redundancy``; returns its displacement or angle."""
        raw = joint.sign * self.redundancy + float(joint.offset)
        self.values[joint.index] = self.redundancy
        return Turn(self.ca.cos(raw), self.ca.sin(raw)) if joint.revolute else raw

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """One of the two solutions of an orthogonal wrist, selected by the next entry of ``branch_signs``.

        The equation is ``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M`` with (e4, e5) = ``signs``.
        """
        e4, e5 = signs
        flip = self._sign(Label("wrist"))
        s4, c4 = flip * e5 * M[1][2], flip * e5 * M[0][2]
        size = self.ca.sqrt(s4 * s4 + c4 * c4)
        s5, c5 = flip * size, -e4 * e5 * M[2][2]
        s4, c4 = s4 / size, c4 / size
        mx = (M[0][0], M[1][0], M[2][0])
        s6, c6 = dot((e4 * e5 * s4, -e4 * e5 * c4, 0), mx), dot((c4 * c5, s4 * c5, e4 * s5), mx)
        for joint, (s, c) in zip(joints, ((s4, c4), (s5, c5), (s6, c6)), strict=True):
            self._set(joint, self.ca.atan2(s, c))
        return Turn(c4, s4), Turn(c5, s5), Turn(c6, s6)

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Ignore the check of a candidate: the number of results is fixed, and NaN marks an unreachable target."""


def branch_function(spec: RobotSpec, redundancy: int | None = None, *, tool: bool = False) -> Any:
    """The inverse kinematics of ``spec`` as ``casadi.Function(target, branch_signs[, redundancy]) -> q``.

    ``target`` is the position (3) or the pose (4x4), m; ``branch_signs`` one entry +1 or -1 per choice, in the order of
    :func:`branch_labels`; ``q`` (n) in (-pi, pi], rad or m. A target that the branch does not reach gives NaN; joint
    limits are ignored. For a mechanism ``q`` are its joint positions, NaN also where the branch does not satisfy the
    coupling ``y = S q`` of the rows to the tip. If several q give the same configuration of the rows, as with gears, a
    further input ``turns`` (n) chooses among them: whole numbers of full turns, added to the displacements of the rows
    ``Coupling.pivots``. With ``tool``, for positions only, the target has three numbers more: the position of the
    tool in the frame of the last link. Raises DerivationError for chains without a solver, and
    for those that solve a quartic.
    """
    import casadi

    plan = _plan(spec, redundancy, tool)
    target, parameter = _target(plan), casadi.SX.sym("redundancy")
    labels = _play_equations(plan, target, casadi.SX.ones(MOST_CHOICES), parameter).labels
    branch = casadi.SX.sym("branch_signs", len(labels))
    builder = _play_equations(plan, target, branch, parameter)
    q = casadi.vertcat(*(builder.values[j] for j in range(plan.chain.n)))
    inputs, names = [target, branch], ["target", "branch_signs"]
    if plan.locked is not None:
        inputs, names = [*inputs, parameter], [*names, "redundancy"]
    if plan.coupling is not None:
        turns = casadi.SX.sym("turns", plan.n)
        geared = plan.coupling.count > 1
        q = _solve_coupling(plan, plan.coupling, q, turns if geared else casadi.SX.zeros(plan.n))
        inputs, names = ([*inputs, turns], [*names, "turns"]) if geared else (inputs, names)
    name = "tool_inverse_kinematics" if tool else "inverse_kinematics"
    return casadi.Function(f"{spec.name}_{name}", inputs, [q], names, ["q"])


def _solve_coupling(plan: SolverPlan, coupling: Coupling, y: Any, turns: Any) -> Any:
    """The joint positions q of a mechanism whose rows have the displacements ``y = S q``; NaN where no q fits.

    ``turns`` (n,) are whole numbers of full turns, added to the displacements of the rows ``coupling.pivots``.
    """
    import casadi

    turning = casadi.DM([float(plan.chain.joints[p].revolute) for p in coupling.pivots])
    q = casadi.DM(coupling.inverse) @ (y[list(coupling.pivots)] + 2 * casadi.pi * turning * turns)
    off = casadi.DM(coupling.matrix) @ q - y
    most: Any = 0
    for k, joint in enumerate(plan.chain.joints):
        # half the chord of an angle: full turns do not count
        length = casadi.sin(off[k] / 2) * 2 if joint.revolute else off[k] / plan.chain.reach
        most = casadi.fmax(most, casadi.fabs(length))
    return casadi.if_else(most < ON_COUPLING, q, casadi.DM.nan(plan.n))


def branch_labels(spec: RobotSpec, redundancy: int | None = None) -> tuple[str, ...]:
    """Names of the binary choices that select a solution, in order, e.g. ``("shoulder", "elbow", "wrist")``."""
    import casadi

    plan = _plan(spec, redundancy)
    ones = casadi.SX.ones(MOST_CHOICES)
    return tuple(_play_equations(plan, _target(plan), ones, casadi.SX.sym("redundancy")).labels)


def branch_signs(labels: tuple[tuple[str, int, int], ...], branch: int) -> list[int]:
    """The input ``branch_signs`` of :func:`branch_function`, +1 or -1 per choice, for a branch number of the emitted C.

    ``labels`` holds (name, lowest bit, number of bits) of each choice; a bit of 0 means +1.
    """
    return [1 if (int(branch) >> bit) & 1 == 0 else -1 for _, bit, _ in labels]


def _plan(spec: RobotSpec, redundancy: int | None, tool: bool = False) -> SolverPlan:
    plan = plan_with_tool(spec) if tool else make_plan(spec, redundancy)
    if not plan.solvable:
        raise DerivationError(f"{spec.name}: {plan.reason}")
    if plan.general:
        raise DerivationError(f"{spec.name}: {plan.title}; its roots have no closed form per branch, use the emitted C")
    if plan.snapped:
        raise DerivationError(f"{spec.name}: nearly special geometry has no exact closed form; use the emitted C")
    return plan


def _target(plan: SolverPlan) -> Any:
    import casadi

    size = 3 if plan.last_link is None else 6
    return casadi.SX.sym("p", size) if plan.task == "position" else casadi.SX.sym("T", 4, 4)


def _play_equations(plan: SolverPlan, target: Any, branch: Any, parameter: Any) -> CasadiBuilder:
    builder = CasadiBuilder(target, branch, parameter, position=plan.task == "position")
    plan.equations.play(builder)
    return builder
