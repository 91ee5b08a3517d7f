"""Operations, base parameters, times, errors of trees, floating bases, closed loops and Hessians, beside their limits.

    python -m bench.measurements.mechanisms [trees] [floating] [loops] [hessians]

The limits are the counts of a prototype of the same recursions with a few percent added. Operations are
multiplications, additions, divisions and roots with base parameters at run time.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import click
import numpy as np

from bench.toolchain import find_toolchain, run
from rrrgen.base.parallel import without_collection
from rrrgen.derive import derive, prepare, record
from rrrgen.derive.derived_model import Derivation
from rrrgen.derive.functions.floating_second_derivatives import weighted_gradient
from rrrgen.derive.functions.table import combine, get_function, with_sources
from rrrgen.derive.optimizer import Optimizer
from rrrgen.emit.c.function_files import function_files
from rrrgen.program import Program, count_operations
from rrrgen.program.evaluation import evaluate
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.robot.spec import RobotSpec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters
from rrrgen.verify.subject import draw_states

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

TREES = {"torso": (1154, 754, 1931, 5002), "hand": (661, 343, 973, 2415)}
"""Operations of inverse dynamics, mass matrix, regressor and first derivatives; 2 % more are allowed."""
OF_TREES = ("inverse_dynamics", "mass_matrix", "regressor", "inverse_dynamics_derivatives")

FLOATING = {
    "quadruped": (94, 1330, 630, 1790),
    "hand": (66, 925, 565, 1820),
    "torso": (101, 1475, 1165, 3560),
}
"""Base parameters on a floating base, and the most operations of inverse dynamics, mass matrix and regressor."""
OF_FLOATING = ("floating_inverse_dynamics", "floating_mass_matrix", "floating_regressor")

PALLETISER = "palletiser/unequal"
"""Of this arm, the wrist and what is beyond are left out."""

LOOPS = {
    PALLETISER: (26, 320),
    "linkages/five_bar": (11, 169),
    "linkages/four_bar": (8, 132),
    "linkages/slider_crank": (6, 83),
}
"""Base parameters, and operations of inverse dynamics, of which 5 % more are allowed.

The mass of the slider is no parameter of its own: it acts as one at the end of the rod.
"""

HESSIANS = {
    "rrr": (189, 284, 358, 36),
    "puma560": (1745, 3384, 2239, 541),
    "panda": (2553, 6161, 2973, 1058),
    "hand": (2415, 4995, 3944, 697),
    "torso": (5002, 11397, 6399, 1902),
}
"""Operations of first derivatives, weighted Hessian, its product, and dM/dq; 3 % more are allowed."""
OF_HESSIANS = (
    "inverse_dynamics_derivatives",
    "inverse_dynamics_hessian",
    "inverse_dynamics_hessian_product",
    "mass_matrix_derivatives",
)
TENSORS = {"rrr": 169, "puma560": 4974, "panda": 10674, "hand": 6887}
BY_CASADI = {
    "rrr": (2091, 1457),
    "puma560": (8753, 3481),
    "panda": (13318, 4255),
    "hand": (16325, 6757),
    "torso": (34116, 11230),
}
"""Operations of Hessian and product that CasADi derives from a Newton-Euler recursion, without `cse`, nominal."""


FLOATING_HESSIAN = {"quadruped": (2749, 8795)}
"""Operations of the gradient and of the whole weighted Hessian on a floating base, nominal; 3 % more are allowed."""
OF_FLOATING_HESSIANS = ("floating_inverse_dynamics_hessian", "floating_inverse_dynamics_hessian_product")


class Row(NamedTuple):
    """One figure beside its limit; ``exactly`` where it has to equal the limit."""

    robot: str
    what: str
    found: float
    limit: float
    exactly: bool = False

    @property
    def met(self) -> bool:
        """Whether the limit is kept."""
        return self.found == self.limit if self.exactly else self.found <= self.limit


def robot(name: str, floating: bool = False) -> RobotSpec:
    """A bundled robot or an example; ``floating``: on the trunk of the quadruped."""
    found = [path for path in (EXAMPLES / f"{name}.yaml", EXAMPLES / "trees" / f"{name}.yaml") if path.exists()]
    if not found:
        return load_spec(name)
    text = found[0].read_text(encoding="utf-8")
    if floating and "floating_base:" not in text:
        quadruped = (EXAMPLES / "trees" / "quadruped.yaml").read_text(encoding="utf-8")
        trunk = quadruped[quadruped.index("floating_base:") : quadruped.index("joints:\n")]
        text = text.replace("joints:\n", f"{trunk}joints:\n")
    if name == PALLETISER:
        rows, loops = text.index("  - name: wrist"), text.index("loops:\n")
        text = text[:rows] + text[loops : text.index("  - mass: 35\n")].replace("tip: turn", "tip: forearm")
    return loads_spec(text, f"{name}.yaml")


class Functions:
    """The optimized functions of one robot, derived when they are asked for."""

    def __init__(self, spec: RobotSpec) -> None:
        self.derivation: Derivation = prepare(spec)
        self.programs = cache(self._programs)

    def _programs(self, name: str) -> dict[str, Program]:
        with without_collection():
            return dict(Optimizer()(record(self.derivation, with_sources([get_function(name)]))).programs)

    def count(self, name: str) -> int:
        """The operations of one function."""
        return count_operations(self.programs(name)[name]).total

    def seconds(self, name: str) -> float:
        """CPU time of the derivation of one function from those that it is made of, without its specialization."""
        sources = [self.programs(each)[each] for each in get_function(name).of]
        with without_collection():  # as whoever derives a robot does
            begin = time.process_time()
            combine(name, self.derivation.recording(), sources)
            return time.process_time() - begin


def of_trees() -> Iterator[Row]:
    """Counts of section "trees"."""
    for name, limits in TREES.items():
        functions = Functions(robot(name))
        for function, limit in zip(OF_TREES, limits, strict=True):
            yield Row(name, function, functions.count(function), 1.02 * limit)


def of_floating() -> Iterator[Row]:
    """Base parameters and counts on a floating base, and the time of the quadruped's group "model"."""
    for name, (parameters, *limits) in FLOATING.items():
        functions = Functions(robot(name, floating=True))
        yield Row(name, "base parameters", len(functions.derivation.compiler_basis.names), parameters, exactly=True)
        for function, limit in zip(OF_FLOATING, limits, strict=True):
            yield Row(name, function, functions.count(function), limit)
    begin = time.process_time()
    derive(robot("quadruped"), groups=("model",))
    yield Row("quadruped", "group model, s CPU", time.process_time() - begin, 15)


def of_loops(paths: Iterable[str] = LOOPS) -> Iterator[Row]:
    """Base parameters, counts, and the difference from Newton's method on the closure, away from dead points."""
    for path in paths:
        (parameters, limit), spec, name = LOOPS[path], robot(path), Path(path).name
        functions = Functions(spec)
        yield Row(name, "base parameters", len(functions.derivation.compiler_basis.names), parameters, exactly=True)
        yield Row(name, "inverse_dynamics", functions.count("inverse_dynamics"), 1.05 * limit)
        yield Row(name, "relative error of inverse dynamics", _error(spec, functions), 1e-12)


def _error(spec: RobotSpec, functions: Functions) -> float:
    chain, phi = chain_of(spec), nominal_parameters(spec)
    assert phi is not None
    s = draw_states(chain, 100, np.random.default_rng(1))
    expected = NewtonEuler(chain, phi).inverse_dynamics(s.q, s.dq, s.ddq)
    program = functions.programs("inverse_dynamics")["inverse_dynamics_nominal"]
    found = np.array([evaluate(program, *state)[0] for state in zip(s.q, s.dq, s.ddq, strict=True)])
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


def of_hessians(names: Iterable[str] = HESSIANS, floating: Iterable[str] = FLOATING_HESSIAN) -> Iterator[Row]:
    """Counts of second derivatives, and the times of derivation and of `gcc -O2`; ``floating``: on such a base."""
    for name in names:
        limits = HESSIANS[name]
        functions = Functions(robot(name))
        for function, limit in zip(OF_HESSIANS, limits, strict=True):
            yield Row(name, function, functions.count(function), 1.03 * limit)
        if name in TENSORS:
            function = "inverse_dynamics_second_derivatives"
            yield Row(name, function, functions.count(function), 1.03 * TENSORS[name])
        for function, theirs, share in zip(OF_HESSIANS[1:3], BY_CASADI[name], (0.4, 0.6), strict=True):
            count = count_operations(functions.programs(function)[f"{function}_nominal"]).total
            yield Row(name, f"{function}_nominal / CasADi", count / theirs, share)
        for function in OF_HESSIANS[1:3]:
            yield Row(name, f"{function}, s CPU to derive", functions.seconds(function), 3)
        for function in ("inverse_dynamics_hessian", "forward_dynamics_hessian"):
            seconds = _compiled(functions.programs(function)[function])
            yield Row(name, f"{function}, s CPU of gcc -O2", seconds, 20)

    for name in floating:
        yield from _of_floating_hessian(name, *FLOATING_HESSIAN[name])


def _of_floating_hessian(name: str, gradient_limit: float, limit: float) -> Iterator[Row]:
    """Counts with the numbers of the file, and times of derivation and of `gcc -O2`, on a floating base."""
    functions, (hessian, product) = Functions(robot(name, floating=True)), OF_FLOATING_HESSIANS
    programs, recording = functions.programs(hessian), functions.derivation.recording()
    recording.function = get_function(hessian)
    (source,) = get_function(hessian).of
    gradient = weighted_gradient(recording, functions.programs(source)[f"{source}_nominal"])
    yield Row(name, f"{hessian}: gradient", count_operations(gradient).total, 1.03 * gradient_limit)
    yield Row(name, f"{hessian}_nominal", count_operations(programs[f"{hessian}_nominal"]).total, 1.03 * limit)
    for function in (hessian, product):
        yield Row(name, f"{function}, s CPU to derive", functions.seconds(function), 3)
    for function in (hessian, product):
        seconds = _compiled(functions.programs(function)[f"{function}_nominal"])
        yield Row(name, f"{function}, s CPU of gcc -O2", seconds, 20)


def _compiled(program: Program) -> float:
    """CPU time of the compiler for the file that holds ``program`` alone, as long functions have files of their own."""
    files = function_files("robot", program.summary, [program], "double")
    with TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8", newline="\n")
        begin = _spent_by_children()
        run([*find_toolchain().cc, "-std=c99", "-O2", "-c", f"{folder}/robot.c", "-o", f"{folder}/robot.o"])
        return _spent_by_children() - begin


def _spent_by_children() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


PARTS: dict[str, Callable[[], Iterator[Row]]] = {
    "trees": of_trees,
    "floating": of_floating,
    "loops": of_loops,
    "hessians": of_hessians,
}


def main(parts: list[str]) -> None:
    """Print the table."""
    for part in parts or PARTS:
        for row in PARTS[part]():
            limit = f"{'= ' if row.exactly else '<='} {row.limit:<8.4g}"
            found = f"{row.found:.0f}" if row.found >= 10 or row.exactly else f"{row.found:.2g}"
            click.echo(f"{row.robot:14}{row.what:62}{found:>9}  {limit}  {'met' if row.met else 'MISSED'}")


if __name__ == "__main__":
    main(sys.argv[1:])
