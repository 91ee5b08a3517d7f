"""Inverse kinematics of positions with the tool as an input: the same equations, with the point they move unknown."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rrrgen.base.errors import DerivationError
from rrrgen.ik.classify import TRIALS, plan
from rrrgen.ik.families import equipped, works
from rrrgen.ik.geometry.chain import Matrix
from rrrgen.ik.geometry.mechanism import solved_chain
from rrrgen.ik.plan import SolverPlan
from rrrgen.robot.spec import FixedTransform

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec


def plan_with_tool(spec: RobotSpec) -> SolverPlan:
    """Plan the inverse kinematics of a position task in which the position of the tool is an input.

    A target is six numbers, the position of the tool in the base frame and its position in the frame of the last link.
    The family is that of the arm with the tool of its robot file, since it depends on the axes and not on the point
    that they move. Raises DerivationError with the reason for an arm that has no such solver.
    """
    found = plan(spec)
    if not found.solvable:
        raise DerivationError(f"{spec.name}: no inverse kinematics is emitted: {found.reason}")
    if found.task != "position":
        raise DerivationError(
            f"{spec.name}: its inverse kinematics solves for poses, and a tool only changes its target: see tool_target"
        )
    tooled = _tooled(found, solved_chain(replace(spec, tool=FixedTransform()))[0].tip)
    if tooled is None or not works(tooled, TRIALS):
        raise DerivationError(f"{spec.name}: {found.title}: its equations do not hold for other tools")
    return tooled


def _tooled(part: SolverPlan, last_link: Matrix) -> SolverPlan | None:
    """The plan ``part``, and its companion, with the tool as an input; None where the equations degenerate."""
    companion = part.companion and _tooled(part.companion, last_link)
    if part.companion is not None and companion is None:
        return None
    return equipped(replace(part, companion=companion, last_link=last_link))
