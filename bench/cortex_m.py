"""The control loop of examples/cortex_m on an emulated Cortex-M4F: instructions of a tick, stack, code.

``python -m bench.cortex_m rrr puma560 panda`` prints a row for each robot; ``--figure FILE`` draws the motion of the
first one. QEMU executes one instruction per nanosecond
of its clock, so instructions are exact and repeat; cycles of a real processor are more.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

from bench.machines import CORTEX, MACHINES

SOURCE = CORTEX / "loop.c"
CLOCK = 168e6  # Hz, of a common Cortex-M4F
RATE = 1e3  # Hz, of the loop


@dataclass(frozen=True)
class Loop:
    """What the loop has printed, and the bytes of code and constants of the controller."""

    passed: bool
    error: float  # rad or m
    external: float  # N m or N; nothing touches the arm
    instructions: int
    stack: int
    code: int
    trace: tuple[tuple[float, ...], ...]  # seconds; reference, position and torque of each joint; every tenth tick

    @property
    def share(self) -> float:
        """Part of a processor that executes one instruction per cycle."""
        return self.instructions * RATE / CLOCK


def measured(name: str, folder: Path) -> Loop:
    """Emit the controller of a robot in float, run the loop, and read what it prints."""
    from rrrgen.controller.files import standalone_files
    from rrrgen.controller.table import GROUPS, unit_of
    from rrrgen.emit.targets.c_package import derived_model
    from rrrgen.robot.file import read

    model = derived_model(read(name), GROUPS)[0]
    unit = unit_of(model, ["computed_torque"], ["observer"])
    files = standalone_files(unit, "float", [model.programs["forward_dynamics"]])
    for file, text in files.items():
        (folder / file).write_text(text, encoding="utf-8", newline="\n")
    robot = model.spec.name
    headers = {"MODEL": f'"{robot}.h"', "CONTROLLER": f'"{robot}_controller.h"'}
    named = {"ROBOT": robot, "UPPER": robot.upper(), **headers, "TRACE": 1}
    machine = MACHINES["cortex-m4f"]
    options = (*(f"-D{key}={value}" for key, value in named.items()), f"-I{folder}", "-ffunction-sections")
    machine = replace(machine, compiler=(*machine.compiler, *options), link=(*machine.link, "-Wl,--gc-sections"))
    sources = [file for file in files if file.endswith(".c")]
    program = machine.build(folder, [*sources, str(SOURCE)], "-O2")
    status, output = machine.execute(program)
    *lines, last = output.strip().splitlines() or [""]
    numbers = [float(each) for each in re.findall(r"[-+]?\d+(?:\.\d+)?(?:e[-+]\d+)?", last)]
    if len(numbers) != 4:
        raise RuntimeError(f"the loop of {name} did not finish: {output}")
    error, external, instructions, stack = numbers
    return Loop(status == 0, error, external, int(instructions), int(stack), _code(program, robot), _trace(lines))


def _trace(lines: Sequence[str]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, line.split())) for line in lines)


def draw(name: str, loop: Loop, file: Path) -> None:
    """Draw positions beside their references, tracking errors and torques of the loop that ran on the processor."""
    from matplotlib.figure import Figure

    seconds, *columns = np.array(loop.trace).T
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    motion, error, torque = figure.subplots(3, 1, sharex=True)
    for k, (reference, position, tau) in enumerate(np.array(columns).reshape(-1, 3, len(seconds)), 1):
        motion.plot(seconds, reference, color="0.7", linewidth=4, label="reference" if k == 1 else None)
        motion.plot(seconds, position, color=f"C{k - 1}", label=f"joint {k}")
        error.plot(seconds, 1e3 * (reference - position), color=f"C{k - 1}")
        torque.plot(seconds, tau, color=f"C{k - 1}")
    motion.set_ylabel("position, rad")
    motion.legend()
    error.set_ylabel("tracking error, mrad")
    torque.set_ylabel("torque, N m")
    torque.set_xlabel("time, s")
    motion.set_title(f"{name} in float on an emulated Cortex-M4F: {loop.instructions} instructions a tick")
    figure.savefig(file, dpi=110)


def _code(program: Path, name: str) -> int:
    listed = subprocess.run(["arm-none-eabi-nm", "-S", str(program)], capture_output=True, text=True, check=True)
    rows = [line.split() for line in listed.stdout.splitlines()]
    apart = f"{name}_forward_dynamics"  # the plant
    return sum(int(row[1], 16) for row in rows if len(row) == 4 and row[3].startswith(f"{name}_") and row[3] != apart)


@click.command()
@click.argument("robots", nargs=-1, required=True)
@click.option("--figure", type=click.Path(path_type=Path), help="Draw the motion of the first robot to this file.")
def cortex_m(robots: tuple[str, ...], figure: Path | None) -> int:
    """Print instructions of a tick, share of a core, stack and code of the loop of ROBOTS; exit with 1 if one fails."""
    click.echo(
        f"{'robot':12} {'instructions':>12} {'of 168 MHz':>10} {'stack':>7} {'code':>7} {'error':>9} {'external':>9}"
    )
    sound = True
    for name in robots:
        with tempfile.TemporaryDirectory(prefix="rrrgen-cortex-") as folder:
            loop = measured(name, Path(folder))
        row = f"{loop.instructions:12} {loop.share:12.2%} {loop.stack:12} {loop.code:12}"
        click.echo(f"{Path(name).stem:12} {row} {loop.error:12.1e} {loop.external:12.1e}")
        sound = sound and loop.passed
        if figure is not None and name == robots[0]:
            draw(Path(name).stem, loop, figure)
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(cortex_m(standalone_mode=False))
