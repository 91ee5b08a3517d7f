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
import numpy as np

from bench.templates import render
from rrrgen.backends.c.solver.passes import PASSES, Pass
from rrrgen.robotfile import bundled_names, load_spec
from rrrgen.verify.references.chain import Array, chain_of
from rrrgen.verify.references.newton_euler import NewtonEuler

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


def write(robot: str, folder: Path, passes: Sequence[Pass] = PASSES) -> None:
    """Write the inverse kinematics of a bundled robot, planned anew."""
    from rrrgen.backends.c.solver.files import emit
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
    _targets(robot).tofile(targets)
    programs = [_built(robot, folder, place / f"{folder.name}-program") for folder in (before, after)]
    answers = [
        subprocess.run([program, targets, "print"], capture_output=True, check=True).stdout for program in programs
    ]
    lines = [answer.splitlines() for answer in answers]
    differ = sum(x != y for x, y in zip(*lines, strict=True))
    rows = [sum(int(line.split()[2]) for line in each) for each in lines]
    counts = [_instructions(program, targets) for program in programs]
    return (
        f"{robot:9} {counts[0]:9.1f} -> {counts[1]:9.1f} instructions a call ({counts[1] / counts[0] - 1:+.1%}); "
        f"{rows[0]} -> {rows[1]} rows, {differ} of {len(lines[0])} targets differ"
    )


def answers(robot: str, before: Path, after: Path, place: Path) -> tuple[Array, tuple[list[Array], list[Array]]]:
    """The targets (TARGETS, 16), and for each the solutions (rows, n) of the files of two folders."""
    targets = _targets(robot)
    targets.tofile(place / "targets")
    n = load_spec(robot).n
    both = []
    for folder in (before, after):
        program = _built(robot, folder, place / f"{folder.name}-program")
        said = subprocess.run([program, place / "targets", "print"], capture_output=True, text=True, check=True).stdout
        rows = [[part.split()[:n] for part in line.split("|")[1:]] for line in said.splitlines()]
        both.append([np.array([[float.fromhex(x) for x in row] for row in each]).reshape(-1, n) for each in rows])
    return targets, (both[0], both[1])


def machine_code(robot: str, folder: Path) -> int:
    """Bytes of the text section, gcc -O2."""
    program = folder / "solver.o"
    subprocess.run(["gcc", "-O2", "-w", f"-I{folder}", "-c", folder / f"{robot}_ik.c", "-o", program], check=True)
    said = subprocess.run(["size", program], capture_output=True, text=True, check=True).stdout
    return int(said.splitlines()[1].split()[0])


def _targets(robot: str) -> Array:
    """Poses (TARGETS, 16): two thirds of random configurations, the others at right angles or a little beside them."""
    chain = chain_of(load_spec(robot))
    rng = np.random.default_rng([7, chain.n])
    slides = ~np.asarray(chain.revolute)
    q = rng.uniform(-np.pi, np.pi, (TARGETS, chain.n))
    special = slice(2 * TARGETS // 3, TARGETS)
    q[special] = rng.integers(-4, 5, q[special].shape) * (np.pi / 4)
    beside = slice(5 * TARGETS // 6, TARGETS)
    q[beside] += rng.normal(size=q[beside].shape) * 10.0 ** rng.integers(-14, -2, (len(q[beside]), 1))
    q[:, slides] *= 0.1
    return NewtonEuler(chain, np.zeros((chain.n, 10))).forward_kinematics(q).reshape(TARGETS, 16)


def _built(robot: str, folder: Path, program: Path) -> Path:
    """The driver with the files of one folder."""
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


def _instructions(program: Path, targets: Path) -> float:
    """Instructions of one call by callgrind: those of a run, without those of reading the targets."""
    totals = []
    for what in ("read", "solve"):
        command = [
            "valgrind",
            "--tool=callgrind",
            "--callgrind-out-file=/dev/null",
            str(program),
            str(targets),
            what,
            str(CALLS),
        ]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
        totals.append(int(said.rsplit("Collected :", 1)[1].split()[0]))
    return (totals[1] - totals[0]) / CALLS


if __name__ == "__main__":
    main(sys.argv[1:])
