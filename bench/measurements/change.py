"""What a change does to every emitted function: instructions per call before and after it.

    python -m rrrgen generate ROBOT -o BEFORE/ROBOT       in the checkout before the change, for every ROBOT
    python -m rrrgen generate ROBOT -o AFTER/ROBOT        in the checkout after it
    python -m bench.measurements.change BEFORE AFTER [--times]

prints, for every function with the same arguments in both, the instructions per call with the compiler and the flags of
the benchmark, counted by single-stepping as there, their ratio, and whether the values agree to rounding. The inverse
kinematics is called for reachable poses. With ``--times`` both versions are also timed in turns in one process, several
times over, and the table ends with the time before, the median of the ratios after/before and their quartiles.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from bench.contenders.contender import Contender
from bench.measurements.race import Driver, Effort
from bench.toolchain import Toolchain, find_toolchain
from rrrgen.robot.file import load_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, chain_of

STATES = 16

COUNTED = 2
"""States whose instructions are counted, as in the benchmark."""

WORSE = 1.01
"""A ratio above this one is marked."""

SAME = 1e-9
"""Values that agree to this share of the largest are called equal; other orders of sums differ by their rounding."""

REPEATS = 15
"""Ratios of times are the median over so many measurements."""

EFFORT = Effort(rounds=16, sample=2e4)
"""Each is the ratio of the shortest of so many samples, taken in turns."""

PLACES = {"q": 0, "dq": 1, "ddq": 2, "tau": 2}
"""Offset of an input in a state, in multiples of the number of joints; other inputs are the same in every state."""

PROTOTYPE = re.compile(r"^(?:void|\w+_status) (\w+?)\(([^()]*)\);", re.MULTILINE)
ARGUMENT = re.compile(r"(const )?\w+_real (\w+)\[(?:\w+_RESTRICT )?(\d+)\]")


@dataclass(frozen=True)
class Argument:
    """An array that a function reads or, if it is an ``output``, writes."""

    name: str
    size: int
    output: bool


@dataclass(frozen=True)
class Side:
    """The emitted files of a robot before or after the change, under names that tell the side."""

    robot: str
    tag: str
    files: dict[str, str]

    @classmethod
    def read(cls, folder: Path, robot: str, tag: str) -> Side:
        """The C files of ``folder/robot``, renamed."""
        names = [f"{robot}{part}" for part in (".h", ".c", "_nominal.c", "_derivatives.c", "_ik.h", "_ik.c")]
        found = [path for path in (folder / robot / name for name in names) if path.exists()]
        return cls(
            robot, tag, {_renamed(path.name, robot, tag): _renamed(path.read_text(), robot, tag) for path in found}
        )

    @property
    def prefix(self) -> str:
        """What the names of its functions begin with."""
        return f"{self.robot}_{self.tag}_"

    def functions(self) -> dict[str, tuple[Argument, ...]]:
        """The functions whose arguments are all arrays, by their name without prefix."""
        found = {}
        for name, text in PROTOTYPE.findall(self.files[f"{self.robot}_{self.tag}.h"]):
            matches = [ARGUMENT.fullmatch(part.strip()) for part in text.split(",")]
            arguments = tuple(Argument(m[2], int(m[3]), not m[1]) for m in matches if m is not None)
            if len(arguments) == len(matches) and any(argument.output for argument in arguments):
                found[name.removeprefix(self.prefix)] = arguments
        return found

    def contender(self, function: str, arguments: Sequence[Argument], n: int) -> Contender:
        """One function with its inputs from the state or from the constants of this side."""
        texts, filled = [], 0
        for argument in arguments:
            if argument.output:
                texts.append(f"out + {filled}")
                filled += argument.size
            elif argument.name in PLACES:
                texts.append(f"in + {PLACES[argument.name] * n}")
            else:
                texts.append(f"{self.prefix}{argument.name}_values")
        return Contender(self.tag, function, filled, f"(void){self.prefix}{function}({', '.join(texts)});")

    def constants(self, functions: dict[str, tuple[Argument, ...]]) -> tuple[str, str]:
        """Declarations of the inputs that are no part of a state, and statements that give the base parameters."""
        inputs = {a.name: a.size for each in functions.values() for a in each if not a.output and a.name not in PLACES}
        lines = []
        for name, size in inputs.items():
            values = ", ".join(repr(0.1 * (k % 7 + 1)) for k in range(size))
            lines.append(f"static double {self.prefix}{name}_values[{size}] = {{{values}}};")
        nominal = "nominal_parameters" in self.functions() and "beta" in inputs
        setup = f"{self.prefix}nominal_parameters({self.prefix}beta_values);" if nominal else ""
        return "\n".join([*(f'#include "{name}"' for name in self.files if name.endswith(".h")), *lines, ""]), setup

    def inverse_kinematics(self, n: int) -> Contender | None:
        """The inverse kinematics of the pose behind the states of a joint; its values are the solutions."""
        header = self.files.get(f"{self.prefix}ik.h")
        if header is None:
            return None
        arguments = header.split(f"{self.prefix}inverse_kinematics(", 1)[1].split(")", 1)[0]
        position = "target[3]" in arguments or "RESTRICT 3]" in arguments
        (rows,) = re.findall(rf"#define {self.prefix.upper()}IK_ROWS (\d+)", header)
        solutions = f"{self.prefix}ik_solutions"
        statements = (
            f"static {solutions} found; "
            f"(void){self.prefix}inverse_kinematics(in + {4 * n + (16 if position else 0)}, 0, "
            f"{'0.25, ' if 'redundancy' in arguments else ''}0u, &found); "
            f"for (int k = 0; k < {int(rows) * n}; k++) out[k] = k < found.count * {n} ? (&found.q[0][0])[k] : 0.0;"
        )
        return Contender(self.tag, "inverse_kinematics", int(rows) * n, statements)


def _renamed(text: str, robot: str, tag: str) -> str:
    for name in (robot, robot.upper()):
        text = re.sub(rf"\b{name}(?=_|\.h\b|\.c\b)", f"{name}_{tag if name == robot else tag.upper()}", text)
    return text


def main(arguments: Sequence[str]) -> None:
    """Compare the robots that both folders hold."""
    folders = [Path(argument) for argument in arguments if argument != "--times"]
    if len(folders) != 2 or not all(folder.is_dir() for folder in folders):
        raise SystemExit(__doc__)
    before, after = folders
    robots = sorted(path.name for path in before.iterdir() if (after / path.name / f"{path.name}.h").exists())
    toolchain = find_toolchain()
    worse = 0
    for robot in robots:
        for line, ratio in compared(robot, before, after, toolchain, "--times" in arguments):
            worse += ratio > WORSE
            click.echo(line)
    click.echo(f"{worse} above {WORSE}")


def compared(robot: str, before: Path, after: Path, toolchain: Toolchain, times: bool) -> list[tuple[str, float]]:
    """For every function: a line of the table, and the ratio of instructions."""
    spec = load_spec(robot)
    sides = [Side.read(before, robot, "before"), Side.read(after, robot, "after")]
    known = [side.functions() for side in sides]
    shared = {name: known[0][name] for name in known[0] if known[1].get(name) == known[0][name]}
    contenders: list[Contender] = []
    for name, arguments in shared.items():
        contenders += [side.contender(name, arguments, spec.n) for side in sides]
    solvers = [side.inverse_kinematics(spec.n) for side in sides]
    contenders += [solver for solver in solvers if solver is not None and None not in solvers]
    declared = [side.constants(shared) for side in sides]
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        driver = Driver.build(
            Path(place),
            contenders,
            {name: text for side in sides for name, text in side.files.items()},
            "".join(text for text, _ in declared),
            _states(robot),
            toolchain,
            setup=" ".join(setup for _, setup in declared),
        )
        values, counts = driver.values(), driver.instructions(COUNTED)
        timed = _timed(driver) if times else {}
    lines = []
    for k in range(0, len(contenders), 2):
        first, second = counts[k], counts[k + 1]
        ratio = second / first if first else 1.0
        scale = float(np.max(np.abs(values[k]), initial=0.0))
        same = bool(np.all(np.abs(values[k] - values[k + 1]) <= SAME * scale))
        marks = timed.get(k, "") + (" ABOVE" if ratio > WORSE else "") + ("" if same else " values differ")
        lines.append(
            (f"{robot:9} {contenders[k].function:36} {first:9.1f} -> {second:9.1f}  {ratio:.3f}{marks}", ratio)
        )
    return lines


def _timed(driver: Driver) -> dict[int, str]:
    """For every pair of contenders, by the number of the first: its time, and the ratio of times with its quartiles."""
    runs = [driver.times(EFFORT) for _ in range(REPEATS)]
    texts = {}
    for k in range(0, len(driver.contenders), 2):
        low, middle, high = np.percentile([run[k + 1] / run[k] for run in runs], [25, 50, 75])
        texts[k] = f"  {np.median([run[k] for run in runs]):8.1f} ns  x {middle:.3f} ({low:.3f} to {high:.3f})"
    return texts


def _states(robot: str) -> Array:
    """States (STATES, 4 n + 19): q, dq, ddq or tau, a spare part, the pose of the tip for q, and its position."""
    chain = chain_of(load_spec(robot))
    rng = np.random.default_rng([11, chain.n])
    parts = [rng.uniform(-scale, scale, (STATES, chain.n)) for scale in (np.pi, 3.0, 10.0, 1.0)]
    poses = NewtonEuler(chain, np.zeros((chain.n, 10))).forward_kinematics(parts[0])
    return np.hstack([*parts, poses.reshape(STATES, 16), poses[:, :3, 3]])


if __name__ == "__main__":
    main(sys.argv[1:])
