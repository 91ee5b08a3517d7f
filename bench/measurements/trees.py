"""Times of trees, floating bases and closed loops: the emitted functions, and Pinocchio's recursions, in one run.

    python -m bench.measurements.trees [ROBOT ...]

The emitted code has the numbers of the robot file in it; Pinocchio's model is built from the same numbers at start-up.
Both are compiled with the flags of the benchmark, called in turns on the same random states, and compared. Pinocchio
has no inverse dynamics of a closed loop: it is given positions of the passive joints that close it, and torques and
rates are carried over to the drives by its Jacobians.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from jinja2 import Template

from bench.contenders.rivals import pinocchio_includes
from bench.measurements.mechanisms import PALLETISER, robot
from bench.toolchain import Toolchain, find_toolchain, run
from rrrgen.derive import derive_once
from rrrgen.derive.functions.table import functions_for
from rrrgen.emit.c.function_files import function_files
from rrrgen.program import Program, count_operations
from rrrgen.robot.spec import RobotSpec
from rrrgen.verify.references.closed_loops import LoopSolver
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, NumericRobot, centre_and_tensor, chain_of, nominal_parameters
from rrrgen.verify.subject import draw_states

ROBOTS = ("hand", "torso", "quadruped", "linkages/four_bar", "linkages/five_bar", PALLETISER)
FUNCTIONS = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
OF_LOOPS = FUNCTIONS[:1]
CLOSE = 1e-10  # relative; the mass matrix of a light finger is inverted
STATES = 64

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
LOOPS_BY_THEM = {"inverse_dynamics": "loop_inverse_dynamics(at[s], v[s], a[s], expected)"}


@dataclass(frozen=True)
class TreeTime:
    """One function of one robot: its operations, ns of a call, emitted and Pinocchio's."""

    robot: str
    function: str
    operations: int
    nanoseconds: float
    pinocchio: float


def nominal_programs(spec: RobotSpec) -> dict[str, Program]:
    """The functions that are timed, with the numbers of the robot file in them."""
    lead = "floating_" if spec.floating_base else ""
    timed = OF_LOOPS if spec.loops else FUNCTIONS
    names = [f"{lead}{name}" for name in timed]
    known = {function.name for function in functions_for(spec, ("model",))}
    programs = derive_once(spec, groups=("model",)).programs
    return {
        name: programs.get(f"{full}_nominal") or programs[full]
        for name, full in zip(timed, names, strict=True)
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
    numbers = {"parents": [number.get(chain.parents[i], -1) for i in rows]}
    arrays = {
        "joint_places": [chain.behind(behind, i) @ around[i][0] for i in rows],
        "joint_bodies": [body(phi[i], around[i][1]) for i in rows],
        "armature": [np.abs(chain.coupling[rows, : chain.n]) @ np.diag(chain.drive_inertia)],
        "base_body": [body(phi[0], np.eye(4))] if floating else [],
        "acceleration": [chain.gravity],
    }
    if chain.loops:
        of_loop, positions = _loop(chain)
        numbers, arrays = numbers | of_loop, arrays | positions
    template = Path(__file__).resolve().parents[1] / "templates" / "trees.c.j2"
    made = Template(template.read_text(encoding="utf-8"), trim_blocks=True, lstrip_blocks=True).render(
        n=len(rows),
        drives=chain.n if chain.loops else "NV",
        states=STATES,
        floating=floating,
        closed=bool(chain.loops),
        numbers=list(numbers.items()),
        arrays=[(name, [repr(float(v)) for v in np.ravel(values)]) for name, values in arrays.items() if values],
        calls=[(name, call(name, program)) for name, program in programs.items()],
        theirs=LOOPS_BY_THEM if chain.loops else THEIRS,
    )
    return str(made)


def _loop(chain: NumericRobot) -> tuple[dict[str, list[int]], dict[str, list[Array]]]:
    """The rows that the only loop of ``chain`` is about; its pins in joint axes, and positions at which it is closed.

    The second pin is moved along the axis until it is level with the first.
    """
    (loop,) = chain.loops
    tree = NewtonEuler(chain.spanning_tree(), np.zeros((chain.links, 10)))
    x, solved = LoopSolver(chain, tree).solve(draw_states(chain, STATES, np.random.default_rng(1)).q)
    assert solved.all()
    frames = tree.link_frames(x[:1])[0]
    after = [behind for _, behind in chain.around_joints()]
    (first, place), (second, other) = loop.pins
    axes = frames[second] @ np.linalg.inv(after[second])
    between = frames[first] @ [*place, 1] - frames[second] @ [*other, 1]
    level = after[second] @ [*other, 1] + np.array([0, 0, axes[:3, 2] @ between[:3], 0])
    rows = [int(np.argmax(np.abs(chain.coupling[:, k]))) for k in range(chain.n)]
    numbers = {"driven": rows, "passive": list(loop.passive), "carriers": [first, second]}
    return numbers, {"pins": [(after[first] @ [*place, 1])[:3], level[:3]], "positions": [x @ chain.coupling.T]}


def body(phi: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Mass, centre of mass and tensor about it (13,) in joint axes."""
    centre, tensor = centre_and_tensor(phi)
    R = after[:3, :3]
    return np.asarray(np.r_[phi[0], R @ centre + after[:3, 3], (R @ tensor @ R.T).ravel()])


def measured(name: str, toolchain: Toolchain) -> list[TreeTime]:
    """The times of all functions of one robot, compiled by ``toolchain``."""
    spec = robot(name)
    includes = pinocchio_includes()
    if includes is None:
        raise SystemExit("Pinocchio's wheel (pin) or Eigen's headers are missing")
    programs = nominal_programs(spec)
    files = function_files("robot", "functions that are timed", list(programs.values()), "double")
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
        operations = count_operations(programs[function]).total
        found.append(TreeTime(spec.name, function, operations, float(ours), float(theirs)))
    return found


def main(robots: list[str]) -> None:
    """Print the table."""
    click.echo(f"{'':12}{'':20}{'operations':>11}{'rrrgen, ns':>12}{'Pinocchio, ns':>15}{'ratio':>8}")
    for name in robots or ROBOTS:
        for each in measured(name, find_toolchain()):
            times = f"{each.nanoseconds:12.0f}{each.pinocchio:15.0f}{each.pinocchio / each.nanoseconds:8.1f}"
            click.echo(f"{each.robot:12}{each.function:20}{each.operations:11}{times}")


if __name__ == "__main__":
    main(sys.argv[1:])
