"""Solver plan: the family of closed forms that solves a chain, its task, number of solutions and singularities."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import InternalError
from rrrgen.ik.geometry.chain import Joint, KinematicChain, Matrix
from rrrgen.ik.geometry.loop import Loop, close, commute_joints, lock, straighten
from rrrgen.ik.geometry.rigid_transforms import Crossing, Vector, minus, rigid, rotate, transpose
from rrrgen.ik.recording.builder import DerivationBuilder, Turn
from rrrgen.ik.recording.recorder import Recorder
from rrrgen.ik.recording.scalar import Pool
from rrrgen.ik.recording.solver import Solver
from rrrgen.ik.solutions.parallel import derive_parallel
from rrrgen.ik.solutions.position import Arm, solve_position
from rrrgen.ik.solutions.reduced import derive_lift, derive_orientation, derive_planar, derive_point
from rrrgen.ik.solutions.spherical_triples import derive_elbow7, derive_spherical

if TYPE_CHECKING:
    import sympy as sp

    from rrrgen.ik.geometry.mechanism import Coupling

Task = Literal["position", "pose"]
Family = Literal[
    "position",
    "point",
    "spherical",
    "parallel",
    "planar",
    "lift",
    "orientation",
    "elbow7",
    "general6r",
    "general5r1p",
    "none",
]


@dataclass(frozen=True)
class Singularity:
    """A set of singular configurations, where branches meet or a joint is free.

    ``words`` describes the set; ``expression``, if known, is the function of the joints that is zero there.
    """

    words: str
    expression: sp.Expr | None = None


@dataclass(frozen=True)
class NominalFirst:
    """The special (nominal) arm whose solutions are refined on the true arm before general equations are solved.

    The general equations are solved only for targets where the refined solutions may not be all.
    ``deviation``: how far the poses of the two arms differ, in rad or parts of the reach. ``changes``: phrases that say
    what is special in the nominal arm and how far the true arm is off.
    """

    deviation: float
    changes: tuple[str, ...]


@dataclass(frozen=True)
class SolverPlan:
    """How the inverse kinematics of one robot is solved: the family of equations, the chain they hold for, the results.

    * ``family``, ``title``: the kind of solver, as an identifier and in words.
    * ``task``: the target is the position of the tip (1 to 3 joints) or its pose.
    * ``solving``: the chain whose equations are solved. It is the user's ``chain`` with nearly special geometry made
      special (solutions are then refined on the true chain) and with virtual joints added.
    * ``max_solutions``: the largest number of solutions of one target.
    * ``first``: index of the first joint of the spherical or planar triple in the loop.
    * ``commute``: (index, direction +1 or -1) of a prismatic joint that is exchanged with its neighbour of parallel
      axis before the equations are derived; None if none is.
    * ``locked``: index of the prescribed joint of a redundant arm, or ``ARM_ANGLE``; ``redundancy`` describes that
      parameter in words.
    * ``virtual``: number of virtual joints that ``solving`` has beyond those of the robot.
    * ``companion``: plan of a special arm close to this one. Its solutions, refined on the true chain, are added,
      because the general equations lose digits near a special geometry.
    * ``snapped``: whether ``solving`` is a special arm near ``chain``.
    * ``incomplete``: why solutions may be missing, where only such a special arm can be solved; empty if none are.
    * ``singularities``: the configurations where solutions meet or a joint is free.
    * ``reason``: why there is no solver, for the family "none".
    * ``solver``: the recorded closed form; None for an elimination.
    * ``coupling``: how ``chain`` follows the joint positions q of a mechanism; None where its joints are q.
    * ``nominal_first``: set if the robot file asks that the solutions of the companion are refined before the general
      equations are solved, and the arm allows it; otherwise None.
    * ``last_link``: set where the position of the tool is an input too: the constant transform from the last joint to
      the frame of the last link, in which that position is given. A target is then six numbers, the position of the
      tool in the base frame and in that frame. None where the tool is the one of ``chain``.
    * ``approach``: text that says whether this request of the robot file has an effect, and why not; empty without it.
    """

    family: Family
    title: str
    task: Task
    chain: KinematicChain
    solving: KinematicChain
    max_solutions: int = 0
    first: int = 0
    commute: tuple[int, int] | None = None
    locked: int | None = None
    redundancy: str = ""
    virtual: int = 0
    companion: SolverPlan | None = None
    snapped: bool = False
    incomplete: str = ""
    singularities: tuple[Singularity, ...] = field(default=())
    reason: str = ""
    solver: Solver | None = field(default=None, compare=False, repr=False)
    coupling: Coupling | None = None
    nominal_first: NominalFirst | None = None
    approach: str = ""
    last_link: Matrix | None = None

    @property
    def n(self) -> int:
        """Number of joints of the robot, which is the number of joint positions in a solution."""
        return self.chain.n if self.coupling is None else self.coupling.n

    @property
    def equations(self) -> Solver:
        """The recorded closed form; InternalError where an elimination solves the chain, or nothing does."""
        if self.solver is None:
            raise InternalError(f"no closed form was recorded for {self.title}")
        return self.solver

    @property
    def general(self) -> bool:
        """Whether the chain is solved by numerical elimination, without a closed form per branch."""
        return self.family in ("general6r", "general5r1p")

    @property
    def solvable(self) -> bool:
        """Whether there is a solver for the chain, so that code can be emitted."""
        return self.family != "none"


# ------------------------------------------------------------------------------------------------------------------
# Derivation of the equations of a plan: the derivation of its family is run on a builder, such as the recorder.
# ------------------------------------------------------------------------------------------------------------------

ARM_ANGLE = 100
"""Value of ``SolverPlan.locked`` for an arm whose redundancy parameter is the arm angle instead of a joint, and the
index of that angle; indices from n, the number of joints, to below it belong to virtual joints."""


def record(plan: SolverPlan) -> Solver:
    """Record the equations of ``plan`` as a :class:`Solver`, which every builder can replay.

    Raises InternalError or ZeroDivisionError where the equations degenerate on the chain of the plan.
    """
    recorder = Recorder()
    derive(recorder, plan)
    return recorder.solver(plan.chain.n)


def record_exactly(plan: SolverPlan, chain: KinematicChain) -> Solver | None:
    """Record the equations of ``plan`` with the exact numbers and symbols of ``chain``, the same arm as its own chain.

    None where a decision of the derivation needs numbers, or is taken otherwise with symbols than with numbers.
    """
    recorder = Recorder(Pool(_exact))
    try:
        derive(recorder, plan, chain)
        solver = recorder.solver(plan.chain.n)
    except (TypeError, InternalError):
        return None
    return solver if solver.outline == plan.equations.outline else None


def _exact(x: Any) -> Any:
    """Convert to an exact SymPy number: a float to the shortest decimal that reads as that float."""
    import sympy as sp

    return x if isinstance(x, sp.Basic) else sp.Rational(repr(float(x)))


def derive(b: DerivationBuilder, plan: SolverPlan, chain: KinematicChain | None = None) -> None:
    """Derive the equations of ``plan`` on the builder ``b``, with the exact numbers of ``chain`` if it is given."""
    solving = chain or plan.solving
    reach = plan.solving.reach
    if plan.family == "position":
        derive_position(b, solving, reach, plan.last_link)
    elif plan.family == "point":
        derive_point(b, solving, reach, plan.last_link)
    elif plan.family == "elbow7":
        psi = b.redundancy_parameter(Joint(ARM_ANGLE, True))
        if not isinstance(psi, Turn):
            raise InternalError("the arm angle is an angle")
        derive_elbow7(b, straighten(close(b, solving)), psi, reach)
    else:
        _derive_loop(b, plan, solving_loop(b, solving, plan.locked, plan.commute), reach)


def solving_loop(
    b: DerivationBuilder, chain: KinematicChain, locked: int | None, commute: tuple[int, int] | None = None
) -> Loop:
    """Build the loop that is solved: the chain closed by the target, without the prescribed joint ``locked``.

    ``commute``: index of a prismatic joint to exchange with a neighbour of parallel axis, and the direction (+1 or -1).
    """
    loop = close(b, chain)
    if locked is not None:
        loop = lock(b, loop, locked)
    if commute is None:
        return loop
    moved = commute_joints(loop, *commute)
    if moved is None:
        raise InternalError("the prismatic joint does not commute")
    return moved


def _derive_loop(b: DerivationBuilder, plan: SolverPlan, loop: Loop, reach: float) -> None:
    if plan.family == "spherical":
        derive_spherical(b, loop, plan.first, reach)
    elif plan.family == "parallel":
        derive_parallel(b, loop, plan.first, reach)
    elif plan.family == "orientation":
        derive_orientation(b, loop, reach)
    elif plan.family == "planar":
        derive_planar(b, loop, reach)
    elif plan.family == "lift":
        derive_lift(b, loop, plan.first, reach)
    else:
        raise InternalError(f"no equations for the family {plan.family}")


def derive_position(b: DerivationBuilder, chain: KinematicChain, reach: float, last_link: Matrix | None = None) -> None:
    """Derive three joints from the position p of the tip: base J1 L1 J2 L2 J3 tip = p. ``reach`` is in m.

    With a ``last_link``, the tip is the tool that the builder has as an input, carried by that transform.
    """
    base, tip = rigid(chain.base), rigid(chain.tip)
    target: Vector = b.names("p", rotate(transpose(base.R), minus(b.point(), base.t)))
    first, second = (Crossing.of(link) for link in chain.links)
    joints = (chain.joints[0], chain.joints[1], chain.joints[2])
    arm = Arm(joints, first, second, tip.t, target)
    if last_link is not None:
        arm = replace(arm, c=b.names("c", rigid(last_link).apply(b.tool())), nominal=tip.t)
    solve_position(b, arm, reach)
