"""The Newton step as C: loops whose every pass refines one branch, so that compilers can vectorize over branches."""

from __future__ import annotations

from rrrgen.base.templates import render
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.c.ik.kernels import KernelDialect, Settings, specialize
from rrrgen.emit.c.printer import CTarget
from rrrgen.emit.c.trigonometry import LibmSinCos
from rrrgen.emit.names import Names
from rrrgen.emit.printing import Statements
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.recording.newton_step import error_program, newton_program
from rrrgen.program import Program


def newton_text(plan: SolverPlan, dialect: Dialect, chosen: Settings) -> str:
    """The C functions ``ik_newton``, a Newton step of several configurations, and ``ik_missed``, their errors."""
    step = _body(newton_program(plan.chain, plan.locked), plan.locked, dialect)
    missed = _body(error_program(plan.chain), plan.locked, dialect)
    return specialize(render("c/ik/newton.c.j2", step=step, missed=missed), chosen)


def _body(program: Program, locked: int | None, dialect: Dialect) -> list[str]:
    """The statements of ``program`` for the configuration in lane i; a step is added to all joints but ``locked``."""
    target = CTarget(KernelDialect(dialect.prefix, dialect.real), LibmSinCos())
    inputs = ("x[{}][i]", "T[{}]")
    names = Names(target.reserved, ("T", "x", "i", "error", "moved", "inverse", "det"))
    printed = Statements(program, target, names, lambda port, element: inputs[port].format(element))
    printed.write()
    lines = list(printed.lines)
    for port, nodes in zip(program.outputs, program.results, strict=True):
        for element, node in enumerate(nodes):
            text = printed.texts[node].code
            if port.name != "step":
                lines.append(f"{port.name}[i] = {text};")
            elif element != locked:
                lines.append(f"x[{element}][i] += {text};")
    return lines
