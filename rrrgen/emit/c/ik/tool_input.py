"""The emitted inverse kinematics with the tool as an input: ``<name>_tool_ik.h`` and ``.c``.

Only arms of one to three joints, which are solved for positions, have it. Poses need no solver of
their own: there another tool changes the target alone.
"""

from __future__ import annotations

from dataclasses import replace
from math import tau
from typing import TYPE_CHECKING

from rrrgen.base.errors import DerivationError
from rrrgen.base.templates import render
from rrrgen.emit import Real
from rrrgen.emit.c.ik.files import Emitted, emit
from rrrgen.emit.interface import SelfTestCheck
from rrrgen.ik.run_time_tool import plan_with_tool

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec


def emit_tool_solver(spec: RobotSpec, real: Real = "double") -> Emitted:
    """The files of the inverse kinematics of positions with the tool as an input; DerivationError if there is none."""
    return emit(replace(spec, name=f"{spec.name}_tool"), plan_with_tool(spec), real)


def tool_solver_files(spec: RobotSpec, real: Real) -> dict[str, str]:
    """The same files by name; none for an arm without such a solver."""
    try:
        return emit_tool_solver(spec, real).files
    except DerivationError:
        return {}


def tool_solver_check(spec: RobotSpec) -> SelfTestCheck | None:
    """The part of the self-test for this solver: every solution is checked by ``tool_kinematics``; None without it."""
    try:
        plan = plan_with_tool(spec)
    except DerivationError:
        return None
    turning = [tau * joint.revolute for joint in plan.chain.joints]
    periods = turning if plan.coupling is None else plan.coupling.periods
    text = render(
        "c/ik/tool_selftest.c.j2",
        p=spec.name,
        M=f"{spec.name.upper()}_TOOL_IK",
        reach=plan.chain.reach,
        periods=", ".join(f"R({period!r})" for period in periods),
    )
    return SelfTestCheck("tool_inverse_kinematics", f"{spec.name}_tool_ik.h", text)
