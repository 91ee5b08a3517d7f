"""Derivation of the equations of a plan: the derivation of its family is run on a builder, such as the recorder."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rrrgen.base.errors import InternalError
from rrrgen.ik.geometry.chain import Chain, Joint, Matrix
from rrrgen.ik.geometry.loop import Loop, close, commuted, lock, straightened
from rrrgen.ik.geometry.rigid_transforms import Crossing, Vector, minus, rigid, rotate, transposed
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.recording.builder import Builder, Turn
from rrrgen.ik.recording.recorder import Recorder
from rrrgen.ik.recording.scalar import Pool
from rrrgen.ik.recording.solver import Solver
from rrrgen.ik.solutions.elbow7 import derive_elbow7
from rrrgen.ik.solutions.parallel import derive_parallel
from rrrgen.ik.solutions.position import Arm, solve_position
from rrrgen.ik.solutions.reduced import derive_lift, derive_orientation, derive_planar, derive_point
from rrrgen.ik.solutions.spherical import derive_spherical

ARM_ANGLE = 100
"""Value of ``SolverPlan.locked`` for an arm whose redundancy parameter is the arm angle instead of a joint."""


def record(plan: SolverPlan) -> Solver:
    """Record the equations of ``plan`` as a :class:`Solver`, which every builder can replay.

    Raises InternalError or ZeroDivisionError where the equations degenerate on the chain of the plan.
    """
    recorder = Recorder()
    derive(recorder, plan)
    return recorder.solver(plan.chain.n)


def record_exactly(plan: SolverPlan, chain: Chain) -> Solver | None:
    """Record the equations of ``plan`` with the exact numbers and symbols of ``chain``, the same arm as its own chain.

    None where a decision of the derivation needs numbers, or is taken otherwise with symbols than with numbers.
    """
    recorder = Recorder(Pool(_exact))
    try:
        derive(recorder, plan, chain)
        found = recorder.solver(plan.chain.n)
    except (TypeError, InternalError):
        return None
    return found if found.outline == plan.equations.outline else None


def _exact(x: Any) -> Any:
    """Convert to an exact SymPy number: a float to the shortest decimal that reads as that float."""
    import sympy as sp

    return x if isinstance(x, sp.Basic) else sp.Rational(repr(float(x)))


def derive(b: Builder, plan: SolverPlan, chain: Chain | None = None) -> None:
    """Derive the equations of ``plan`` on the builder ``b``, with the exact numbers of ``chain`` if it is given."""
    solving = chain or plan.solving
    reach = plan.solving.reach
    if plan.family == "position":
        derive_position(b, solving, reach, plan.last_link)
    elif plan.family == "point":
        derive_point(b, solving, reach, plan.last_link)
    elif plan.family == "elbow7":
        psi = b.given(Joint(ARM_ANGLE, True))
        if not isinstance(psi, Turn):
            raise InternalError("the arm angle is an angle")
        derive_elbow7(b, straightened(close(b, solving)), psi, reach)
    else:
        _derive_loop(b, plan, solving_loop(b, solving, plan.locked, plan.commute), reach)


def solving_loop(b: Builder, chain: Chain, locked: int | None, commute: tuple[int, int] | None = None) -> Loop:
    """Build the loop that is solved: the chain closed by the target, without the prescribed joint ``locked``.

    ``commute``: index of a prismatic joint to exchange with a neighbour of parallel axis, and the direction (+1 or -1).
    """
    loop = close(b, chain)
    if locked is not None:
        loop = lock(b, loop, locked)
    if commute is None:
        return loop
    moved = commuted(loop, *commute)
    if moved is None:
        raise InternalError("the prismatic joint does not commute")
    return moved


def _derive_loop(b: Builder, plan: SolverPlan, loop: Loop, reach: float) -> None:
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


def derive_position(b: Builder, chain: Chain, reach: float, last_link: Matrix | None = None) -> None:
    """Derive three joints from the position p of the tip: base J1 L1 J2 L2 J3 tip = p. ``reach`` is in m.

    With a ``last_link``, the tip is the tool that the builder has as an input, carried by that transform.
    """
    base, tip = rigid(chain.base), rigid(chain.tip)
    target: Vector = b.names("p", rotate(transposed(base.R), minus(b.point(), base.t)))
    first, second = (Crossing.of(link) for link in chain.links)
    joints = (chain.joints[0], chain.joints[1], chain.joints[2])
    arm = Arm(joints, first, second, tip.t, target)
    if last_link is not None:
        arm = replace(arm, c=b.names("c", rigid(last_link).apply(b.tool())), nominal=tip.t)
    solve_position(b, arm, reach)
