"""What a change does to the emitted inverse kinematics: instructions per call, and every solution bit by bit.

    python -m bench.measurements.ik_change --write FOLDER [ROBOT ...]      in the checkout before the change
    python -m bench.measurements.ik_change FOLDER [ROBOT ...]              in the checkout after it

The first writes ``<robot>_ik.c`` and ``.h``. The second prints, before and after: instructions per call on reachable
targets (callgrind, gcc -O2), and on how many targets of 10 000, a third of them at or beside singular configurations,
the answers differ in any bit.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from bench.measurements.ik_targets import Task, mixed
from bench.templates import render
from rrrgen.emit.c.ik.loop_nest import PASSES, LoopPass
from rrrgen.robot.file import bundled_names, load_spec

TARGETS = 10_000
CALLS = 200
"""Calls that callgrind counts: the instructions of a call differ by its target only, by a few per cent."""


def main(arguments: Sequence[str]) -> None:
    """Write the files before a change, or compare those of a folder with the files of this checkout."""
    only_write = arguments[:1] == ["--write"]
    folder, *robots = arguments[1:] if only_write else arguments
    for robot in robots or bundled_names():
        if only_write:
            write(robot, Path(folder))
            continue
        with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
            after = Path(place) / "after"
            write(robot, after)
            click.echo(compared(robot, Path(folder), after, Path(place)))


def write(robot: str, folder: Path, passes: Sequence[LoopPass] = PASSES) -> None:
    """Write the inverse kinematics of a bundled robot, planned anew."""
    from rrrgen.emit.c.ik.files import emit
    from rrrgen.ik.classify import plan_chain
    from rrrgen.ik.geometry.chain import numeric_chain

    spec = load_spec(robot)
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in emit(spec, plan_chain(numeric_chain(spec)), passes=passes).files.items():
        if file.endswith((".c", ".h")):
            (folder / file).write_text(text, encoding="utf-8")


def compared(robot: str, before: Path, after: Path, place: Path) -> str:
    """One line of the table."""
    targets = place / "targets"
    mixed(Task.of(robot), TARGETS).tofile(targets)
    programs = [built(robot, folder, place / f"{folder.name}-program") for folder in (before, after)]
    answers = [
        subprocess.run([program, targets, "print"], capture_output=True, check=True).stdout for program in programs
    ]
    lines = [answer.splitlines() for answer in answers]
    differ = sum(x != y for x, y in zip(*lines, strict=True))
    rows = [sum(int(line.split()[2]) for line in each) for each in lines]
    counts = [instructions(program, targets) for program in programs]
    return (
        f"{robot:9} {counts[0]:9.1f} -> {counts[1]:9.1f} instructions a call ({counts[1] / counts[0] - 1:+.1%}); "
        f"{rows[0]} -> {rows[1]} rows, {differ} of {len(lines[0])} targets differ"
    )


def machine_code(robot: str, folder: Path) -> int:
    """Bytes of the text section, gcc -O2."""
    program = folder / "solver.o"
    subprocess.run(["gcc", "-O2", "-w", f"-I{folder}", "-c", folder / f"{robot}_ik.c", "-o", program], check=True)
    said = subprocess.run(["size", program], capture_output=True, text=True, check=True).stdout
    return int(said.splitlines()[1].split()[0])


def built(robot: str, folder: Path, program: Path) -> Path:
    """The program of ``bench/templates/ik_change.c.j2`` with the solver of one folder."""
    header = (folder / f"{robot}_ik.h").read_text(encoding="utf-8")
    arguments = header.split(f"{robot}_inverse_kinematics(", 1)[1].split(")", 1)[0]
    source = program.with_suffix(".c")
    text = render(
        "ik_change.c.j2",
        robot=robot,
        n=load_spec(robot).n,
        position="target[3]" in arguments or "RESTRICT 3]" in arguments,
        redundant="redundancy" in arguments,
    )
    source.write_text(text, encoding="utf-8")
    files = [source, folder / f"{robot}_ik.c"]
    subprocess.run(["gcc", "-O2", f"-I{folder}", *files, "-lm", "-o", program], check=True)
    return program


def instructions(program: Path, targets: Path, calls: int = CALLS, options: int = 0) -> float:
    """Instructions of one call by callgrind: those of a run, without those of reading the targets."""
    totals = []
    for what in ("nothing", "solve"):
        tool = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
        command = [*tool, str(program), str(targets), what, str(calls), str(options)]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
        totals.append(int(said.rsplit("Collected :", 1)[1].split()[0]))
    return (totals[1] - totals[0]) / calls


if __name__ == "__main__":
    main(sys.argv[1:])
