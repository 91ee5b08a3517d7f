"""The Newton step as C: a loop whose every pass refines one branch, so that compilers can vectorize over branches."""

from __future__ import annotations

from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.printer import CTarget
from rrrgen.backends.c.solver.kernels import KernelDialect, Settings, specialize
from rrrgen.backends.c.trigonometry import LibmSinCos
from rrrgen.backends.names import Names
from rrrgen.backends.printing import Statements
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.recording.newton import newton_program
from rrrgen.resources import render


def newton_text(plan: SolverPlan, dialect: Dialect, chosen: Settings) -> str:
    """The text of the C function ``ik_newton``, which takes one Newton step for each of several configurations."""
    program = newton_program(plan.chain, plan.locked)
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
            elif element != plan.locked:
                lines.append(f"x[{element}][i] += {text};")
    return specialize(render("c/ik/newton.c.j2", body=lines), chosen)
