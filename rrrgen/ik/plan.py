"""The plan of a solver: the family that solves a chain, what is prescribed, how many solutions, singularities."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from rrrgen.errors import InternalError

if TYPE_CHECKING:
    import sympy as sp

    from rrrgen.ik.geometry.chain import Chain
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
    """A set of configurations where branches meet or a joint becomes free; ``expression`` vanishes there."""

    words: str
    expression: sp.Expr | None = None


@dataclass(frozen=True)
class SolverPlan:
    """The inverse kinematics of one robot.

    ``task`` is what is prescribed: the position of the tip (1 to 3 joints) or its pose. ``solving`` is the chain that
    is solved: the user's ``chain`` with nearly special geometry made special (rows are then refined on the true chain)
    and virtual joints added. ``first`` is the place (from 0) of the special triple in its loop, ``commute`` the place
    and direction in which a prismatic joint was moved past a parallel axis before, ``locked`` the prescribed joint.
    ``companion`` solves a special arm that is nearly this one: its rows, refined on the true chain, are added because
    the general equations lose digits there. ``snapped`` says that ``solving`` is a special arm near ``chain``, and
    ``incomplete`` why configurations may be missing where that is all there is (empty: none are). ``solver`` is the
    recorded closed form.
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

    @property
    def equations(self) -> Solver:
        """The recorded closed form; InternalError where an elimination solves the chain, or nothing does."""
        if self.solver is None:
            raise InternalError(f"no closed form was recorded for {self.title}")
        return self.solver

    @property
    def general(self) -> bool:
        """Whether an elimination solves the chain, in numbers: there is no closed form per branch."""
        return self.family in ("general6r", "general5r1p")

    @property
    def solvable(self) -> bool:
        """Whether code can be emitted."""
        return self.family != "none"
