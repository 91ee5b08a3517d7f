"""The table of faults on any arm: ``python -m tests.controller.fault_table [ROBOT].. --ticks 1000000``.

The driver ``fault_table.c`` is compiled with the unit, and with its undefined behaviour made fatal, and run.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from rrrgen.controller.files import standalone_files
from rrrgen.controller.table import GROUPS, MODES, mode_number, unit_of
from rrrgen.emit import Real
from rrrgen.emit.targets.c_package import derived_model
from rrrgen.robot.file import read

HERE = Path(__file__).parent
ARMS = ("rrr", str(HERE / "Own6.yaml"), "panda")
"""Three, six and seven joints: the reference arm, one made for this test with a prismatic joint, and the Panda."""

WARNINGS = (
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wfloat-equal",
    "-Werror",
)


def built(
    robot: str,
    folder: Path,
    real: Real = "double",
    parts: Sequence[str] | None = None,
    compiler: Sequence[str] = ("gcc", "-std=c99"),
    flags: Sequence[str] = ("-O1",),
) -> Path:
    """Compile the emitted code for one arm in ``folder``, with ``flags``, and its driver; both without a warning.

    Undefined behaviour is fatal unless ``flags`` switch the sanitizers off, which not every compiler has a library for.
    """
    model = derived_model(read(robot), GROUPS)[0]
    unit = unit_of(model, None, parts)
    plant = [model.programs[name] for name in ("forward_dynamics", "forward_kinematics", "mass_matrix")]
    files = standalone_files(unit, real, plant)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    name = model.spec.name
    chosen = [mode for mode in MODES if mode.name in unit.modes]
    words = {
        "ROBOT": name,
        "UPPER": name.upper(),
        "MODEL_HEADER": f'"{name}.h"',
        "UNIT_HEADER": f'"{name}_controller.h"',
        "MODES": ",".join(str(mode_number(mode.name)) for mode in chosen),
        "REFERENCED": ",".join(str(int(bool(mode.reference))) for mode in chosen),
        **({"FILTERED": "1"} if unit.filtered else {}),
        **({"OBSERVED": "1"} if unit.has("observer") else {}),
    }
    strict = [*WARNINGS, "-fsanitize=undefined", "-fno-sanitize-recover=all"]
    sanitizers = [flag for flag in flags if flag.startswith("-fno-sanitize")]
    sources = [file for file in files if file.endswith(".c")]
    own = [f"-D{key}={value}" for key, value in words.items()]
    for command in (
        [*compiler, *strict, *flags, "-c", *sources],
        [*compiler, *strict, "-O1", *sanitizers, "-I.", *own, "-c", str(HERE / "fault_table.c")],
        [
            compiler[0],
            "-fsanitize=undefined",
            *sanitizers,
            *(f"{Path(each).stem}.o" for each in (*sources, "fault_table.c")),
            "-lm",
            "-o",
            "fault_table",
        ],
    ):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(done.stderr[:4000])
    return folder / "fault_table"


def outcome(program: Path, ticks: int, seed: int = 0) -> tuple[bool, str]:
    """Whether all ticks passed, and what the driver has printed."""
    done = subprocess.run([str(program), str(ticks), str(seed)], capture_output=True, text=True, check=False)
    return done.returncode == 0, done.stdout + done.stderr


@click.command()
@click.argument("robots", nargs=-1)
@click.option("--ticks", default=1_000_000, show_default=True)
@click.option("--seed", default=0, show_default=True)
@click.option("--real", type=click.Choice(["double", "float"]), default="double", show_default=True)
@click.option("--parts", default="", help="Parts of the unit, as in `rrrgen generate --parts`.")
def main(robots: tuple[str, ...], ticks: int, seed: int, real: Real, parts: str) -> int:
    """Inject faults into every mode on ROBOTS, by default three of 3, 6 and 7 joints; exit with 1 on a surprise."""
    sound = True
    for robot in robots or ARMS:
        with tempfile.TemporaryDirectory(prefix="rrrgen-faults-") as folder:
            passed, text = outcome(built(robot, Path(folder), real, parts.split(",") if parts else None), ticks, seed)
        click.echo(f"{Path(robot).stem}, {real}: {text.strip()}")
        sound = sound and passed
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(main(standalone_mode=False))
