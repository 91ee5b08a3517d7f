"""What one tick of the controller costs: ``python -m bench.measurements.controller_costs [ROBOT].. [--write]``.

Instructions are those that callgrind counts between one and two passes over a motion, exact and repeatable; nanoseconds
are the least of many passes, on a machine that may do other work. ``--write`` puts the table into docs/controller.md.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from rrrgen.controller.files import describe_unit, standalone_files
from rrrgen.controller.table import GROUPS, mode_number, unit_of
from rrrgen.emit.targets.c_package import derived_model
from rrrgen.robot.file import read

ROOT = Path(__file__).resolve().parents[2]
DRIVER = ROOT / "bench" / "templates" / "controller_costs.c"
PAGE = ROOT / "docs" / "controller.md"
BEGIN, END = "<!-- costs -->\n", "<!-- end of costs -->\n"
TICKS, PASSES = 1024, 400

WORK: dict[str, tuple[str, tuple[str, ...]]] = {
    "gates alone (mode free)": ("free", ()),
    "computed torque": ("computed_torque", ()),
    "and friction, observer, contact, Kalman filter": ("computed_torque", ("friction", "observer", "kalman")),
}
"""Rows: mode and parts of a unit that has nothing else."""


@dataclass(frozen=True)
class Cost:
    """One row: the bytes are those of parameters, state, input and output."""

    robot: str
    joints: int
    work: str
    instructions: int
    nanoseconds: float
    stack: int
    sizes: tuple[int, int, int, int]


def measured(robot: str, work: str, folder: Path) -> Cost:
    """Compile and run one unit with gcc -O2."""
    mode, parts = WORK[work]
    model = derived_model(read(robot), GROUPS)[0]
    unit = unit_of(model, [mode], parts)
    files = standalone_files(unit, "double")
    for file, text in files.items():
        (folder / file).write_text(text, encoding="utf-8", newline="\n")
    name = model.spec.name
    words = {"ROBOT": name, "UPPER": name.upper(), "MODE": mode_number(mode)}
    words |= {"MODEL_HEADER": f'"{name}.h"', "UNIT_HEADER": f'"{name}_controller.h"'}
    words |= ({"FILTERED": 1} if unit.filtered else {}) | ({"FOLLOWS": 1} if mode != "free" else {})
    command = ["gcc", "-std=c99", "-O2", "-I.", *(f"-D{key}={value}" for key, value in words.items())]
    sources = [file for file in files if file.endswith(".c")]
    _run([*command, *sources, str(DRIVER), "-lm", "-o", "costs"], folder)
    nanoseconds, stack, phase = _run(["./costs", str(PASSES)], folder).split()
    if phase != "0":
        raise RuntimeError(f"{name}, {work}: the controller left the phase RUN")
    counted = [_instructions(folder, passes) for passes in (1, 2)]
    laid = describe_unit(unit, "double")
    sizes = [laid["structs"]["params"]["size"], laid["state_size"]]
    sizes += [laid["structs"][each]["size"] for each in ("input", "output")]
    per_tick = round((counted[1] - counted[0]) / TICKS)
    return Cost(name, unit.n, work, per_tick, float(nanoseconds), int(stack), (sizes[0], sizes[1], sizes[2], sizes[3]))


def _instructions(folder: Path, passes: int) -> int:
    tool = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    done = subprocess.run([*tool, "./costs", str(passes)], cwd=folder, capture_output=True, text=True, check=True)
    found = re.search(r"Collected : (\d+)", done.stderr)
    assert found is not None, done.stderr
    return int(found[1])


def _run(command: Sequence[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr[:2000]}")
    return done.stdout


def table(costs: Sequence[Cost]) -> str:
    """The rows as a table in Markdown."""
    lines = [
        "| arm | one tick | instructions | ns | stack | parameters, state, input, output |",
        "|---|---|---|---|---|---|",
    ]
    for cost in costs:
        sizes = ", ".join(map(str, cost.sizes))
        arm = f"{cost.robot}, {cost.joints} joints"
        lines.append(f"| {arm} | {cost.work} | {cost.instructions} | {cost.nanoseconds:.0f} | {cost.stack} | {sizes} |")
    return "\n".join(lines) + "\n"


@click.command()
@click.argument("robots", nargs=-1)
@click.option("--write", is_flag=True, help="Put the table into docs/controller.md.")
def main(robots: tuple[str, ...], write: bool) -> None:
    """Print the costs of the controller of ROBOTS, by default of rrr, ur5 and panda."""
    costs = []
    for robot in robots or ("rrr", "ur5", "panda"):
        for work in WORK:
            with tempfile.TemporaryDirectory(prefix="rrrgen-costs-") as folder:
                costs.append(measured(robot, work, Path(folder)))
    text = table(costs)
    click.echo(text, nl=False)
    if write:
        page = PAGE.read_text(encoding="utf-8")
        before, _, rest = page.partition(BEGIN)
        PAGE.write_text(before + BEGIN + text + END + rest.partition(END)[2], encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
