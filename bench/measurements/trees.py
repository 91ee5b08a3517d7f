"""Times of trees and floating bases: the emitted functions, and Pinocchio's recursions in C++, in one run.

    python -m bench.measurements.trees [ROBOT ...]

The emitted code has the numbers of the robot file in it; Pinocchio's model is built from the same numbers at start-up.
Both are compiled with the flags of the benchmark, called in turns on the same random states, and compared.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from jinja2 import Template

from bench.contenders.rivals import pinocchio_includes
from bench.toolchain import find_toolchain, run
from rrrgen.derive import derive_once
from rrrgen.derive.functions.table import functions_for
from rrrgen.emit.c.function_files import function_files
from rrrgen.program import Program, count_operations
from rrrgen.robot.file import load_spec
from rrrgen.robot.spec import RobotSpec
from rrrgen.verify.references.numeric_robot import centre_and_tensor, chain_of, nominal_parameters

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "trees"
ROBOTS = ("hand", "torso", "quadruped")
FUNCTIONS = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
CLOSE = 1e-10  # relative; the mass matrix of a light finger is inverted

PORTS = {
    "q": "q", "dq": "v[s] + BASE", "ddq": "a[s] + BASE", "orientation": "orientation", "twist": "v[s]",
    "twist_rate": "a[s]", "M": "out",
}  # fmt: skip
"""The C expression of every argument at the state s; outputs go to ``out`` one behind the other."""
OF_INVERSE = {"tau": "out + BASE", "wrench": "out"}
OF_FORWARD = {"tau": "a[s] + BASE", "wrench": "a[s]", "twist_rate": "out", "ddq": "out + BASE"}
THEIRS = {
    "inverse_dynamics": "tree_inverse_dynamics(at[s], v[s], a[s], expected)",
    "mass_matrix": "tree_mass_matrix(at[s], expected)",
    "forward_dynamics": "tree_forward_dynamics(at[s], v[s], a[s], expected)",
}


def nominal_programs(spec: RobotSpec) -> dict[str, Program]:
    """The functions that are timed, with the numbers of the robot file in them."""
    lead = "floating_" if spec.floating_base else ""
    names = [f"{lead}{name}" for name in FUNCTIONS]
    known = {function.name for function in functions_for(spec, ("model",))}
    programs = derive_once(spec, groups=("model",)).programs
    return {
        name: programs.get(f"{full}_nominal") or programs[full]
        for name, full in zip(FUNCTIONS, names, strict=True)
        if full in known
    }


def call(name: str, program: Program) -> str:
    """The C call of ``program`` at the state s."""
    known = PORTS | (OF_FORWARD if name == "forward_dynamics" else OF_INVERSE)
    inputs = [known[port.name] for port in program.inputs]
    outputs = [known[port.name] for port in program.data_outputs]
    return f"robot_{program.name}({', '.join((*inputs, *outputs))})"


def driver(spec: RobotSpec, programs: dict[str, Program]) -> str:
    """The C program that sets Pinocchio's model up and times the emitted functions and its own in turns."""
    chain, phi = chain_of(spec), nominal_parameters(spec)
    assert phi is not None
    around, floating = chain.around_joints(), spec.floating_base
    behind = [after for _, after in around]
    rows = list(range(int(floating), chain.links))
    number = {row: k for k, row in enumerate(rows)}
    arrays = {
        "joint_places": [chain.behind(behind, i) @ around[i][0] for i in rows],
        "joint_bodies": [body(phi[i], around[i][1]) for i in rows],
        "base_body": [body(phi[0], np.eye(4))] if floating else [],
        "acceleration": [chain.gravity],
    }
    template = Path(__file__).resolve().parents[1] / "templates" / "trees.c.j2"
    made = Template(template.read_text(encoding="utf-8"), trim_blocks=True, lstrip_blocks=True).render(
        n=len(rows),
        floating=floating,
        parents=[number.get(chain.parents[i], -1) for i in rows],
        arrays=[(name, [repr(float(v)) for v in np.ravel(values)]) for name, values in arrays.items() if values],
        calls=[(name, call(name, program)) for name, program in programs.items()],
        theirs=THEIRS,
    )
    return str(made)


def body(phi: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Mass, centre of mass and tensor about it (13,) in joint axes."""
    centre, tensor = centre_and_tensor(phi)
    R = after[:3, :3]
    return np.asarray(np.r_[phi[0], R @ centre + after[:3, 3], (R @ tensor @ R.T).ravel()])


def measured(name: str) -> list[tuple[str, int, float, float]]:
    """Function, operations, and ns of a call, emitted and Pinocchio's."""
    path = EXAMPLES / f"{name}.yaml"
    spec = load_spec(path if path.exists() else name)
    includes = pinocchio_includes()
    if includes is None:
        raise SystemExit("Pinocchio's wheel (pin) or Eigen's headers are missing")
    programs = nominal_programs(spec)
    files = function_files("robot", "functions that are timed", list(programs.values()), "double")
    toolchain = find_toolchain()
    adapter = (Path(__file__).resolve().parents[1] / "templates" / "pinocchio_tree.cpp").read_text(encoding="utf-8")
    header = {"robot.h": files["robot.h"]}
    with TemporaryDirectory() as folder:
        objects = [
            toolchain.object("robot.c", files["robot.c"], header),
            toolchain.object("trees.c", driver(spec, programs), header),
            toolchain.object("pinocchio_tree.cpp", adapter, {}, includes),
        ]
        program = Path(folder) / "trees"
        toolchain.link(objects, program, cxx=True)
        lines = run([str(program)]).split("\n")
    found = []
    for line in filter(None, lines):
        function, ours, theirs, difference = line.split()
        if not float(difference) < CLOSE:
            raise SystemExit(f"{name}: {function} differs from Pinocchio's by {difference}")
        found.append((function, count_operations(programs[function]).total, float(ours), float(theirs)))
    return found


def main(robots: list[str]) -> None:
    """Print the table."""
    click.echo(f"{'':12}{'':20}{'operations':>11}{'rrrgen, ns':>12}{'Pinocchio, ns':>15}{'ratio':>8}")
    for name in robots or ROBOTS:
        for function, count, ours, theirs in measured(name):
            click.echo(f"{name:12}{function:20}{count:11}{ours:12.0f}{theirs:15.0f}{theirs / ours:8.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
