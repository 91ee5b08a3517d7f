"""Solver plan: the family of closed forms that solves a chain, its task, number of solutions and singularities."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from rrrgen.base.errors import InternalError

if TYPE_CHECKING:
    import sympy as sp

    from rrrgen.ik.geometry.chain import Chain, Matrix
    from rrrgen.ik.geometry.coupling import Coupling
    from rrrgen.ik.recording.solver import Solver

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
    chain: Chain
    solving: Chain
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
