"""Machines on which emitted C is built and run: natively, under QEMU, in Node. ``python -m bench.machines`` runs all.

For every robot and machine the emitted self-test is compiled with -std=c99 and run. It compares the functions, inverse
kinematics included, with golden vectors and identities, and prints a digest of the bits of its results, which in double
must be the same on every machine.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

import click

from rrrgen.emit import Real

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
CORTEX = EXAMPLES / "cortex_m"
ZIG = (sys.executable, "-m", "ziglang")


@dataclass(frozen=True)
class Machine:
    """A processor: ``compiler`` with its flags, ``runner`` that executes a program, ``startup`` code beside it."""

    name: str
    compiler: tuple[str, ...]
    runner: tuple[str, ...] = ()
    startup: tuple[str, ...] = ()
    link: tuple[str, ...] = ("-lm",)
    suffix: str = ""

    @property
    def missing(self) -> list[str]:
        """The tools that are not installed."""
        tools = [tool for tool in (self.compiler[0], *self.runner[:1]) if shutil.which(tool) is None]
        return tools + (["ziglang"] if "ziglang" in self.compiler and find_spec("ziglang") is None else [])

    def build(self, folder: Path, sources: Sequence[str], level: str = "-O1", warnings: Sequence[str] = ()) -> Path:
        """Compile C ``sources`` in ``folder``; ``warnings`` are flags for them, not for the start-up code."""
        objects = []
        for source in (*sources, *self.startup):
            objects.append(f"{Path(source).stem}.{self.name}.o")
            flags = ["-std=gnu99"] if source in self.startup else ["-std=c99", "-ffp-contract=off", *warnings]
            run([*self.compiler, *flags, level, "-c", source, "-o", objects[-1]], folder)
        program = f"program.{self.name}{self.suffix}"
        run([*self.compiler, level, *objects, *self.link, "-o", program], folder)
        return folder / program

    def execute(self, program: Path, timeout: float = 120) -> tuple[int, str]:
        """Exit status and output of a program on this machine."""
        done = subprocess.run(
            [*self.runner, str(program)], capture_output=True, text=True, timeout=timeout, check=False
        )
        return done.returncode, done.stdout + done.stderr


def _under_qemu(name: str, compiler: str, emulator: str) -> Machine:
    return Machine(name, (compiler,), (emulator,), link=("-static", "-lm"))


def _bare_metal(name: str, processor: str, unit: str, board: str) -> Machine:
    compiler = ("arm-none-eabi-gcc", f"-mcpu={processor}", f"-mfpu={unit}", "-mfloat-abi=hard", "-mthumb")
    emulator = ("qemu-system-arm", "-M", board, "-nographic", "-monitor", "none", "-serial", "none")
    return Machine(
        name,
        compiler,
        (*emulator, "-semihosting", "-icount", "shift=0", "-kernel"),
        (str(CORTEX / "startup.c"),),
        ("--specs=rdimon.specs", "-nostartfiles", "-T", str(CORTEX / "mps2.ld"), "-lm"),
    )


MACHINES = {
    machine.name: machine
    for machine in (
        Machine("native", ("gcc",)),
        _under_qemu("aarch64", "aarch64-linux-gnu-gcc", "qemu-aarch64"),
        _under_qemu("armhf", "arm-linux-gnueabihf-gcc", "qemu-arm"),
        _under_qemu("s390x", "s390x-linux-gnu-gcc", "qemu-s390x"),
        _bare_metal("cortex-m4f", "cortex-m4", "fpv4-sp-d16", "mps2-an386"),
        _bare_metal("cortex-m7", "cortex-m7", "fpv5-d16", "mps2-an500"),
        Machine(
            "wasm",
            (*ZIG, "cc", "-target", "wasm32-wasi"),
            ("node", "--no-warnings", str(EXAMPLES / "wasi.mjs")),
            suffix=".wasm",
        ),
    )
}
"""Every machine by its name; s390x is big-endian, the Cortex-M4F has no unit for double."""


def run(command: Sequence[str], folder: Path) -> None:
    """Run a compiler. Raises RuntimeError with its message if it fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")


def digest(output: str) -> str:
    """The digest of the results that a self-test has printed."""
    return next((line.split()[1] for line in output.splitlines() if line.startswith("bits")), "")


def selftest_files(name: str, real: Real, folder: Path) -> list[str]:
    """Emit a robot into ``folder``, with differential IK and Fourier series; the C files of its self-test."""
    from rrrgen.derive import derive
    from rrrgen.emit.controller.template_files import checks_beside, files_beside
    from rrrgen.emit.package import emit
    from rrrgen.robot.file import read

    spec, groups = read(name), ("control", "trajectory")
    further, checks = files_beside(spec, real, groups), checks_beside(spec, groups)
    files = emit(derive(spec), real, further=further, checks=checks)
    found = {file: text for file, text in files.items() if file.endswith((".c", ".h")) and "/" not in file}
    for file, text in found.items():
        (folder / file).write_text(str(text), encoding="utf-8")
    return sorted(file for file in found if file.endswith(".c"))


def executed(machine: Machine, folder: Path, sources: Sequence[str], warnings: Sequence[str] = ()) -> tuple[bool, str]:
    """Whether a self-test passes on a machine, and the digest of its results."""
    status, output = machine.execute(machine.build(folder, sources, warnings=warnings), timeout=600)
    return status == 0, digest(output)


def _rows(robots: Sequence[str], machines: Sequence[Machine]) -> Iterator[tuple[str, str, str, bool, str]]:
    """(robot, real, machine, passed, digest) of every self-test."""
    for robot in robots:
        for real in get_args(Real):
            with tempfile.TemporaryDirectory(prefix="rrrgen-machines-") as name:
                sources = selftest_files(robot, real, Path(name))
                for machine in machines:
                    yield robot, real, machine.name, *executed(machine, Path(name), sources)


@click.command()
@click.argument("robots", nargs=-1)
def machines(robots: tuple[str, ...]) -> int:
    """Run the self-tests of ROBOTS (all bundled ones if none is named) on all machines; exit with 1 if one fails.

    Machines whose tools are not installed are named and left out.
    """
    from rrrgen.robot.robots import bundled_names

    for machine in MACHINES.values():
        if machine.missing:
            click.echo(f"{machine.name}: left out, needs {', '.join(machine.missing)}")
    sound, bits = True, dict[str, str]()
    there = [machine for machine in MACHINES.values() if not machine.missing]
    for robot, real, name, passed, found in _rows(robots or bundled_names(), there):
        same = real == "float" or bits.setdefault(robot, found) == found
        sound = sound and passed and same
        verdict = ("ok" if passed else "FAILED") + ("" if same else " DIFFERS")
        click.echo(f"{robot:10} {real:6} {name:11} {found} {verdict}")
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(machines(standalone_mode=False))
