"""Times of second derivatives: the emitted C, C of CasADi's derivatives, and Pinocchio's recursion, in one run.

    python -m bench.measurements.second_derivatives [ROBOT ...]

All have the numbers of the robot file. CasADi differentiates a Newton-Euler recursion written by hand and shares common
subexpressions; its results are laid out as the emitted ones. Pinocchio has all second derivatives at once, without a
weighted sum: they are compared with the function of the group ``tensors``. Results have to agree before anything is
timed.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from bench.contenders.cases import STATES, Case, make_case
from bench.contenders.contender import HAND_FILE, OURS_FILE, PINOCCHIO, Contender, DisagreementError
from bench.contenders.hand_casadi import HandArm
from bench.contenders.joint_frames import joint_frames, regrouped
from bench.contenders.rivals import pinocchio_includes
from bench.measurements.race import Driver, Effort
from bench.measurements.trees import body
from bench.templates import source
from bench.toolchain import Toolchain, find_toolchain
from rrrgen.derive import derive_once
from rrrgen.derive.functions.second_derivatives import upper_triangle_indices
from rrrgen.emit.c.function_files import function_files
from rrrgen.program import Program, count_operations
from rrrgen.robot.file import load_spec
from rrrgen.verify.references.numeric_robot import Array

ROBOTS = ("rrr", "puma560", "ur10e", "panda")
FUNCTIONS = ("inverse_dynamics_hessian", "inverse_dynamics_hessian_product", "inverse_dynamics_second_derivatives")
PLACES = {"q": 0, "dq": 1, "ddq": 2, "weights": 3, "direction": 4}
"""Offset of each input in a state of seven parts, in multiples of n; the direction has three."""
MOST_JOINTS = 8  # of an arm with the function of all second derivatives
CLOSE = 1e-11  # relative; two recursions


@dataclass(frozen=True)
class SecondTime:
    """One function of one robot: its operations, ns of a call, emitted and of the rivals that have it."""

    robot: str
    function: str
    operations: int
    nanoseconds: float
    casadi: float | None
    pinocchio: float | None


def emitted(programs: Sequence[Program], n: int) -> list[Contender]:
    """The emitted functions as contenders."""
    found = []
    for program in programs:
        arguments = [f"in + {PLACES[port.name] * n}" for port in program.inputs]
        filled = 0
        for port in program.data_outputs:
            arguments.append(f"out + {filled}")
            filled += port.size
        name = program.name.removesuffix("_nominal")
        found.append(Contender(OURS_FILE, name, filled, f"robot_{program.name}({', '.join(arguments)});", "file"))
    return found


def by_casadi(case: Case) -> tuple[list[Contender], str, str]:
    """CasADi's Hessian and product as contenders, their C and its declarations."""
    import casadi as ca

    n, frames = case.n, joint_frames(case.chain, case.phi("file"))
    q, dq, ddq, weights = (ca.SX.sym(letter, n) for letter in ("q", "v", "a", "w"))
    direction, x = ca.SX.sym("d", 3 * n), ca.vertcat(q, dq, ddq)
    tau = ca.vertcat(*HandArm(frames, regrouped(frames)).inverse_dynamics(q, dq, ddq))
    H, gradient = ca.hessian(ca.dot(weights, tau), x)
    upper = upper_triangle_indices(n)
    laid_out = [
        gradient,
        *(H[i, j] for i, j in upper),
        ca.vec(H[n : 2 * n, :n].T),
        ca.vec(H[2 * n :, :n].T),
        *(H[n + i, n + j] for i, j in upper),
    ]
    inputs = [q, dq, ddq, weights]
    functions = {
        FUNCTIONS[0]: ca.Function("hand_hessian", inputs, [ca.cse(ca.densify(ca.vertcat(*laid_out)))]),
        FUNCTIONS[1]: ca.Function(
            "hand_product", [*inputs, direction], [ca.cse(ca.densify(ca.jtimes(gradient, x, direction)))]
        ),
    }
    generator, found, declarations = ca.CodeGenerator("hand.c"), list[Contender](), ""
    for name, function in functions.items():
        generator.add(function)
        symbol = function.name()
        declarations += f"int {symbol}(const double **, double **, long long int *, double *, int);\n"
        places = ", ".join(f"in + {k * n}" for k in range(function.n_in()))
        statements = f"const double *arg[] = {{{places}}}; double *res[] = {{out}}; {symbol}(arg, res, 0, 0, 0);"
        found.append(Contender(HAND_FILE, name, int(function.numel_out(0)), statements, "file"))
    return found, str(generator.dump()), declarations


def by_pinocchio(case: Case) -> tuple[Contender, str, str]:
    """Pinocchio's second derivatives as a contender, the declarations it needs, and the call that sets its model up."""
    n, chain, phi = case.n, case.chain, case.phi("file")
    around = chain.around_joints()
    behind = [after for _, after in around]
    values = {
        "joint_places": [chain.behind(behind, i) @ around[i][0] for i in range(n)],
        "joint_bodies": [body(phi[i], around[i][1]) for i in range(n)],
        "armature": [np.zeros(n)],
        "acceleration": [chain.gravity],
    }
    declarations = f"static const int parents[] = {{{', '.join(map(str, range(-1, n - 1)))}}};\n"
    for name, parts in values.items():
        numbers = ", ".join(repr(float(v)) for v in np.ravel(np.array(parts)))
        declarations += f"static const double {name}[] = {{{numbers}}};\n"
    declarations += (
        "void tree_setup(int, const int *, const double *, const double *, const double *, const double *, "
        "const double *);\n"
        "void tree_second_derivatives(const double *, const double *, const double *, double *);\n"
    )
    call = f"tree_second_derivatives(in, in + {n}, in + {2 * n}, out);"
    contender = Contender(PINOCCHIO, FUNCTIONS[2], 4 * n**3, call, "file")
    return contender, declarations, f"tree_setup({n}, parents, joint_places, joint_bodies, armature, 0, acceleration);"


def measured(case: Case, toolchain: Toolchain, effort: Effort) -> list[SecondTime]:
    """The times of all functions of one robot. Raises DisagreementError where results differ; nothing is timed then."""
    programs = derive_once(case.spec, groups=("model", "hessian", "tensors")).programs
    ours = [programs[f"{function}_nominal"] for function in FUNCTIONS]
    files = function_files("robot", "functions that are timed", ours, "double")
    contenders, hand, declarations = by_casadi(case)
    sources = {**files, "hand.c": hand}
    includes, setup, cpp = pinocchio_includes(), "", list[tuple[str, str, tuple[str, ...]]]()
    if includes is not None and toolchain.cxx is not None:
        theirs, more, setup = by_pinocchio(case)
        contenders, declarations = [*contenders, theirs], declarations + more
        cpp.append(("pinocchio_tree.cpp", source("pinocchio_tree.cpp"), includes))
    contenders = sorted([*emitted(ours, case.n), *contenders], key=lambda each: FUNCTIONS.index(each.function))
    states = np.hstack([case.states, np.random.default_rng(1).uniform(-1.0, 1.0, (STATES, 3 * case.n))])
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        driver = Driver.build(
            Path(place), contenders, sources, '#include "robot.h"\n' + declarations, states, toolchain, setup, cpp
        )
        _check(case.name, contenders, driver.values())
        times = driver.times(effort)
    by_name = {(each.function, each.label): times[k] for k, each in enumerate(contenders)}
    return [
        SecondTime(
            case.name,
            function,
            count_operations(program).total,
            by_name[function, OURS_FILE],
            by_name.get((function, HAND_FILE)),
            by_name.get((function, PINOCCHIO)),
        )
        for function, program in zip(FUNCTIONS, ours, strict=True)
    ]


def _check(robot: str, contenders: Sequence[Contender], values: Sequence[Array]) -> None:
    ours = {each.function: found for each, found in zip(contenders, values, strict=True) if each.label == OURS_FILE}
    for each, found in zip(contenders, values, strict=True):
        expected = ours[each.function]
        difference = float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))
        if not difference < CLOSE:
            raise DisagreementError(f"{robot}: {each.function} of {each.label} differs by {difference:.1e}")


def main(robots: list[str], tell: Callable[[str], Any] = click.echo) -> None:
    """Print the table."""
    tell(f"{'':12}{'':38}{'operations':>11}{'rrrgen, ns':>12}{'CasADi, ns':>12}{'Pinocchio, ns':>15}")
    for name in robots or ROBOTS:
        for each in measured(make_case(load_spec(name)), find_toolchain(), Effort()):
            theirs = "".join(
                f"{'' if time is None else f'{time:.0f}':>{width}}"
                for time, width in ((each.casadi, 12), (each.pinocchio, 15))
            )
            tell(f"{each.robot:12}{each.function:38}{each.operations:11}{each.nanoseconds:12.0f}{theirs}")


if __name__ == "__main__":
    main(sys.argv[1:])
