"""Operations of Hessians of ``weights' tau``, and of their products: emitted, and those that CasADi derives.

    python -m bench.measurements.hessians [ROBOT ...]

CasADi derives them from the inverse dynamics of rrrgen and from a Newton-Euler recursion written by hand, both with the
numbers of the robot file folded in, and shares common subexpressions. All are checked against each other first.
"""

from __future__ import annotations

import sys
from typing import Any

import click
import numpy as np

from bench.contenders.casadi_code import operations
from bench.contenders.cases import make_case
from bench.contenders.hand_casadi import HandArm
from bench.contenders.joint_frames import joint_frames, regrouped
from rrrgen.derive import derive_once
from rrrgen.emit.casadi.function import function
from rrrgen.program import Program, count_operations
from rrrgen.robot.file import load_spec

ROBOTS = ("rrr", "ur10e", "panda")
CLOSE = 1e-11  # relative; two recursions


def derived_by_casadi(tau: Any, states: list[Any], weights: Any, direction: Any) -> list[Any]:
    """CasADi's functions of gradient and upper triangle of the Hessian, and of its product with a direction."""
    import casadi as ca

    x = ca.vertcat(*states)
    H, gradient = ca.hessian(ca.dot(weights, tau), x)
    product = ca.jtimes(gradient, x, direction)
    inputs = [*states, weights]
    return [
        ca.Function("whole", inputs, [ca.cse(ca.vertcat(gradient, ca.sparsify(ca.triu(H)).nz[:]))]),
        ca.Function("product", [*inputs, direction], [ca.cse(product)]),
    ]


def measured(name: str) -> list[tuple[str, list[int]]]:
    """Operations of Hessian and product of one robot, by who derived them."""
    import casadi as ca

    spec = load_spec(name)
    case, n = make_case(spec), spec.n
    programs = derive_once(spec, groups=("model", "hessian")).programs
    emitted = [programs[f"inverse_dynamics_hessian{end}_nominal"] for end in ("", "_product")]
    states = [ca.SX.sym(letter, n) for letter in ("q", "dq", "ddq")]
    weights, direction = ca.SX.sym("w", n), ca.SX.sym("v", 3 * n)
    frames = joint_frames(case.chain, case.phi("file"))
    torques = {
        "CasADi, from rrrgen's inverse dynamics": function(programs["inverse_dynamics_nominal"]).call(states)[0],
        "CasADi, from a hand-written Newton-Euler": ca.vertcat(
            *HandArm(frames, regrouped(frames)).inverse_dynamics(*states)
        ),
    }
    rng = np.random.default_rng(0)
    at = [*rng.uniform(-1, 1, (3, n)), rng.uniform(-1, 1, n), rng.uniform(-1, 1, 3 * n)]
    expected = function(emitted[1]).call(at)[0].full()
    found = [("rrrgen", [_total(program) for program in emitted])]
    for title, tau in torques.items():
        made = derived_by_casadi(tau, states, weights, direction)
        difference = np.max(np.abs(made[1].call(at)[0].full() - expected)) / np.max(np.abs(expected))
        if not difference < CLOSE:
            raise SystemExit(f"{name}: the product of {title} differs by {difference:.1e}")
        found.append((title, [sum(operations(each).values()) - operations(each)["sincos"] for each in made]))
    return found


def _total(program: Program) -> int:
    return count_operations(program).total


def main(robots: list[str]) -> None:
    """Print the table."""
    click.echo(f"{'':12}{'':44}{'Hessian':>9}{'product':>9}")
    for name in robots or ROBOTS:
        for title, (whole, product) in measured(name):
            click.echo(f"{name:12}{title:44}{whole:9}{product:9}")


if __name__ == "__main__":
    main(sys.argv[1:])
